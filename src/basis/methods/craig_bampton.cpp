/// craig_bampton: constraint modes and fixed-interface modes (Craig, Bampton 1968).

#include "basis/method.hpp"

#include "base/index.hpp"
#include "base/text.hpp"
#include "linalg/decompositions.hpp"

#include <algorithm>

namespace flexgram {
namespace {

/// Statics of a free body under port loads in equilibrium.
Dense free_statics(const Elastic& e, const Dense& ports) {
  const Dense resultants = part_of(ports, 0, e.rigid, 0, ports.columns);
  const SymmetricEigen eigen =
      symmetric_eigen(multiply_transposed(resultants, resultants));
  const double floor = 1e-12 * std::max(eigen.values.back(), 1e-300);
  int balanced_loads = 0;
  while (balanced_loads < eigen.vectors.columns &&
         eigen.values[as_size(balanced_loads)] <= floor)
    ++balanced_loads;
  return multiply(e.statics(), first_columns(eigen.vectors, balanced_loads));
}

/// N − Z (ZᵀKZ)⁻¹ZᵀK N: the rest of the body follows unit motions N of the interfaces, by
/// the modes U of the body held there. The first `soft` of these, which may move without
/// stiffness, do not follow: they are to be basis vectors themselves, which spans the
/// same. (On soft mounts the inverse of K would show one motion only.)
Dense held_statics(const Dense& K, const Dense& N, const Dense& Z,
                   const DenseResponse& held, int soft) {
  if (Z.columns == soft) return N;
  const Dense modes =
      multiply(Z, part_of(held.U(), 0, Z.columns, soft, Z.columns - soft));
  Dense force = multiply_transposed(modes, multiply(K, N));
  for (int j = 0; j < force.columns; ++j)
    for (int i = 0; i < force.rows; ++i) // in modal coordinates K is 1 − τμ
      force(i, j) /= 1 - held.tau() * held.mu()[as_size(soft + i)];
  const Dense follows = multiply(modes, force);
  Dense statics = N;
  for (std::size_t i = 0; i < statics.data.size(); ++i)
    statics.data[i] -= follows.data[i];
  return statics;
}

/// Constraint modes (statics under unit motion of the interfaces, rigid modes among
/// them), then the modes of the body whose interfaces are held. All of it is response to
/// port loads, so the medium space holds it as exactly as H.
Candidate make(const SecondStage& stage) {
  const Elastic e(stage);
  const DenseSystem& all = stage.medium.system;
  const Dense ports = all_ports(all), span = nested_span(ports);

  // Coordinates without motion of the ports.
  const SymmetricEigen eigen = symmetric_eigen(multiply(span, transpose(span)));
  int held = 0; // projector onto the ports' span: eigenvalues 0 and 1
  while (held < e.N && eigen.values[as_size(held)] < 0.5) ++held;
  const Dense Z = first_columns(eigen.vectors, held);
  const DenseResponse fixed(all.project(Z), stage.medium.tau);
  const Dense fixed_interface_modes = multiply(Z, fixed.U());

  // Modes of the held body without stiffness, or so little that it could be rounding:
  // which of them is counted as soft does not change the span.
  int soft = 0;
  while (e.rigid == 0 && soft < held &&
         1 - fixed.tau() * fixed.mu()[as_size(soft)] < 1e-6)
    ++soft;
  const Dense constraint =
      nested_span(e.rigid == 0 ? held_statics(all.K, span, Z, fixed, soft)
                               : after_rigid(free_statics(e, ports), e.rigid, e.N));
  Candidate c = nested(nested_span(beside(constraint, fixed_interface_modes)),
                       constraint.columns + soft);
  int below = 0;
  const double cutoff = stage.medium.cutoff * stage.medium.cutoff;
  for (double l : fixed.lambda()) below += l < cutoff;
  c.remark = text("%d constraint modes, %d fixed-interface modes below the cutoff",
                  constraint.columns, below);
  return c;
}

int all_of_it(const Candidate& candidate, const SecondStage&) { return candidate.most; }

} // namespace

extern const Method craig_bampton_method;
const Method craig_bampton_method{"constraint and fixed-interface modes", make,
                                  all_of_it};

} // namespace flexgram
