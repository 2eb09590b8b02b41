#include "medium/over_band.hpp"

#include <algorithm>
#include <cmath>

namespace flexgram {
namespace {

/// Beside sharp resonances intervals may be excluded, no farther from the pole than `zone`
/// of its frequency, and looked at no closer than `nearest`, or a tenth of the half width
/// if that is wider than `thin`.
constexpr double zone = 1e-4, nearest = 1e-7, thin = 1e-9;
/// Intervals that a band starts from.
constexpr int first_intervals = 32;
/// What is kept of series, of all sights together; more is computed again.
constexpr std::size_t most_kept = 32u << 20; // numbers: 256 MB
constexpr std::size_t most_sights = 6;

/// As many sights as leave each room for a thousand intervals. By the entries of H, so the
/// same on every rank.
std::size_t sights_at_once(std::size_t entries) {
  const std::size_t each =
      1000 * 2 * (series_degree + 1) * std::max<std::size_t>(entries, 1);
  return std::clamp<std::size_t>(most_kept / each, 1, most_sights);
}

} // namespace

MediumOverBand::MediumOverBand(MediumModel model, const std::vector<Interval>& bands,
                               std::vector<double> grid)
    : model_(std::move(model)), omega_(std::move(grid)) {
  std::erase_if(omega_, [&](double omega) { return model_.is_resonance(omega); });
  for (const Resonance& r : model_.resonances)
    if (r.sharp())
      sharp_.push_back(
          {{r.omega * (1 - zone), r.omega * (1 + zone)},
           r.omega,
           r.half_width > thin * r.omega ? 0.1 * r.half_width : nearest * r.omega});
  const auto add = [&](const Interval& interval) {
    roots_.push_back(std::make_unique<Node>());
    roots_.back()->interval = interval;
  };
  for (const Interval& band : bands) {
    if (band.width() == 0) {
      add(band);
      continue;
    }
    // Zones of exclusion are intervals of their own, and between the frequencies of tables
    // their values are smooth.
    std::vector<double> ends{band.first, band.last};
    for (const auto& [law, T] : model_.system.terms)
      for (double end : law.kind().breaks())
        if (end > band.first && end < band.last) ends.push_back(end);
    for (const Sharp& s : sharp_)
      for (double end : {s.zone.first, s.zone.last})
        if (end > band.first && end < band.last) ends.push_back(end);
    std::sort(ends.begin(), ends.end());
    ends.erase(std::unique(ends.begin(), ends.end()), ends.end());
    for (std::size_t i = 0; i + 1 < ends.size(); ++i) {
      const double first = ends[i], last = ends[i + 1], whole = last - first;
      const int count =
          1 + static_cast<int>((first_intervals - 1) * whole / band.width());
      for (int l = 0; l < count; ++l)
        add({first + whole * l / count,
             l + 1 == count ? last : first + whole * (l + 1) / count});
    }
  }
}

const MediumOverBand::Grid& MediumOverBand::grid() {
  if (grid_) return *grid_;
  Grid grid;
  grid.views.resize(model_.views.size());
  for (double omega : omega_) {
    MediumModel::Stretch value = model_.at(omega);
    double data_rounding = 0;
    for (std::size_t v = 0; v < grid.views.size(); ++v) {
      View& view = grid.views[v];
      const Certificate::Bound& bound = value.bounds[v];
      const double size = value.size[v].below[0],
                   floor = bound.floor + solve_floor * size;
      view.size.push_back(size);
      view.error.push_back(bound.error);
      view.floor.push_back(floor);
      grid.rigid_rounding =
          std::max(grid.rigid_rounding, bound.rigid_rounding / value.whole[v]);
      data_rounding = std::max(data_rounding, bound.data_rounding / size);
      if (bound.proved) view.largest = std::max(view.largest, size - bound.error - floor);
    }
    grid.data_rounding.push_back(data_rounding);
    grid_H_.push_back(std::move(value.H));
  }
  return grid_.emplace(std::move(grid));
}

/// Nothing if the interval is too long for a series, or for a proof that there is at its
/// centre.
std::optional<MediumModel::Stretch>
MediumOverBand::provable_over(const Interval& interval) const {
  auto medium = model_.over(interval, series_degree);
  const auto proved = [](const MediumModel::Stretch& stretch) {
    return std::all_of(stretch.bounds.begin(), stretch.bounds.end(),
                       [](const Certificate::Bound& bound) { return bound.proved; });
  };
  if (!medium || proved(*medium) || interval.width() == 0) return medium;
  const double centre = interval.centre();
  const auto there = model_.over({centre, centre}, 0);
  if (there && proved(*there)) return std::nullopt;
  return medium;
}

std::shared_ptr<const MediumOverBand::Stretch> MediumOverBand::over(Node& node) {
  if (node.seen) return node.stretch;
  auto medium = provable_over(node.interval);
  if (!medium) {
    node.seen = true;
    return nullptr;
  }
  auto stretch = std::make_shared<Stretch>();
  for (std::size_t v = 0; v < model_.views.size(); ++v) {
    stretch->size.push_back(medium->size[v]);
    const Certificate::Bound& bound = medium->bounds[v];
    const auto& above = stretch->size.back().above;
    stretch->error.push_back(bound.error);
    stretch->floor.push_back(bound.floor +
                             solve_floor * *std::max_element(above.begin(), above.end()));
    stretch->proved = stretch->proved && bound.proved;
  }
  node.stretch = std::move(stretch);
  node.seen = true;
  keep(node, std::make_shared<const TransferSeries>(std::move(medium->H)));
  return node.stretch;
}

void MediumOverBand::keep(Node& node, std::shared_ptr<const TransferSeries> H) {
  const std::size_t numbers =
      H->entries.coefficients.data.size() + H->factors.coefficients.data.size();
  const std::size_t ports = model_.names.inputs.size() * model_.names.outputs.size();
  if (kept_ + numbers > most_kept / sights_at_once(ports)) {
    latest_ = {&node, std::move(H)};
    return;
  }
  kept_ += numbers;
  node.H = std::move(H);
}

std::shared_ptr<const TransferSeries> MediumOverBand::response(Node& node) {
  if (node.H) return node.H;
  if (latest_.first != &node) {
    auto again = model_.response(node.interval, series_degree);
    latest_ = {&node, std::make_shared<const TransferSeries>(std::move(*again))};
  }
  return latest_.second;
}

void MediumOverBand::split(Node& node) {
  if (node.low) return;
  const double middle = node.interval.centre();
  node.low = std::make_unique<Node>();
  node.high = std::make_unique<Node>();
  node.low->interval = {node.interval.first, middle};
  node.high->interval = {middle, node.interval.last};
}

bool MediumOverBand::near_pole(const Interval& interval) const {
  return std::any_of(sharp_.begin(), sharp_.end(),
                     [&](const Sharp& s) { return s.holds(interval); });
}

bool MediumOverBand::may_be_excluded(const Interval& interval) const {
  return std::any_of(sharp_.begin(), sharp_.end(), [&](const Sharp& s) {
    const double distance =
        std::max({interval.first - s.pole, s.pole - interval.last, 0.0});
    return s.holds(interval) && interval.width() <= std::max(0.25 * distance, s.nearest);
  });
}

std::shared_ptr<SeenLevels> no_level_seen() { return std::make_shared<SeenLevels>(); }

void SeenLevels::make_room(const Sight& next) {
  const std::size_t most =
      sights_at_once(next.ports.inputs.size() * next.ports.outputs.size());
  while (seen_.size() >= most) seen_.pop_front();
}

} // namespace flexgram
