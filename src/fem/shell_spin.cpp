#include "base/error.hpp"
#include "fem/shell_kinematics.hpp"
#include "fem/vectors.hpp"

namespace flexgram {
namespace {

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
