#include "base/error.hpp"
#include "fem/condensation.hpp"
#include "fem/shape_functions.hpp"
#include "fem/shell_kinematics.hpp"

#include <algorithm>
#include <array>
#include <cmath>

namespace flexgram {

namespace {

/// Temperature and its slope along the normal at a point of the stiffness: 2 × 1.
Dense heat_at(const ShapePoint& at, const FreeStrain& free) {
  Dense heat(2, 1);
  for (std::size_t a = 0; a < at.N.size(); ++a) {
    if (!free.temperature.empty()) heat(0, 0) += at.N[a] * free.temperature[a];
    if (!free.gradient.empty()) heat(1, 0) += at.N[a] * free.gradient[a];
  }
  return heat;
}

/// A shell whose nodes are displaced; its internal dofs follow.
struct DisplacedShell {
  /// @param held  stress resultants that hold strains without stress back, at the points.
  DisplacedShell(ElementType type, const std::vector<Vector3>& nodes, const ShellLaw& law,
                 const ShellPlace& place, const std::vector<double>& u,
                 const std::vector<Dense>& held = {}) {
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
    if (held.empty()) return;
    load = Dense(K.rows, 1);
    for (std::size_t p = 0; p < points.size(); ++p)
      add_to(load, multiply_transposed(points[p].stretch, held[p]), points[p].area);
    add_to(moved, internal_response(K, shape.dofs() - static_cast<int>(u.size()), load));
    load = multiply_transposed(T, load);
  }

  std::vector<ShellStrain> points;
  Dense T, moved;
  Dense load = {}; ///< that of strains without stress at the nodes; empty: there are none
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

double von_mises(const Dense& s) {
  return std::sqrt(s(0, 0) * s(0, 0) - s(0, 0) * s(1, 0) + s(1, 0) * s(1, 0) +
                   3 * s(2, 0) * s(2, 0));
}

/// Stress of a layer at a height, of that of the middle surface's strain and of its curvature.
/// @param heat  temperature and its slope; empty: none.
Dense layer_stress(const ShellLayer& layer, const Dense& strain, const Dense& heat,
                   double stretched, double height) {
  Dense local(3, 1);
  for (int i = 0; i < 3; ++i)
    local(i, 0) = stretched * strain(i, 0) + height * strain(3 + i, 0);
  if (!heat.data.empty())
    add_to(local, heat_strain(layer), -(stretched * heat(0, 0) + height * heat(1, 0)));
  return multiply(plane_stress(layer), local);
}

/// The largest von Mises stress at the sides of layers [N/m²].
double face_stress(const std::vector<ShellLayer>& layers, const Dense& strain,
                   const Dense& heat) {
  double most = 0, thickness = 0;
  if (layers.front().role != ShellRole::all) { // what stretches and what bends, together
    const ShellLayer &stretches = layers.front(), &bends = layers[1];
    for (const double height : bends.sides) {
      Dense stress = layer_stress(stretches, strain, heat, 1, 0);
      add_to(stress, layer_stress(bends, strain, heat, 0, height));
      most = std::max(most, von_mises(stress));
    }
    return most;
  }
  for (const ShellLayer& layer : layers) thickness += layer.thickness;
  double z = -0.5 * thickness;
  for (const ShellLayer& layer : layers) {
    for (const double height : {z, z + layer.thickness})
      most = std::max(most, von_mises(layer_stress(layer, strain, heat, 1, height)));
    z += layer.thickness;
  }
  return most;
}

} // namespace

StressStiffness shell_stress_stiffness(ElementType type,
                                       const std::vector<Vector3>& nodes,
                                       const std::vector<ShellLayer>& layers,
                                       const ShellPlace& place,
                                       const std::vector<double>& u,
                                       const FreeStrain* free, Deformation& deformation) {
  const ShellLaw law = shell_law(layers);
  std::vector<Dense> heat, held;
  if (free) {
    const Dense by_heat = heat_resultants(layers);
    for (const ShapePoint& at : stiffness_points(type)) {
      heat.push_back(heat_at(at, *free));
      held.push_back(multiply(by_heat, heat.back()));
    }
  }
  const DisplacedShell shell(type, nodes, law, place, u, held);
  const int all = shell.moved.rows;
  Dense K(all, all), quadratic(all, all);
  std::vector<Dense> turned; // strains that slopes add, times two
  Dense mean(3, 1);
  double area = 0;
  for (std::size_t p = 0; p < shell.points.size(); ++p) {
    const ShellStrain& at = shell.points[p];
    const Dense strain = multiply(at.stretch, shell.moved);
    Dense resultants = multiply(law.ABD, strain);
    if (free) add_to(resultants, held[p], -1);
    const Dense sheared = multiply(at.shear, shell.moved),
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
    deformation.stress = std::max(deformation.stress,
                                  face_stress(layers, strain, free ? heat[p] : Dense()));
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
  return {condensed(K, shell.T), condensed(quadratic, shell.T), shell.load};
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
