#include "base/error.hpp"
#include "fem/condensation.hpp"
#include "fem/shell_kinematics.hpp"

#include <algorithm>
#include <array>
#include <cmath>

namespace flexgram {

namespace {

/// A shell whose nodes are displaced; its internal dofs follow.
struct DisplacedShell {
  DisplacedShell(ElementType type, const std::vector<Vector3>& nodes, const ShellLaw& law,
                 const ShellPlace& place, const std::vector<double>& u) {
    if (place.offset != 0)
      throw Error("a shell whose middle surface is not at its nodes (offset) takes no "
                  "preload and no spin: put the nodes into the middle surface");
    const ShellShape shape(type, nodes);
    points = shape.strains(place);
    const Dense K = shell_stiffness(shape, points, law);
    T = condensation(K, shape.dofs() - static_cast<int>(u.size()));
    moved = Dense(static_cast<int>(u.size()), 1);
    moved.data = u;
    moved = multiply(T, moved);
  }

  std::vector<ShellStrain> points;
  Dense T, moved;
};

/// sᵀ(N ⊗ I)s of the slopes s.
void add_geometric(Dense& K, const ShellStrain& at, const Dense& resultants) {
  Dense N(6, 6);
  for (int c = 0; c < 3; ++c) {
    N(c, c) = resultants(0, 0);
    N(3 + c, 3 + c) = resultants(1, 0);
    N(c, 3 + c) = N(3 + c, c) = resultants(2, 0);
  }
  add_to(K, multiply_transposed(at.slope, multiply(N, at.slope)), at.area);
}

/// The largest von Mises stress at the sides of layers [N/m²].
double face_stress(const std::vector<ShellLayer>& layers, const Dense& strain) {
  double most = 0, thickness = 0;
  for (const ShellLayer& layer : layers) thickness += layer.thickness;
  double z = -0.5 * thickness;
  for (const ShellLayer& layer : layers) {
    const Dense Q = plane_stress(layer);
    for (const double height : {z, z + layer.thickness}) {
      double s[3] = {};
      for (int i = 0; i < 3; ++i)
        for (int j = 0; j < 3; ++j)
          s[i] += Q(i, j) * (strain(j, 0) + height * strain(3 + j, 0));
      most = std::max(
          most, std::sqrt(s[0] * s[0] - s[0] * s[1] + s[1] * s[1] + 3 * s[2] * s[2]));
    }
    z += layer.thickness;
  }
  return most;
}

} // namespace

StressStiffness
shell_stress_stiffness(ElementType type, const std::vector<Vector3>& nodes,
                       const std::vector<ShellLayer>& layers, const ShellPlace& place,
                       const std::vector<double>& u, Deformation& deformation) {
  const ShellLaw law = shell_law(layers);
  const DisplacedShell shell(type, nodes, law, place, u);
  const int all = shell.moved.rows;
  Dense K(all, all), quadratic(all, all);
  std::vector<Dense> turned; // strains that slopes add, times two
  Dense mean(3, 1);
  double area = 0;
  for (const ShellStrain& at : shell.points) {
    const Dense strain = multiply(at.stretch, shell.moved),
                resultants = multiply(law.ABD, strain),
                sheared = multiply(at.shear, shell.moved),
                slope = multiply(at.slope, shell.moved);
    add_geometric(K, at, resultants);
    // Strains of the moved surface: those at rest, L, and N by its slopes.
    double w[2] = {};
    Dense across(2, all);
    for (int i = 0; i < 3; ++i)
      for (int a = 0; a < 2; ++a) {
        const double n = at.normal[as_size(i)];
        w[a] += n * slope(3 * a + i, 0);
        for (int j = 0; j < all; ++j) across(a, j) += n * at.slope(3 * a + i, j);
      }
    Dense N(6, all);
    for (int j = 0; j < all; ++j) {
      N(0, j) = w[0] * across(0, j);
      N(1, j) = w[1] * across(1, j);
      N(2, j) = w[0] * across(1, j) + w[1] * across(0, j);
    }
    const Dense both = multiply_transposed(N, multiply(law.ABD, at.stretch));
    add_to(K, both, at.area);
    add_to(K, transpose(both), at.area);
    add_to(quadratic, multiply_transposed(N, multiply(law.ABD, N)), at.area);
    deformation.stress = std::max(deformation.stress, face_stress(layers, strain));
    deformation.energy +=
        at.area * (multiply_transposed(strain, resultants)(0, 0) +
                   multiply_transposed(sheared, multiply(law.shear, sheared))(0, 0));
    turned.emplace_back(3, 1);
    turned.back().data = {w[0] * w[0], w[1] * w[1], 2 * w[0] * w[1]};
    add_to(mean, turned.back(), at.area);
    area += at.area;
  }
  const Dense A = part_of(law.ABD, 0, 3, 0, 3);
  for (std::size_t p = 0; p < turned.size(); ++p) {
    add_to(turned[p], mean, -1 / area);
    deformation.locked += shell.points[p].area *
                          multiply_transposed(turned[p], multiply(A, turned[p]))(0, 0);
  }
  return {condensed(K, shell.T), condensed(quadratic, shell.T)};
}

Dense shell_geometric_stiffness(ElementType type, const std::vector<Vector3>& nodes,
                                const ShellLaw& law, const ShellPlace& place,
                                const std::vector<double>& u) {
  const DisplacedShell shell(type, nodes, law, place, u);
  Dense K(shell.moved.rows, shell.moved.rows);
  for (const ShellStrain& at : shell.points)
    add_geometric(K, at, multiply(law.ABD, multiply(at.stretch, shell.moved)));
  return condensed(K, shell.T);
}

namespace {

Dense cross_matrix(const Vector3& a) {
  Dense W(3, 3);
  for (int i = 0; i < 3; ++i) {
    const int next = (i + 1) % 3, last = (i + 2) % 3;
    W(last, next) = a[as_size(i)];
    W(next, last) = -a[as_size(i)];
  }
  return W;
}

/// ∫ of (moved + z turned)ᵀ D (moved + z turned) ρ over a shell's thickness.
Dense mass_of_directions(const ShellPoint& at, const Dense& D, const ShellLaw& law) {
  const Dense by_moved = multiply(D, at.moved), by_turned = multiply(D, at.turned);
  Dense result = multiply_transposed(at.moved, by_moved);
  for (double& x : result.data) x *= law.mass;
  add_to(result, multiply_transposed(at.moved, by_turned), law.first);
  add_to(result, multiply_transposed(at.turned, by_moved), law.first);
  add_to(result, multiply_transposed(at.turned, by_turned), law.second);
  return result;
}

} // namespace

Dense shell_coriolis(ElementType type, const std::vector<Vector3>& nodes,
                     const ShellLaw& law, const ShellPlace& place, const Vector3& axis) {
  return with_offset(type, nodes, place, [&](const ShellShape& shape) {
    const Dense W = cross_matrix(axis);
    const int n = 6 * static_cast<int>(nodes.size());
    Dense G(n, n);
    for (const ShellPoint& at : shape.mass_points())
      add_to(G, mass_of_directions(at, W, law), 2 * at.area);
    symmetrise(G, Symmetry::skew);
    return G;
  });
}

Dense shell_spin_softening(ElementType type, const std::vector<Vector3>& nodes,
                           const ShellLaw& law, const ShellPlace& place,
                           const Vector3& axis) {
  if (place.offset != 0 || law.first != 0)
    throw Error(
        "a shell whose mass is not at its nodes (offset, layers) takes no spin: put "
        "the nodes into the middle surface");
  const ShellShape shape(type, nodes);
  Dense P(3, 3);
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 3; ++j) P(i, j) = (i == j) - axis[as_size(i)] * axis[as_size(j)];
  const int n = 6 * static_cast<int>(nodes.size());
  Dense S(n, n);
  for (const ShellPoint& at : shape.mass_points()) {
    add_to(S, mass_of_directions(at, P, law), at.area);
    // Lines turned by finite angles: θᵀ(½(PJ + JP) − tr(PJ) I)θ, J = ∫ρz² nnᵀ.
    Dense second(3, 3), Pn(3, 1);
    double trace = 0;
    for (int i = 0; i < 3; ++i)
      for (int j = 0; j < 3; ++j) Pn(i, 0) += P(i, j) * at.normal[as_size(j)];
    for (int i = 0; i < 3; ++i) trace += Pn(i, 0) * at.normal[as_size(i)];
    for (int i = 0; i < 3; ++i)
      for (int j = 0; j < 3; ++j)
        second(i, j) =
            0.5 * (Pn(i, 0) * at.normal[as_size(j)] + at.normal[as_size(i)] * Pn(j, 0)) -
            (i == j) * trace;
    add_to(S, multiply_transposed(at.rotation, multiply(second, at.rotation)),
           at.area * law.second);
  }
  symmetrise(S);
  return S;
}

} // namespace flexgram
