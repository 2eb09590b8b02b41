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
  const bool has_roles = layers.front().role != ShellRole::all;
  for (const ShellLayer& layer : layers) thickness += layer.thickness;
  double z = -0.5 * (has_roles ? layers.front().thickness : thickness);
  for (const ShellLayer& layer : layers) {
    if (has_roles && layer.role != ShellRole::stretching) continue;
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

} // namespace flexgram
