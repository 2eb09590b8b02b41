/// gramian: eigenvectors of the position Gramian over the band, the second step of the
/// paper (Fehr, Eberhard, Lehner, section 2.3, eqs. 8 and 11).

#include "basis/method.hpp"

namespace flexgram {
namespace {

Candidate make(const SecondStage& stage) {
  return gramian_candidate(stage, {1 + stage.others.size(), stage.bands});
}

} // namespace

extern const Method gramian_method;
const Method gramian_method{"position Gramian over the band, the paper", make};

} // namespace flexgram
