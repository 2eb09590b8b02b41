/// whole_axis: the position Gramian over all frequencies (Fehr, Eberhard, Lehner, eq. 5).

#include "basis/method.hpp"

#include <algorithm>

namespace flexgram {
namespace {

Candidate make(const SecondStage& stage) { return whole_axis_candidate(stage); }

/// The eigenvalues are those of the elastic part.
int beside_rigid(const Candidate& candidate, const SecondStage& stage) {
  return std::clamp(stage.medium.rigid + order_by_rule(candidate.sigma), candidate.least,
                    candidate.most);
}

} // namespace

extern const Method whole_axis_method;
const Method whole_axis_method{"position Gramian over all frequencies", make,
                               beside_rigid};

} // namespace flexgram
