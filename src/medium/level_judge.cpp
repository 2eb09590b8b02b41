#include "medium/level_judge.hpp"

#include "medium/error_over_band.hpp"

#include <algorithm>
#include <cmath>

namespace flexgram {

LevelJudge::LevelJudge(const SecondOrderModel& fom, const Medium& medium,
                       std::vector<double>& grid)
    : fom_(fom), medium_(medium), grid_(grid), shared_(grid.size()) {}

ParameterValues LevelJudge::worst_values() const {
  const auto& values = medium_.spec.values;
  return values.empty() ? ParameterValues() : values[worst_values_];
}

void LevelJudge::judge(std::size_t number, MediumLevel& level) {
  level_ = number;
  seen_.clear();
  seen_.resize(std::max<std::size_t>(1, medium_.spec.values.size()));
  judge_again(level);
}

MediumOverBand& LevelJudge::seen(std::size_t values) {
  auto& seen = seen_.at(values);
  if (seen) return *seen;
  const CertifySpec& spec = medium_.spec;
  const bool to_band = spec.relative_to == RelativeTo::band; // the largest |H| is needed
  seen = std::make_unique<MediumOverBand>(
      MediumModel(medium_, level_, find_ports(medium_.body, {}, {}), spec.kinds,
                  spec.relative_to, 0,
                  spec.values.empty() ? ParameterValues() : spec.values[values]),
      spec.bands, to_band ? grid_ : std::vector<double>());
  return *seen;
}

/// At peaks too narrow for the grid, and where rounding was found to be large.
std::vector<double> LevelJudge::beside_grid(const MediumModel& model) const {
  std::vector<double> peaks = spots_;
  const auto& bands = medium_.spec.bands;
  for (const auto& [omega, half_width] : model.resonances)
    if (half_width > 1e-9 * omega && half_width <= 1e-7 * omega &&
        std::any_of(bands.begin(), bands.end(), [&](const Interval& band) {
          return band.first <= omega && omega <= band.last;
        }))
      peaks.push_back(omega);
  return peaks;
}

/// With other values of the parameters the peaks are elsewhere.
std::vector<double> LevelJudge::grid_of(std::size_t values) {
  if (values == 0) return grid_;
  std::vector<double> grid =
      band_grid(medium_.spec.bands, 60, seen(values).model().resonances);
  grid.insert(grid.end(),
              grid_.begin() +
                  static_cast<std::ptrdiff_t>(std::min(shared_, grid_.size())),
              grid_.end());
  return grid;
}

std::vector<double> LevelJudge::rounding_grid() {
  std::vector<double> grid = beside_grid(model());
  grid.insert(grid.end(), grid_.begin(), grid_.end());
  return grid;
}

void LevelJudge::look_at_rounding(const std::vector<double>& spots) {
  spots_.insert(spots_.end(), spots.begin(), spots.end());
}

std::vector<LevelJudge::Sight> LevelJudge::sights(std::size_t values, double hopeless) {
  const MediumModel& model = seen(values).model();
  std::vector<Sight> result;
  for (double omega : grid_of(values))
    if (!model.is_resonance(omega))
      result.push_back({model.at(omega, hopeless), omega, true});
  for (double omega : beside_grid(model))
    result.push_back({model.at(omega, hopeless), omega, false});
  return result;
}

void LevelJudge::judge_again(MediumLevel& level, bool thorough) {
  const CertifySpec& spec = medium_.spec;
  // Of many ports, rough bounds are larger by twice the root of their number at most.
  const double ports = static_cast<double>(medium_.scale.size()),
               hopeless = spec.relative_to == RelativeTo::band
                              ? HUGE_VAL
                              : 2 * spec.target * std::sqrt(ports);
  // Beside undamped resonances, intervals decide.
  const std::size_t before = grid_.size();
  std::erase_if(grid_, [&](double omega) { return seen(0).model().is_resonance(omega); });
  shared_ -= std::min(shared_, before - grid_.size());
  const auto size = [&](const MediumModel::Stretch& value, std::size_t v) {
    return value.size[v].below[0] - value.bounds[v].error;
  };
  double worst = 0, worst_omega = grid_.empty() ? 0 : grid_.front(), largest_floor = 0;
  std::size_t worst_values = worst_values_;
  bool proved = true;
  // The values that were worst come first: a level that does not serve with them is not good
  // enough, whatever it is with others.
  for (std::size_t l = 0; l < seen_.size() && (thorough || !(worst > spec.target)); ++l) {
    const std::size_t k = (worst_values_ + l) % seen_.size();
    const MediumModel& model = seen(k).model();
    const std::size_t views = model.views.size();
    const std::vector<Sight> here = sights(k, hopeless);
    std::vector<double> largest(views, 0.0); // of ‖H‖, where that is meant
    if (spec.relative_to == RelativeTo::band)
      for (const Sight& sight : here)
        for (std::size_t v = 0; v < views; ++v)
          if (sight.is_on_grid && sight.value.bounds[v].proved)
            largest[v] = std::max(largest[v], size(sight.value, v));
    for (const Sight& sight : here)
      for (std::size_t v = 0; v < views; ++v) {
        const Certificate::Bound& bound = sight.value.bounds[v];
        const double known =
            model.views[v].allowed * (largest[v] > 0 ? largest[v] : size(sight.value, v));
        const double relative = bound.error / known,
                     error = known > 0 && std::isfinite(relative) ? relative : HUGE_VAL,
                     floor = bound.floor / known;
        if (floor > largest_floor) largest_floor = floor; // not NaN
        if (!sight.is_on_grid) continue;
        proved = proved && bound.proved;
        if (!(error > worst)) continue;
        worst = error;
        worst_omega = sight.omega;
        worst_values = k;
      }
  }
  // Dense work may differ in the last bit from rank to rank; decisions must not.
  std::vector<double> shared{worst, proved ? 1.0 : 0.0, worst_omega, largest_floor,
                             static_cast<double>(worst_values)};
  share_from_first(fom_.comm, shared);
  level.worst = shared[0];
  level.proved = shared[1] > 0;
  worst_omega_ = shared[2];
  floor_ = shared[3];
  worst_values_ = static_cast<std::size_t>(shared[4]);
}

double LevelJudge::allowed_rounding(const MediumLevel& level) const {
  constexpr double little_work = 5e8, little = 2e-10;
  const double N = level.order(),
               work = 10 * static_cast<double>(fom_.nonzeros()) * N + 60 * N * N * N,
               allowed = 0.5 * std::max(medium_.spec.target, std::min(level.worst, 1.0));
  return level.worst < 1 && work < little_work ? std::min(allowed, little) : allowed;
}

std::optional<double> LevelJudge::weak_spot(const ErrorOverBand::Tell& tell) {
  for (std::size_t k = 0; k < seen_.size(); ++k) {
    const auto told = [&](double share) {
      tell((static_cast<double>(k) + share) / static_cast<double>(seen_.size()));
    };
    const auto spot = ErrorOverBand(seen(k), medium_.spec.relative_to)
                          .weak_spot(medium_.spec.target, told);
    std::vector<double> shared{spot.value_or(-1.0)};
    share_from_first(fom_.comm, shared);
    if (shared[0] >= 0) return shared[0];
  }
  return std::nullopt;
}

std::vector<double> LevelJudge::rounding_spots(double allowed) {
  std::vector<double> spots;
  for (std::size_t k = 0; k < seen_.size(); ++k) {
    const std::vector<double> more =
        ErrorOverBand(seen(k), medium_.spec.relative_to).rounding_spots(allowed);
    spots.insert(spots.end(), more.begin(), more.end());
  }
  share_list(fom_.comm, spots);
  return spots;
}

} // namespace flexgram
