#include "fem/membrane.hpp"

#include "base/error.hpp"
#include "base/index.hpp"
#include "fem/condensation.hpp"
#include "fem/shell_kinematics.hpp"

namespace flexgram {
namespace {

/// Strains of the middle surface over displacements of the nodes, and internal ones behind them;
/// curvatures are zero.
Dense stretch_of(const ShellStrain& at, int nodes, int internal) {
  Dense stretch(6, 3 * nodes + internal);
  for (int r = 0; r < 3; ++r) {
    for (int dof = 0; dof < 3 * nodes; ++dof)
      stretch(r, dof) = at.stretch(r, 6 * (dof / 3) + dof % 3);
    for (int k = 0; k < internal; ++k)
      stretch(r, 3 * nodes + k) = at.stretch(r, 6 * nodes + k);
  }
  return stretch;
}

/// Internal dofs; those of a triangle bend alone.
int internal_dofs(const ShellShape& shape) {
  const int nodes = static_cast<int>(shape.normals.size());
  return nodes == 4 ? shape.dofs() - 6 * nodes : 0;
}

/// K over all dofs.
Dense whole_stiffness(const ShellShape& shape, const ShellLaw& law,
                      const ShellPlace& place) {
  const int nodes = static_cast<int>(shape.normals.size()),
            internal = internal_dofs(shape);
  Dense K(3 * nodes + internal, 3 * nodes + internal);
  for (const ShellStrain& at : shape.strains(place)) {
    const Dense stretch = stretch_of(at, nodes, internal);
    add_to(K, multiply_transposed(stretch, multiply(law.ABD, stretch)), at.area);
  }
  symmetrise(K);
  return K;
}

Dense condensation_of(const Dense& K, std::size_t nodes) {
  return condensation(K, K.rows - 3 * static_cast<int>(nodes));
}

} // namespace

bool is_membrane(ElementType type) {
  return type == ElementType::membrane3 || type == ElementType::membrane4;
}

ElementType surface_of(ElementType type) {
  if (type == ElementType::membrane3) return ElementType::tri3;
  return type == ElementType::membrane4 ? ElementType::quad4 : type;
}

Dense of_displacements(const Dense& six) {
  Dense three(six.rows / 2, six.rows / 2);
  for (int j = 0; j < three.rows; ++j)
    for (int i = 0; i < three.rows; ++i)
      three(i, j) = six(6 * (i / 3) + i % 3, 6 * (j / 3) + j % 3);
  return three;
}

Dense displacements_of(const Dense& six) {
  Dense three(six.rows / 2, six.columns);
  for (int i = 0; i < three.rows && three.columns > 0; ++i)
    three(i, 0) = six(6 * (i / 3) + i % 3, 0);
  return three;
}

std::vector<double> with_rotations(const std::vector<double>& u) {
  std::vector<double> six(2 * u.size());
  for (std::size_t i = 0; i < u.size(); ++i) six[6 * (i / 3) + i % 3] = u[i];
  return six;
}

ElementMatrices membrane_matrices(ElementType type, const std::vector<Vector3>& nodes,
                                  const ShellLaw& law, const ShellPlace& place,
                                  bool with_stiffness) {
  if (place.offset != 0)
    throw Error("a membrane has no offset: put the nodes into its surface");
  ElementMatrices result;
  const ShellShape shape(surface_of(type), nodes);
  result.min_detJ = shape.least_det;
  result.shape_ratio = shape.least_det / shape.most_det;
  result.aspect = shape.size / law.thickness;
  if (!(shape.least_det > 0)) return result;
  const int n = 6 * static_cast<int>(nodes.size());
  Dense M(n, n);
  for (const ShellPoint& at : shape.mass_points()) {
    result.mass += at.area * law.mass;
    add_to(M, multiply_transposed(at.moved, at.moved), at.area * law.mass);
  }
  result.M = of_displacements(M);
  symmetrise(result.M);
  if (!with_stiffness) return result;
  const Dense K = whole_stiffness(shape, law, place);
  result.K = condensed_stiffness(K, K.rows - 3 * static_cast<int>(nodes.size()));
  return result;
}

std::vector<ShellStrainPoint> membrane_strains(ElementType type,
                                               const std::vector<Vector3>& nodes,
                                               const ShellLaw& law,
                                               const ShellPlace& place) {
  const ShellShape shape(surface_of(type), nodes);
  const Dense T = condensation_of(whole_stiffness(shape, law, place), nodes.size());
  std::vector<ShellStrainPoint> points;
  for (const ShellStrain& at : shape.strains(place)) {
    const Dense stretch =
        stretch_of(at, static_cast<int>(nodes.size()), internal_dofs(shape));
    points.push_back({at.area, multiply(stretch, T), at.axes});
  }
  return points;
}

HeldShell hold_membrane(ElementType type, const std::vector<Vector3>& nodes,
                        const ShellLaw& law, const ShellPlace& place,
                        const std::vector<Dense>& resultants) {
  const ShellShape shape(surface_of(type), nodes);
  std::vector<Dense> stretch;
  std::vector<double> area;
  for (const ShellStrain& at : shape.strains(place)) {
    stretch.push_back(
        stretch_of(at, static_cast<int>(nodes.size()), internal_dofs(shape)));
    area.push_back(at.area);
  }
  return hold(whole_stiffness(shape, law, place), internal_dofs(shape), stretch, area,
              resultants);
}

Dense membrane_part_stiffness(ElementType type, const std::vector<Vector3>& nodes,
                              const ShellLaw& law, const ShellLaw& part,
                              const ShellPlace& place) {
  const ShellShape shape(surface_of(type), nodes);
  const Dense T = condensation_of(whole_stiffness(shape, law, place), nodes.size());
  return condensed(whole_stiffness(shape, part, place), T);
}

} // namespace flexgram
