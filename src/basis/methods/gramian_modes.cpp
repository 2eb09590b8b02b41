/// gramian_modes: the modes of the band, then eigenvectors of the position Gramian of
/// what they leave (modal truncation completed by Fehr, Eberhard, Lehner, eq. 8).

#include "basis/method.hpp"

namespace flexgram {
namespace {

Candidate make(const SecondStage& stage) {
  const Elastic e(stage);
  const double last = stage.bands.back().omega.back();
  int in_band = 0;
  for (double l : stage.medium.lambda) in_band += l <= last * last;
  Dense F = gramian_factor(e.response, stage.bands, stage.equal_ports);
  // Modes are the first coordinates and M-orthogonal to the rest, so what they leave is
  // the rest.
  for (int j = 0; j < F.columns; ++j)
    for (int i = 0; i < in_band; ++i) F(i, j) = 0;
  const int rest = e.count - in_band;
  const Dense inner = weighted_svd(part_of(F, in_band, rest, 0, F.columns),
                                   part_of(e.gram, in_band, rest, in_band, rest))
                          .vectors;
  return nested(after_rigid(inner, e.rigid + in_band, e.N), e.rigid + in_band);
}

} // namespace

extern const Method gramian_modes_method;
const Method gramian_modes_method{
    "modes of the band, then the Gramian of what they leave", make};

} // namespace flexgram
