/// weighted: the position Gramian with the weight 1/‖H(ω)‖ (Fehr, Eberhard, Lehner, eq. 8
/// with the weight that eq. 17 has).

#include "basis/method.hpp"

#include <algorithm>

namespace flexgram {
namespace {

/// With the weight 1/‖H(ω)‖_F and ports in their own units the Gramian measures what eq.
/// (17) does: the error of H is the square of what the basis misses of X.
std::vector<BandWeight> weights(const SecondStage& stage, const MediumModel& medium) {
  std::vector<BandWeight> bands;
  for (const auto& band : stage.bands) {
    BandWeight b;
    for (double omega : band_grid(band.omega.front(), band.omega.back(), 36, {})) {
      b.omega.push_back(omega);
      b.weight.push_back(band.at(omega) / medium.at(omega, 0).size[0].at[0]);
    }
    const double largest = *std::max_element(b.weight.begin(), b.weight.end());
    for (double& w : b.weight) w /= largest;
    bands.push_back(std::move(b));
  }
  return bands;
}

Candidate make(const SecondStage& stage) {
  std::vector<std::vector<BandWeight>> bands{weights(stage, stage.medium)};
  for (const MediumModel* other : stage.others) bands.push_back(weights(stage, *other));
  SecondStage relative = stage;
  relative.equal_ports = false;
  return gramian_candidate(relative, bands);
}

} // namespace

extern const Method weighted_method;
const Method weighted_method{"Gramian weighted by 1/|H|, the measure of eq. 17", make};

} // namespace flexgram
