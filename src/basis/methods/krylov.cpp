/// krylov: moments of the response at given frequencies (Fehr, Eberhard, Lehner,
/// section 2.3).

#include "basis/method.hpp"

#include "base/index.hpp"
#include "base/text.hpp"

#include <algorithm>
#include <cmath>

namespace flexgram {
namespace {

/// (K − s_k M)⁻¹[M(K − s_k M)⁻¹]^j B, j = 0 … moments − 1, for all shifts: moment after
/// moment.
Candidate make(const SecondStage& stage) {
  const Elastic e(stage);
  const bool apart = stage.keep_rigid && e.rigid > 0;
  const DenseResponse all(stage.medium.system, stage.medium.tau);
  const DenseResponse& response = apart ? e.response : all;
  Dense columns(response.system().order(), 0);
  for (int j = 0; j < stage.moments; ++j)
    for (double omega : stage.shifts) {
      Dense block = response.modal_inputs();
      for (int i = 0; i < block.rows; ++i) {
        const double mu = response.mu()[as_size(i)];
        const double a = 1 - (response.tau() + omega * omega) * mu;
        const double factor = std::pow(mu / a, j) / a;
        for (int p = 0; p < block.columns; ++p) block(i, p) *= factor;
      }
      columns = beside(columns, multiply(response.U(), block));
    }
  const Dense span = nested_span(columns);
  Candidate c =
      apart ? nested(after_rigid(span, e.rigid, e.N), e.rigid + 1) : nested(span);
  c.rigid_first = apart;
  c.remark = text("%zu shifts, %d moments", stage.shifts.size(), stage.moments);
  return c;
}

int all_of_it(const Candidate& candidate, const SecondStage&) { return candidate.most; }

Demand up_to_the_last_shift(int, const std::vector<double>& shifts) {
  return {0, shifts.empty() ? 0.0 : *std::max_element(shifts.begin(), shifts.end())};
}

} // namespace

extern const Method krylov_method;
const Method krylov_method{"moments at the expansion points", make, all_of_it,
                           up_to_the_last_shift};

} // namespace flexgram
