/// balanced: position-velocity balancing (Reis, Stykel 2008), kept symmetric.
///
/// For symmetric M, D, K and C = Bᵀ the velocity observability Gramian of the
/// first-order form [−K 0; 0 M] x' = [0 −K; −K −D] x + [0; B] u equals the position
/// controllability Gramian: with the load on the first equation instead, v = A(s)⁻¹B. So
/// position-velocity balancing (Reis, Stykel 2008) is the position Gramian over the whole
/// axis in the mass inner product. Only where C ≠ Bᵀ it is something of its own.

#include "basis/method.hpp"
#include "linalg/decompositions.hpp"

#include <algorithm>

namespace flexgram {
namespace {

/// Pairs of right and left vectors of Z_CᵀM Z_B, taken together so that the small body
/// stays symmetric.
Candidate make(const SecondStage& stage) {
  if (stage.medium.system.outputs_are_inputs) {
    SecondStage in_mass = stage;
    in_mass.gram = stage.medium.system.M;
    for (std::size_t i = 0; i < in_mass.gram.data.size(); ++i) // where M is singular
      in_mass.gram.data[i] += stage.medium.kappa * stage.medium.system.K.data[i];
    Candidate c = whole_axis_candidate(in_mass);
    c.remark = "equal to whole_axis in the mass inner product, since C = Bᵀ";
    return c;
  }
  const Elastic e(stage);
  DenseSystem dual = e.system;
  std::swap(dual.B, dual.C);
  const Dense Z_B = whole_axis_factor(e.response, stage.equal_ports);
  const Dense Z_C =
      whole_axis_factor(DenseResponse(dual, stage.medium.tau), stage.equal_ports);
  const Dense product = multiply_transposed(Z_C, multiply(e.system.M, Z_B));
  const LeftSvd left = left_svd(product), right = left_svd(transpose(product));
  const Dense T_B = multiply(Z_B, right.vectors), T_C = multiply(Z_C, left.vectors);
  Dense pairs(e.count, 0);
  for (int j = 0; j < std::min(T_B.columns, T_C.columns) && pairs.columns + 2 <= e.count;
       ++j) {
    for (const Dense* T : {&T_B, &T_C}) {
      Dense column = part_of(*T, 0, e.count, j, 1);
      const double size = frobenius_norm(column);
      for (double& x : column.data) x /= size > 0 ? size : 1;
      pairs = beside(pairs, column);
    }
  }
  Candidate c = nested(after_rigid(orthonormal_columns(std::move(pairs)), e.rigid, e.N),
                       e.rigid + 1);
  for (double s : left.values) c.sigma.push_back(s);
  return c;
}

/// Each singular value stands for a vector, or for a pair of them.
int beside_rigid(const Candidate& candidate, const SecondStage& stage) {
  const int each = stage.medium.system.outputs_are_inputs ? 1 : 2;
  return std::clamp(stage.medium.rigid + each * order_by_rule(candidate.sigma),
                    candidate.least, candidate.most);
}

} // namespace

extern const Method balanced_method;
const Method balanced_method{"position-velocity balancing", make, beside_rigid};

} // namespace flexgram
