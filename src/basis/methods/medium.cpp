/// medium: the medium model as it is, the first step of Fehr, Eberhard, Lehner, section 2.3.

#include "basis/method.hpp"

namespace flexgram {
namespace {

Candidate make(const SecondStage& stage) {
  return nested(identity(stage.medium.system.order()), stage.medium.system.order());
}

int all_of_it(const Candidate& candidate, const SecondStage&) { return candidate.most; }

} // namespace

extern const Method medium_method;
const Method medium_method{"all of the medium model", make, all_of_it};

} // namespace flexgram
