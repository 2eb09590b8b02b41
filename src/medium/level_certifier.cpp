#include "medium/level_certifier.hpp"

#include "base/event.hpp"
#include "base/index.hpp"
#include "base/text.hpp"

#include <algorithm>
#include <limits>

namespace flexgram {

/// The certificate of the last level, with what rounding may do to it.
void LevelCertifier::certify(ProjectionRounding rounding,
                             const ResidualBasis& residuals) {
  last().certificate = std::make_shared<Certificate>(
      *modal_.space, *last().response, residuals, parts_.norm, std::move(rounding),
      modal_.modes(), modal_.inertia_is_safe, modal_.cutoff, run_.softening,
      modal_.scale);
  judge_.judge(medium_.levels.size() - 1, last());
}

void LevelCertifier::prove(InverseBounds& bounds, const std::vector<double>& grid,
                           int most) {
  hold_cutoff(run_, modal_);
  MediumSpace& space = *modal_.space;
  MediumLevel level;
  level.response = ritz_response(run_, modal_);
  if (bounds.least_eigenvalue == 0)
    bounds = inverse_bounds(run_, modal_, *level.response);
  if (!space.tracks_residual()) space.track_residual(modal_.loads);
  // By Weyl a backward error of that size could have moved an eigenvalue of E across zero.
  modal_.inertia_is_safe =
      modal_.inertia_is_safe &&
      bounds.least_eigenvalue > 16 * std::numeric_limits<double>::epsilon();
  std::vector<double> samples;
  const std::size_t step = std::max<std::size_t>(1, grid.size() / 24);
  for (std::size_t l = 0; l < grid.size(); l += step)
    if (!level.response->is_resonance(grid[l])) samples.push_back(grid[l]);

  if (!parts_.residuals.complete) images_ = ResidualImages(); // of directions alone
  orthonormalise_residual(space);
  const int solved = static_cast<int>(images_.images().columns());
  if (const auto fewer = directions_of_residual(space, solved, most)) {
    if (fewer->columns < space.residual().orthonormal - solved)
      images_ = ResidualImages();
    else
      images_.extend(run_, modal_, space.residual().S);
    turn_residual_parts(space, *fewer);
    images_.turn(run_, modal_, *fewer, space.residual().S);
  }
  if (space.residual().orthonormal <= most)
    images_.extend(run_, modal_, space.residual().S);
  else
    images_ = ResidualImages();
  ResidualBasis residuals =
      residual_basis(space, *level.response, samples, run_.spec.values, modal_.modes(),
                     modal_.cutoff, most);
  level.complete = residuals.complete;
  Basis T = space.residual().S.share();
  if (!level.complete) {
    T = Basis(combine(T, residuals.cut));
    images_.extend(run_, modal_, T);
  }
  ResidualNorm norm = images_.norm(run_, modal_, *level.response, bounds, T);
  parts_ = {level.response, std::move(residuals), std::move(norm), std::move(samples)};
  auto& levels = medium_.levels;
  if (!levels.empty() && levels.back().order() == level.order()) levels.pop_back();
  if (!run_.spec.keep_levels) levels.clear();
  levels.push_back(std::move(level));
  judge_.forget_rounding_spots();
  is_sharp_ = false;
  certify(plain_rounding(space, *parts_.response, modal_.loads), parts_.residuals);
  parts_.worst = last().worst;
  parts_.worst_omega = judge_.worst_omega();
  // A level that is neither kept nor the last one is needed for growing alone.
  if (run_.spec.keep_levels || last().serves(run_.spec.target)) sharpen_if_needed();
}

/// The last level again, with twice the digits for the energies of the vectors that need them.
/// What the others lose meets the forces of these, so more of them may be needed than it seems.
/// @return whether there are others.
bool LevelCertifier::sharpen() {
  static Event event("SharpenEnergies");
  const auto timed = event.timed();
  const MediumSpace& space = *modal_.space;
  const ProjectionRounding sums = rounding_of_sums(space, *parts_.response, modal_.loads);
  const auto all = as_size(2 * last().order() - modal_.rigid());
  std::size_t before = 0;
  for (const double share : {1.0, 3e-2, 1e-3}) {
    const SharpSums chosen = sums_to_sharpen(
        run_.fom.comm, judge_.model(), *parts_.response, sums, modal_.scale,
        judge_.rounding_grid(), share * judge_.allowed_rounding(last()));
    if (chosen.count() == before && share < 1) continue;
    before = chosen.count();
    SharpResponse sharp = sharpened(space, *parts_.response, sums, modal_.loads, chosen);
    last().response = std::move(sharp.response);
    ResidualBasis residuals = parts_.residuals;
    turn_residual(residuals, sharp.turned, *last().response, space.kappa(),
                  modal_.cutoff);
    certify(std::move(sharp.rounding), residuals);
    if (before == all || !needs_sharper_sums()) break;
  }
  run_.observer.detail(
      text("  %zu of %zu energies summed with twice the digits: rounding %.1e of "
           "H at most where it was looked at",
           before, all, judge_.floor()));
  is_sharp_ = before > 0;
  return before < all;
}

void LevelCertifier::sharpen_if_needed() {
  if (!is_sharp_ && parts_.response && needs_sharper_sums()) sharpen();
}

void LevelCertifier::sharpen_between() {
  if (!parts_.response) return; // of a checkpoint
  // Claims have room for more than the grid is held to.
  const double allowed = std::max(10 * judge_.allowed_rounding(last()), 5e-11);
  for (int look = 0; look < 4; ++look) {
    const std::vector<double> spots = judge_.rounding_spots(allowed);
    if (spots.empty()) return;
    judge_.look_at_rounding(spots);
    judge_.judge_again(last());
    if (!needs_sharper_sums()) return;
    const double before = judge_.floor();
    if (!sharpen() || judge_.floor() > 0.5 * before) return;
  }
}

} // namespace flexgram
