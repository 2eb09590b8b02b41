/// What displacements, and strain without stress, add to the stiffness of solids.

#include "base/error.hpp"
#include "fem/condensation.hpp"
#include "fem/solid_points.hpp"
#include "linalg/decompositions.hpp"

#include <algorithm>
#include <cmath>

namespace flexgram {
namespace {

double von_mises(const std::array<double, 6>& s) {
  const double xy = s[0] - s[1], yz = s[1] - s[2], zx = s[2] - s[0];
  return std::sqrt(0.5 * (xy * xy + yz * yz + zx * zx) +
                   3 * (s[3] * s[3] + s[4] * s[4] + s[5] * s[5]));
}

using Voigt = std::array<double, 6>;

Voigt linear_strain_of(const Jacobian& H) {
  return {H[0][0],           H[1][1],           H[2][2],
          H[0][1] + H[1][0], H[1][2] + H[2][1], H[2][0] + H[0][2]};
}

Voigt stress_of(const SolidMaterial& material, const Voigt& strain) {
  Voigt s{};
  for (std::size_t r = 0; r < 6; ++r)
    for (std::size_t c = 0; c < 6; ++c) s[r] += material.stiffness[6 * r + c] * strain[c];
  return s;
}

/// Free strain at the points of the stiffness.
std::vector<Voigt> free_strains(ElementType type, const SolidMaterials& material,
                                const FreeStrain& free) {
  if (!free.temperature.empty() && !material.front().expansion)
    throw Error("its material, which a temperature warms, has no expansion");
  std::vector<Voigt> strains;
  for (const ShapePoint& at : stiffness_points(type)) {
    const auto& expansion = at_point(material, strains.size()).expansion;
    Voigt& strain = strains.emplace_back(free.uniform);
    for (std::size_t i = 0; i < free.temperature.size(); ++i)
      for (std::size_t r = 0; r < 6; ++r)
        strain[r] += at.N[i] * free.temperature[i] * (*expansion)[r];
  }
  return strains;
}

/// A solid whose nodes are displaced; the incompatible modes of a Hex8 follow.
struct Displaced {
  Displaced(ElementType type, const std::vector<Vector3>& nodes,
            const SolidMaterials& material, const std::vector<double>& u,
            const FreeStrain* strain = nullptr)
      : points(points_of(type, nodes)), n(static_cast<int>(nodes.size())),
        modes(static_cast<int>(points.front().gradients.size())), moved(3 * n, 1),
        free(points.size()) {
    std::copy(u.begin(), u.end(), moved.data.begin());
    if (strain) {
      free = free_strains(type, material, *strain);
      load = Dense(3 * modes, 1);
      for (std::size_t p = 0; p < points.size(); ++p) {
        const Voigt s = stress_of(at_point(material, p), free[p]);
        for (int i = 0; i < 3 * modes; ++i) {
          const Voigt own =
              linear_strain(as_size(i % 3), points[p].gradients[as_size(i / 3)]);
          for (std::size_t r = 0; r < 6; ++r)
            load(i, 0) += points[p].volume * own[r] * s[r];
        }
      }
    }
    if (modes == n) return;
    Dense K(3 * modes, 3 * modes);
    for (std::size_t p = 0; p < points.size(); ++p)
      add_stiffness(K, points[p].gradients, at_point(material, p).stiffness,
                    points[p].volume, linear_strain);
    mirror(K);
    T = condensation(K, 3 * (modes - n));
    moved = multiply(T, moved);
    if (!strain) return;
    add_to(moved, internal_response(K, 3 * (modes - n), load));
    load = multiply_transposed(T, load);
  }

  /// ∂u/∂x
  Jacobian gradient(const StiffnessPoint& at) const {
    Jacobian H{};
    for (int i = 0; i < 3 * modes; ++i)
      for (std::size_t b = 0; b < 3; ++b)
        H[as_size(i % 3)][b] += moved(i, 0) * at.gradients[as_size(i / 3)][b];
    return H;
  }

