/// whole_axis: the position Gramian over all frequencies (Fehr, Eberhard, Lehner, eq. 5).

#include "basis/method.hpp"

namespace flexgram {
namespace {

Candidate make(const SecondStage& stage) { return whole_axis_candidate(stage); }

} // namespace

extern const Method whole_axis_method;
const Method whole_axis_method{"position Gramian over all frequencies", make};

} // namespace flexgram
