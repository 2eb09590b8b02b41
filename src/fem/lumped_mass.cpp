#include "fem/lumped_mass.hpp"

#include "base/index.hpp"
#include "fem/discrete.hpp"

namespace flexgram {

std::vector<PointMass> nodal_masses(const ElementMatrices& element, int nodes,
                                    const std::vector<Vector3>& arms) {
  const int dofs = element.M.rows / nodes;
  std::vector<PointMass> masses(as_size(nodes));
  double sum = 0;
  for (int a = 0; a < nodes; ++a) {
    for (int c = 0; c < 3; ++c)
      masses[as_size(a)].mass += element.M(dofs * a + c, dofs * a + c);
    sum += masses[as_size(a)].mass;
    if (!arms.empty()) masses[as_size(a)].offset = arms[as_size(a)];
  }
  for (PointMass& one : masses) one.mass *= sum > 0 ? element.mass / sum : 0;
  return masses;
}

Dense blocks_of(const std::vector<PointMass>& masses,
                const std::function<Dense(const PointMass&)>& matrix) {
  Dense all;
  int a = 0;
  for (const PointMass& one : masses) {
    const Dense own = matrix(one);
    const bool is_square = own.rows == own.columns;
    const int count = static_cast<int>(masses.size());
    if (a == 0)
      all = Dense(own.rows * count, is_square ? own.columns * count : own.columns);
    set_part(all, own.rows * a, is_square ? own.columns * a : 0, own);
    ++a;
  }
  return all;
}

void lump(ElementMatrices& element, const std::vector<PointMass>& masses) {
  if (element.M.rows == 6 * static_cast<int>(masses.size())) {
    element.M = blocks_of(masses, mass_matrix);
    element.beside = blocks_of(masses, mass_beside);
    return;
  }
  element.M = Dense(element.M.rows, element.M.rows);
  for (int i = 0; i < element.M.rows; ++i) element.M(i, i) = masses[as_size(i / 3)].mass;
  element.M_0 = element.T = Dense();
}

} // namespace flexgram