  std::vector<StiffnessPoint> points;
  int n, modes; ///< of nodes; with incompatible modes
  Dense moved, T;
  std::vector<Voigt> free; ///< strain without stress, at the points
  Dense load = {};         ///< that of free strain at the nodes; empty: there is none
};

Voigt linear_stress(const SolidMaterial& material, const Jacobian& H) {
  return stress_of(material, linear_strain_of(H));
}

/// Energy of the strains HᵀH that turning adds, less that of their part which displacements of the
/// element can take back: the constant one, of quadratic elements the linear one.
double locked_energy(ElementType type, const std::vector<StiffnessPoint>& points,
                     const std::vector<Jacobian>& gradients,
                     const SolidMaterials& material) {
  const bool is_linear = node_count(type) <= 8;
  const std::size_t functions = is_linear ? 1 : 4;
  if (points.size() <= functions) return 0;
  std::vector<Voigt> strains;
  Dense gram(static_cast<int>(functions), static_cast<int>(functions)),
      part(6, static_cast<int>(functions));
  const auto function = [](const StiffnessPoint& at, std::size_t k) {
    return k == 0 ? 1.0 : at.xi[k - 1];
  };
  for (std::size_t p = 0; p < points.size(); ++p) {
    const Jacobian& H = gradients[p];
    Jacobian product{};
    for (std::size_t i = 0; i < 3; ++i)
      for (std::size_t j = 0; j < 3; ++j)
        for (std::size_t c = 0; c < 3; ++c) product[i][j] += H[c][i] * H[c][j];
    strains.push_back(linear_strain_of(product));
    for (std::size_t k = 0; k < functions; ++k) {
      const double w = points[p].volume * function(points[p], k);
      for (int r = 0; r < 6; ++r)
        part(r, static_cast<int>(k)) += w * strains[p][as_size(r)];
      for (std::size_t l = 0; l < functions; ++l)
        gram(static_cast<int>(k), static_cast<int>(l)) += w * function(points[p], l);
    }
  }
  if (cholesky(gram) != 0) return 0;
  solve_right_transposed(gram, part); // in orthonormal functions
  const Dense fit = multiply(part, transpose(inverse_transposed(gram)));
  double energy = 0;
  for (std::size_t p = 0; p < points.size(); ++p) {
    for (std::size_t r = 0; r < 6; ++r)
      for (std::size_t k = 0; k < functions; ++k)
        strains[p][r] -=
            fit(static_cast<int>(r), static_cast<int>(k)) * function(points[p], k);
    const Voigt s = stress_of(at_point(material, p), strains[p]);
    for (std::size_t r = 0; r < 6; ++r) energy += points[p].volume * s[r] * strains[p][r];
  }
  return energy;
}

/// Adds ∂Nᵀσ∂N of a point above the diagonal.
void add_geometric(Dense& K, const StiffnessPoint& at, const Voigt& s) {
  const std::array<Vector3, 3> sigma{
      {{s[0], s[3], s[5]}, {s[3], s[1], s[4]}, {s[5], s[4], s[2]}}};
  for (int j = 0; j < static_cast<int>(at.gradients.size()); ++j) {
    Vector3 traction{};
    for (std::size_t a = 0; a < 3; ++a)
      for (std::size_t b = 0; b < 3; ++b)
        traction[a] += at.volume * sigma[a][b] * at.gradients[as_size(j)][b];
    for (int i = 0; i <= j; ++i) {
      const Vector3& g = at.gradients[as_size(i)];
      const double both = g[0] * traction[0] + g[1] * traction[1] + g[2] * traction[2];
      for (int c = 0; c < 3; ++c) K(3 * i + c, 3 * j + c) += both;
    }
  }
}

} // namespace

StressStiffness solid_stress_stiffness(ElementType type,
                                       const std::vector<Vector3>& nodes,
                                       const SolidMaterials& material,
                                       const std::vector<double>& u,
                                       const FreeStrain* free, Deformation& deformation) {
  const Displaced body(type, nodes, material, u, free);
  Dense K(3 * body.modes, 3 * body.modes), quadratic(3 * body.modes, 3 * body.modes);
  std::vector<Jacobian> gradients;
  for (std::size_t p = 0; p < body.points.size(); ++p) {
    const StiffnessPoint& at = body.points[p];
    const Jacobian& H = gradients.emplace_back(body.gradient(at));
    const auto& C = at_point(material, p).stiffness;
    // The strain of the moved body is that of the body at rest, L, and N by ∂u/∂x:
    // (L + N)ᵀC(L + N) − LᵀCL is what changes its sign with u, and NᵀCN.
    const auto strain_by = [&](double turn, double at_rest) {
      return
          [&H, turn, at_rest](std::size_t c, const Vector3& g) -> std::array<double, 6> {
            Vector3 f{turn * H[c][0], turn * H[c][1], turn * H[c][2]};
            f[c] += at_rest;
            return {f[0] * g[0],
                    f[1] * g[1],
                    f[2] * g[2],
                    f[0] * g[1] + f[1] * g[0],
                    f[1] * g[2] + f[2] * g[1],
                    f[2] * g[0] + f[0] * g[2]};
          };
    };
    double largest = 0; // of ∂u/∂x: N as large as L, or the difference loses digits
    for (const Vector3& row : H)
      for (const double h : row) largest = std::max(largest, std::abs(h));
    const double scale = largest > 0 ? 1 / largest : 1.0, half = 0.5 * at.volume / scale;
    add_stiffness(K, at.gradients, C, half, strain_by(scale, 1));
    add_stiffness(K, at.gradients, C, -half, strain_by(-scale, 1));
    add_stiffness(quadratic, at.gradients, C, at.volume, strain_by(1, 0));
    Voigt strain = linear_strain_of(H);
    for (std::size_t r = 0; r < 6; ++r) strain[r] -= body.free[p][r];
    const Voigt s = stress_of(at_point(material, p), strain);
    deformation.stress = std::max(deformation.stress, von_mises(s));
    for (std::size_t r = 0; r < 6; ++r)
      deformation.energy += at.volume * s[r] * strain[r];
    add_geometric(K, at, s);
  }
  if (!free) // warm bodies bend without stress
    deformation.locked += locked_energy(type, body.points, gradients, material);
  mirror(K);
  mirror(quadratic);
  if (body.modes > body.n)
    return {condensed(K, body.T), condensed(quadratic, body.T), body.load};
  return {std::move(K), std::move(quadratic), body.load};
}

Dense solid_geometric_stiffness(ElementType type, const std::vector<Vector3>& nodes,
                                const SolidMaterials& material,
                                const std::vector<double>& u) {
  const Displaced body(type, nodes, material, u);
  Dense K(3 * body.modes, 3 * body.modes);
  for (std::size_t p = 0; p < body.points.size(); ++p) {
    const StiffnessPoint& at = body.points[p];
    add_geometric(K, at, linear_stress(at_point(material, p), body.gradient(at)));
  }
  mirror(K);
  return body.modes > body.n ? condensed(K, body.T) : K;
}

} // namespace flexgram
