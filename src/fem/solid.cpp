#include "fem/elements.hpp"

#include "base/error.hpp"
#include "base/index.hpp"
#include "base/text.hpp"
#include "fem/condensation.hpp"
#include "fem/shape_functions.hpp"
#include "linalg/decompositions.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

namespace flexgram {
namespace {

struct TypeFacts {
  const char* name;
  int nodes, dofs;
};
constexpr TypeFacts facts[] = {{"tetra", 4, 3},
                               {"tetra10", 10, 3},
                               {"hexahedron", 8, 3},
                               {"hexahedron20", 20, 3},
                               {"wedge15", 15, 3},
                               {"hexahedron/full", 8, 3},
                               {"hexahedron20/reduced", 20, 3},
                               {"wedge", 6, 3},
                               {"wedge/reduced", 6, 3},
                               {"triangle", 3, 6},
                               {"quad", 4, 6},
                               {"line/rod", 2, 3},
                               {"line", 2, 6},
                               {"mass", 1, 6},
                               {"spring to ground", 1, 6},
                               {"spring", 2, 6},
                               {"node", 1, 6}};

const TypeFacts& facts_of(ElementType type) { return facts[as_size(type)]; }

using Jacobian = std::array<Vector3, 3>; // J[a][b] = ∂x_b / ∂ξ_a

Jacobian jacobian(const ShapePoint& p, const std::vector<Vector3>& x) {
  Jacobian J{};
  for (std::size_t i = 0; i < x.size(); ++i)
    for (std::size_t a = 0; a < 3; ++a)
      for (std::size_t b = 0; b < 3; ++b) J[a][b] += p.dN[i][a] * x[i][b];
  return J;
}

double determinant(const Jacobian& J) {
  return J[0][0] * (J[1][1] * J[2][2] - J[1][2] * J[2][1]) -
         J[0][1] * (J[1][0] * J[2][2] - J[1][2] * J[2][0]) +
         J[0][2] * (J[1][0] * J[2][1] - J[1][1] * J[2][0]);
}

Jacobian inverse(const Jacobian& J, double det) {
  Jacobian inv;
  for (std::size_t a = 0; a < 3; ++a)
    for (std::size_t b = 0; b < 3; ++b) {
      const std::size_t a1 = (a + 1) % 3, a2 = (a + 2) % 3, b1 = (b + 1) % 3,
                        b2 = (b + 2) % 3;
      inv[b][a] = (J[a1][b1] * J[a2][b2] - J[a1][b2] * J[a2][b1]) / det;
    }
  return inv;
}

double norm(const Jacobian& J) {
  double square = 0;
  for (const Vector3& row : J)
    for (double x : row) square += x * x;
  return std::sqrt(square);
}

/// ∂N/∂x from ∂N/∂ξ.
Vector3 to_global(const Jacobian& inv, const Vector3& d) {
  Vector3 g{};
  for (std::size_t b = 0; b < 3; ++b)
    for (std::size_t a = 0; a < 3; ++a) g[b] += inv[b][a] * d[a];
  return g;
}

/// The six strains of displacement component c with gradient g, engineering shears.
std::array<double, 6> linear_strain(std::size_t c, const Vector3& g) {
  switch (c) {
  case 0:
    return {g[0], 0, 0, g[1], 0, g[2]};
  case 1:
    return {0, g[1], 0, g[0], g[2], 0};
  default:
    return {0, 0, g[2], 0, g[1], g[0]};
  }
}

/// K += w Bᵀ C B for the gradients of all (also incompatible) modes; upper triangle.
/// @param strain  of a displacement component with a gradient.
template <class Strain>
void add_stiffness(Dense& K, const std::vector<Vector3>& gradients,
                   const std::array<double, 36>& C, double w, const Strain& strain) {
  const int n = 3 * static_cast<int>(gradients.size());
  std::vector<std::array<double, 6>> B(as_size(n)), CB(B.size());
  for (std::size_t i = 0; i < B.size(); ++i) {
    B[i] = strain(i % 3, gradients[i / 3]);
    for (std::size_t r = 0; r < 6; ++r) {
      double sum = 0;
      for (std::size_t s = 0; s < 6; ++s) sum += C[6 * r + s] * B[i][s];
      CB[i][r] = w * sum;
    }
  }
  for (int j = 0; j < n; ++j)
    for (int i = 0; i <= j; ++i) {
      double sum = 0;
      for (std::size_t r = 0; r < 6; ++r) sum += B[as_size(i)][r] * CB[as_size(j)][r];
      K(i, j) += sum;
    }
}

void mirror(Dense& a) {
  for (int j = 0; j < a.columns; ++j)
    for (int i = j + 1; i < a.rows; ++i) a(i, j) = a(j, i);
}

/// At a point of the stiffness: weight and Jacobian determinant, and the gradients of all (also
/// incompatible) modes.
struct StiffnessPoint {
  double volume;
  double aspect;
  Vector3 xi;
  std::vector<Vector3> gradients;
};

std::vector<StiffnessPoint> points_of(ElementType type,
                                      const std::vector<Vector3>& nodes) {
  const bool incompatible = type == ElementType::hex8;
  Jacobian center_inverse{};
  double center_det = 0;
  if (incompatible) {
    const Jacobian center = jacobian(shape_at(type, {0, 0, 0}, 0), nodes);
    center_det = determinant(center);
    center_inverse = inverse(center, center_det);
  }
  std::vector<StiffnessPoint> result;
  for (const auto& p : stiffness_points(type)) {
    const Jacobian J = jacobian(p, nodes);
    const double det = determinant(J);
    const Jacobian inv = inverse(J, det);
    StiffnessPoint at{p.weight * det, norm(J) * norm(inv) / 3, p.xi, {}};
    for (const auto& d : p.dN) at.gradients.push_back(to_global(inv, d));
    if (incompatible)
      for (std::size_t a = 0; a < 3;
           ++a) { // gradients of 1 − ξ_a² by the centre's Jacobian
        Vector3 d{};
        d[a] = -2 * p.xi[a] * center_det / det;
        at.gradients.push_back(to_global(center_inverse, d));
      }
    result.push_back(std::move(at));
  }
  return result;
}

double von_mises(const std::array<double, 6>& s) {
  const double xy = s[0] - s[1], yz = s[1] - s[2], zx = s[2] - s[0];
  return std::sqrt(0.5 * (xy * xy + yz * yz + zx * zx) +
                   3 * (s[3] * s[3] + s[4] * s[4] + s[5] * s[5]));
}

const SolidMaterial& at_point(const SolidMaterials& materials, std::size_t p) {
  return materials[materials.size() > 1 ? p : 0];
}

/// Mass of the scalar functions N (and, for Hex8, of the incompatible modes 1 − ξ_a²
/// behind them).
Dense scalar_mass(const std::vector<ShapePoint>& points,
                  const std::vector<Vector3>& nodes, double density, bool incompatible,
                  ElementMatrices& element, std::pair<double, double>& det_range) {
  const int n = static_cast<int>(nodes.size()) + (incompatible ? 3 : 0);
  Dense mass(n, n);
  for (const auto& p : points) {
    const double det = determinant(jacobian(p, nodes));
    det_range = {std::min(det_range.first, det), std::max(det_range.second, det)};
    const double w = p.weight * det * density;
    element.mass += w;
    std::vector<double> N = p.N;
    if (incompatible)
      for (double xi : p.xi) N.push_back(1 - xi * xi);
    for (int j = 0; j < n; ++j)
      for (int i = 0; i < n; ++i) mass(i, j) += w * N[as_size(i)] * N[as_size(j)];
  }
  return mass;
}

/// The same mass for each of the three displacement components; the first `count`
/// functions.
Dense three_components(const Dense& mass, int count) {
  Dense M(3 * count, 3 * count);
  for (int j = 0; j < count; ++j)
    for (int i = 0; i < count; ++i)
      for (int c = 0; c < 3; ++c) M(3 * i + c, 3 * j + c) = mass(i, j);
  return M;
}

} // namespace

int node_count(ElementType type) { return facts_of(type).nodes; }
int dofs_per_node(ElementType type) { return facts_of(type).dofs; }
const char* element_name(ElementType type) { return facts_of(type).name; }

ElementType element_type(const std::string& name) {
  std::vector<std::string> known;
  for (std::size_t i = 0; i <= as_size(ElementType::beam2); ++i) {
    if (name == facts[i].name) return static_cast<ElementType>(i);
    known.emplace_back(facts[i].name);
  }
  throw Error(text("element type %s is not known; there are %s", name.c_str(),
                   join(known).c_str()));
}

ElementMatrices solid_matrices(ElementType type, const std::vector<Vector3>& nodes,
                               const SolidMaterials& material, MassRule mass_rule,
                               bool with_stiffness) {
  const int n = static_cast<int>(nodes.size());
  const bool incompatible = type == ElementType::hex8;
  const auto& k_points = stiffness_points(type);
  ElementMatrices result;
  std::pair<double, double> det{std::numeric_limits<double>::max(),
                                std::numeric_limits<double>::lowest()};
  const Dense mass =
      scalar_mass(mass_rule == MassRule::full ? mass_points(type) : k_points, nodes,
                  material.front().density, incompatible, result, det);
  for (const auto& p : k_points) {
    const double d = determinant(jacobian(p, nodes));
    det = {std::min(det.first, d), std::max(det.second, d)};
  }
  result.min_detJ = det.first;
  result.shape_ratio = det.second > 0 ? det.first / det.second : -1;
  if (!with_stiffness || det.first <= 0) {
    result.M = three_components(mass, n);
    return result;
  }

  result.M = three_components(mass, mass.rows);
  result.K = Dense(result.M.rows, result.M.rows);
  const auto points = points_of(type, nodes);
  for (std::size_t p = 0; p < points.size(); ++p) {
    const StiffnessPoint& at = points[p];
    result.aspect = std::max(result.aspect, at.aspect);
    add_stiffness(result.K, at.gradients, at_point(material, p).stiffness, at.volume,
                  linear_strain);
  }
  mirror(result.K);
  if (incompatible) {
    result.T = condensation(result.K, 3 * (mass.rows - n));
    result.K = condensed(result.K, result.T);
    result.M_0 = std::move(result.M); // sees the incompatible modes move as well
    result.M = condensed(result.M_0, result.T);
  }
  return result;
}

namespace {

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

namespace {

/// ∫ρ NᵀDN of a 3×3 matrix D.
Dense mass_of_directions(const ElementMatrices& element, const Dense& D) {
  const bool condenses = !element.T.data.empty();
  const Dense& M = condenses ? element.M_0 : element.M;
  Dense each(M.rows, M.rows);
  for (int i = 0; i < M.rows; i += 3) set_part(each, i, i, D);
  const Dense result = multiply(M, each);
  return condenses ? multiply_transposed(element.T, multiply(result, element.T)) : result;
}

} // namespace

Dense solid_spin_softening(const ElementMatrices& element, const Vector3& axis) {
  Dense across(3, 3);
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 3; ++j)
      across(i, j) = (i == j) - axis[as_size(i)] * axis[as_size(j)];
  Dense S = mass_of_directions(element, across);
  symmetrise(S);
  return S;
}

Dense solid_coriolis(const ElementMatrices& element, const Vector3& axis) {
  Dense turned(3, 3);
  for (int i = 0; i < 3; ++i) { // 2 [axis ×]
    const int next = (i + 1) % 3, last = (i + 2) % 3;
    turned(next, last) = -2 * axis[as_size(i)];
    turned(last, next) = 2 * axis[as_size(i)];
  }
  Dense G = mass_of_directions(element, turned);
  symmetrise(G, Symmetry::skew);
  return G;
}

} // namespace flexgram
