#include "medium/level_judge.hpp"

#include "medium/error_over_band.hpp"

#include <algorithm>
#include <cmath>

namespace flexgram {

LevelJudge::LevelJudge(const SecondOrderModel& fom, const Medium& medium,
                       std::vector<double>& grid)
    : fom_(fom), medium_(medium), grid_(grid) {}

void LevelJudge::judge(std::size_t number, MediumLevel& level) {
  const CertifySpec& spec = medium_.spec;
  const bool to_band = spec.relative_to == RelativeTo::band; // the largest |H| is needed
  seen_ = std::make_unique<MediumOverBand>(
      MediumModel(medium_, number, find_ports(medium_.body, {}, {}), spec.kinds,
                  spec.relative_to),
      spec.bands, to_band ? grid_ : std::vector<double>());
  judge_again(level);
}

/// At peaks too narrow for the grid, and where rounding was found to be large.
std::vector<double> LevelJudge::beside_grid() const {
  std::vector<double> peaks = spots_;
  const auto& bands = medium_.spec.bands;
  for (const auto& [omega, half_width] : model().resonances)
    if (half_width > 1e-9 * omega && half_width <= 1e-7 * omega &&
        std::any_of(bands.begin(), bands.end(), [&](const Interval& band) {
          return band.first <= omega && omega <= band.last;
        }))
      peaks.push_back(omega);
  return peaks;
}

std::vector<double> LevelJudge::rounding_grid() const {
  std::vector<double> grid = beside_grid();
  grid.insert(grid.end(), grid_.begin(), grid_.end());
  return grid;
}

void LevelJudge::look_at_rounding(const std::vector<double>& spots) {
  spots_.insert(spots_.end(), spots.begin(), spots.end());
}

void LevelJudge::judge_again(MediumLevel& level) {
  const CertifySpec& spec = medium_.spec;
  const MediumModel& model = this->model();
  const std::size_t views = model.views.size();
  std::vector<double> largest(views, 0.0); // of ‖H‖, where that is meant
  std::vector<MediumModel::Stretch> values;
  // Of many ports, rough bounds are larger by twice the root of their number at most.
  const double ports = static_cast<double>(medium_.scale.size()),
               hopeless = spec.relative_to == RelativeTo::band
                              ? HUGE_VAL
                              : 2 * spec.target * std::sqrt(ports);
  // Beside undamped resonances, intervals decide.
  std::erase_if(grid_, [&](double omega) { return model.is_resonance(omega); });
  for (double omega : grid_) values.push_back(model.at(omega, hopeless));
  const std::size_t on_grid = values.size();
  for (double omega : beside_grid()) values.push_back(model.at(omega, hopeless));
  const auto size = [&](const MediumModel::Stretch& value, std::size_t v) {
    return value.size[v].below[0] - value.bounds[v].error;
  };
  if (spec.relative_to == RelativeTo::band)
    for (std::size_t l = 0; l < on_grid; ++l)
      for (std::size_t v = 0; v < views; ++v)
        if (values[l].bounds[v].proved)
          largest[v] = std::max(largest[v], size(values[l], v));
  double worst = 0, worst_omega = grid_.empty() ? 0 : grid_.front(), largest_floor = 0;
  bool proved = true;
  for (std::size_t l = 0; l < values.size(); ++l)
    for (std::size_t v = 0; v < views; ++v) {
      const auto& value = values[l];
      const double known =
          model.views[v].allowed * (largest[v] > 0 ? largest[v] : size(value, v));
      const double relative = value.bounds[v].error / known,
                   error = known > 0 && std::isfinite(relative) ? relative : HUGE_VAL,
                   floor = value.bounds[v].floor / known;
      if (floor > largest_floor) largest_floor = floor; // not NaN
      if (l >= on_grid) continue;
      proved = proved && value.bounds[v].proved;
      if (error > worst) worst_omega = grid_[l];
      worst = std::max(worst, error);
    }
  // Dense work may differ in the last bit from rank to rank; decisions must not.
  std::vector<double> shared{worst, proved ? 1.0 : 0.0, worst_omega, largest_floor};
  share_from_first(fom_.comm, shared);
  level.worst = shared[0];
  level.proved = shared[1] > 0;
  worst_omega_ = shared[2];
  floor_ = shared[3];
}

double LevelJudge::allowed_rounding(const MediumLevel& level) const {
  constexpr double little_work = 5e8, little = 2e-10;
  const double N = level.order(),
               work = 10 * static_cast<double>(fom_.nonzeros()) * N + 60 * N * N * N,
               allowed = 0.5 * std::max(medium_.spec.target, std::min(level.worst, 1.0));
  return level.worst < 1 && work < little_work ? std::min(allowed, little) : allowed;
}

std::optional<double> LevelJudge::weak_spot() const {
  const auto spot =
      ErrorOverBand(*seen_, medium_.spec.relative_to).weak_spot(medium_.spec.target);
  std::vector<double> shared{spot.value_or(-1.0)};
  share_from_first(fom_.comm, shared);
  return shared[0] < 0 ? std::nullopt : std::optional(shared[0]);
}

std::vector<double> LevelJudge::rounding_spots(double allowed) const {
  std::vector<double> spots =
      ErrorOverBand(*seen_, medium_.spec.relative_to).rounding_spots(allowed);
  share_list(fom_.comm, spots);
  return spots;
}

} // namespace flexgram
