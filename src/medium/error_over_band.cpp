#include "medium/error_over_band.hpp"

#include "base/process.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>

namespace flexgram {
namespace {

constexpr double infinity = std::numeric_limits<double>::infinity();

/// What is measured of the medium model's own error.
double of_medium(ErrorOverBand::Measure measure, double error, double floor) {
  switch (measure) {
  case ErrorOverBand::Measure::claim:
    return error + floor;
  case ErrorOverBand::Measure::model_error:
    return error;
  default:
    return floor;
  }
}

} // namespace

ErrorOverBand::ErrorOverBand(MediumOverBand& medium, RelativeTo relative_to)
    : medium_(medium), relative_to_(relative_to) {}

/// What errors are relative to, times what the kind may err: so one tolerance is for all.
double ErrorOverBand::reference(std::size_t view, double here) {
  return allowed(view) *
         (relative_to_ == RelativeTo::band ? medium_.grid().views[view].largest : here);
}

double ErrorOverBand::allowed(std::size_t view) const {
  return medium_.model().views[view].allowed;
}

/// A certified error: `difference` of the responses, ‖H‖ of the medium model and the bound
/// of its error, in the unit of H.
double ErrorOverBand::ratio(std::size_t view, double difference, double size,
                            double bound) {
  const double known = reference(view, size - bound);
  const double most = difference + bound;
  return known > 0 && most < infinity ? most / known : infinity; // NaN too
}

double ErrorOverBand::measured(Measure measure, std::size_t view, double difference,
                               double size, double error, double floor) {
  if (measure == Measure::claim) return ratio(view, difference, size, error + floor);
  if (!std::isfinite(error)) return ratio(view, difference, size, 0);
  return difference <= error ? 0.0 : ratio(view, difference, size, error);
}

/// Differences that do not matter beside errors of `level`.
std::vector<double> ErrorOverBand::negligible(const std::vector<double>& sizes,
                                              double level) {
  std::vector<double> result;
  for (std::size_t v = 0; v < sizes.size(); ++v)
    result.push_back(0.05 * level * reference(v, sizes[v]));
  return result;
}

std::vector<std::vector<double>>
ErrorOverBand::distances(const std::vector<std::size_t>& at, const SmallModel& small,
                         double level) {
  std::vector<SmallModel::Sample> samples;
  for (std::size_t l : at) {
    std::vector<double> sizes;
    for (const auto& view : medium_.grid().views) sizes.push_back(view.size[l]);
    samples.push_back({&medium_.at(l), omega()[l], negligible(sizes, level)});
  }
  return small.distances(samples);
}

/// Of these frequencies of the grid the one with the largest certified error of all views,
/// and that error.
std::pair<std::size_t, double> ErrorOverBand::worst_of(const std::vector<std::size_t>& at,
                                                       const SmallModel& small,
                                                       double level, Measure measure) {
  const auto& views = medium_.grid().views;
  const auto distance = distances(at, small, level);
  std::pair<std::size_t, double> worst{at.front(), 0.0};
  for (std::size_t k = 0; k < at.size(); ++k)
    for (std::size_t v = 0; v < views.size(); ++v) {
      const double here = measured(measure, v, distance[k][v], views[v].size[at[k]],
                                   views[v].error[at[k]], views[v].floor[at[k]]);
      if (here > worst.second) worst = {at[k], here};
    }
  return worst;
}

double ErrorOverBand::least() {
  const auto& views = medium_.grid().views;
  double least = 0;
  for (std::size_t v = 0; v < views.size(); ++v)
    for (std::size_t l = 0; l < omega().size(); ++l)
      least = std::max(
          least, ratio(v, 0, views[v].size[l], views[v].error[l] + views[v].floor[l]));
  return least;
}

std::vector<double> ErrorOverBand::floor() {
  const auto& whole = medium_.grid().views.front();
  std::vector<double> relative;
  for (std::size_t l = 0; l < whole.size.size(); ++l)
    relative.push_back(whole.floor[l] * allowed(0) / reference(0, whole.size[l]));
  return relative;
}

ErrorOverBand::Floor ErrorOverBand::largest_floor() {
  Floor most;
  const auto& views = medium_.grid().views;
  for (std::size_t v = 0; v < views.size(); ++v)
    for (std::size_t l = 0; l < omega().size(); ++l)
      if (const double floor =
              views[v].floor[l] * allowed(v) / reference(v, views[v].size[l]);
          floor > most.worst)
        most = {floor, v == 0 ? "H" : medium_.model().views[v].name, omega()[l]};
  return most;
}

ErrorOverBand::Errors ErrorOverBand::of(const DenseSystem& system) {
  const SmallModel small(system, medium_.model());
  const auto& views = medium_.grid().views;
  Errors errors;
  std::vector<std::size_t> all(omega().size());
  std::iota(all.begin(), all.end(), 0u);
  const auto distance = distances(all, small, 0);
  for (std::size_t l : all) {
    for (std::size_t v = 0; v < views.size(); ++v) {
      const double bound = ratio(v, distance[l][v], views[v].size[l],
                                 views[v].error[l] + views[v].floor[l]);
      errors.worst = std::max(errors.worst, bound);
      if (v == 0) errors.bound.push_back(bound * allowed(v));
    }
    errors.relative.push_back(distance[l][0] / views.front().size[l]);
  }
  return errors;
}

/// @param level  of errors that matter.
ErrorOverBand::Point ErrorOverBand::point(double omega, Small small, double level,
                                          Measure measure) {
  const MediumModel& model = medium_.model();
  Point result{std::vector<double>(model.views.size(), infinity), true};
  const auto medium = model.over({omega, omega}, 0);
  if (!medium) return result;
  std::vector<double> sizes;
  for (const ViewNorms& size : medium->size) sizes.push_back(size.below[0]);
  std::optional<std::vector<ViewNorms>> away;
  if (small) {
    away = small->differences(medium->H, {omega, omega}, 0, negligible(sizes, level));
    if (!away) return result;
  }
  for (std::size_t v = 0; v < model.views.size(); ++v) {
    const Certificate::Bound& bound = medium->bounds[v];
    result.certified[v] =
        small ? measured(measure, v, (*away)[v].above[0], sizes[v], bound.error,
                         bound.floor + solve_floor * medium->size[v].above[0])
              : ratio(v, 0, sizes[v], of_medium(measure, bound.error, bound.floor));
    result.proved = result.proved && bound.proved;
  }
  return result;
}

ErrorOverBand::Look ErrorOverBand::look(Node& node, Small small, double level,
                                        Measure measure) {
  const auto& views = medium_.model().views;
  Look look{std::vector<double>(views.size(), infinity), infinity, node.interval.centre(),
            false, true};
  const auto medium = medium_.over(node);
  if (!medium) return look;
  std::optional<std::vector<ViewNorms>> differs;
  if (small) {
    std::vector<double> sizes;
    for (const ViewNorms& size : medium->size)
      sizes.push_back(*std::min_element(size.below.begin(), size.below.end()));
    differs = small->differences(*medium_.response(node), node.interval, series_degree,
                                 negligible(sizes, level));
    if (!differs) return look;
  }
  look.known = true;
  look.worst = 0;
  look.proved = medium->proved;
  double most = -1;
  for (std::size_t v = 0; v < views.size(); ++v) {
    const ViewNorms away = small ? (*differs)[v] : ViewNorms();
    const ViewNorms& size = medium->size[v];
    const double error = medium->error[v],
                 own = of_medium(measure, error, medium->floor[v]);
    look.upper[v] = 0;
    for (std::size_t i = 0; i < pieces; ++i)
      look.upper[v] =
          std::max(look.upper[v], small ? measured(measure, v, away.above[i],
                                                   size.below[i], error, medium->floor[v])
                                        : ratio(v, 0, size.below[i], own));
    look.worst = std::max(look.worst, look.upper[v]);
    for (std::size_t i = 0; i <= pieces; ++i) {
      const double here = ratio(v, away.at[i] + (small ? 0.0 : own), size.at[i], 0);
      if (here <= most) continue;
      most = here;
      look.omega =
          node.interval.first + node.interval.width() * static_cast<double>(i) / pieces;
    }
  }
  return look;
}

bool ErrorOverBand::meets(const DenseSystem& system, double tolerance, Measure measure) {
  const SmallModel small(system, medium_.model());
  const auto fails = [&](const std::vector<std::size_t>& at) {
    stop_if_interrupted();
    const auto [l, worst] = worst_of(at, small, tolerance, measure);
    if (worst <= tolerance) return false;
    hard_.assign(1, l);
    return true;
  };
  for (double omega : hard_omega_)
    if (!(point(omega, &small, tolerance, measure).worst() <= tolerance)) return false;
  if (!hard_.empty() && fails(hard_)) return false;
  // Far apart first: a failure is found early. Gram matrices of many ports are large beside
  // what they are multiplied with: several frequencies at once cost little more than one.
  const std::size_t together = medium_.model().has_many_ports() ? omega().size() : 1;
  for (std::size_t step = 16, first = 0; step >= 1; step /= 2, first = step) {
    std::vector<std::size_t> at;
    for (std::size_t l = first; l < omega().size(); l += first == 0 ? step : 2 * step) {
      at.push_back(l);
      if (at.size() < together) continue;
      if (fails(at)) return false;
      at.clear();
    }
    if (!at.empty() && fails(at)) return false;
  }
  const std::optional<double> worse = exceeds(&small, tolerance, measure); // between them
  if (!worse) return true;
  hard_omega_.insert(hard_omega_.begin(), *worse);
  if (hard_omega_.size() > 8) hard_omega_.pop_back();
  return false;
}

std::optional<double> ErrorOverBand::weak_spot(double tolerance, const Tell& tell) {
  return exceeds(nullptr, tolerance, Measure::model_error, tell);
}

/// Where in an interval the error of the medium model is about largest, by golden sections.
double ErrorOverBand::worst_between(Interval interval, double tolerance,
                                    Measure measure) {
  constexpr double golden = 0.6180339887498949;
  const auto at = [&](double omega) {
    return point(omega, nullptr, tolerance, measure).worst();
  };
  double low = interval.last - golden * interval.width(),
         high = interval.first + golden * interval.width(), of_low = at(low),
         of_high = at(high);
  for (int step = 0; step < 24; ++step)
    if (of_low > of_high) {
      interval.last = high;
      high = low, of_high = of_low;
      of_low = at(low = interval.last - golden * interval.width());
    } else {
      interval.first = low;
      low = high, of_low = of_high;
      of_high = at(high = interval.first + golden * interval.width());
    }
  return of_low > of_high ? low : high;
}

/// Calls visit(ω, node) where the error of the small model, or of the medium model itself, is not
/// proved to be within the tolerance; in intervals that lie apart, while it returns true. From the
/// last frequency down.
template <class Visit>
void ErrorOverBand::where_it_fails(Small small, double tolerance, Measure measure,
                                   const Visit& visit, const Tell& tell) {
  constexpr int most = 20000; // intervals; what is open then counts as it is
  std::vector<Node*> open;
  for (const auto& root : medium_.roots()) open.push_back(root.get());
  for (int count = 0; !open.empty(); ++count) {
    stop_if_interrupted();
    Node& node = *open.back();
    open.pop_back();
    const Interval all{medium_.roots().front()->interval.first,
                       medium_.roots().back()->interval.last};
    if (tell && all.width() > 0) tell((all.last - node.interval.last) / all.width());
    const Look seen = look(node, small, tolerance, measure);
    if (seen.worst <= tolerance || medium_.may_be_excluded(node.interval)) continue;
    const bool shown =
        !medium_.near_pole(node.interval) && seen.known &&
        !(point(seen.omega, small, tolerance, measure).worst() <= tolerance);
    if (shown || node.is_shortest() || count > most) {
      if (!visit(shown ? seen.omega : node.interval.centre(), node)) return;
      continue;
    }
    medium_.split(node);
    open.push_back(node.low.get());
    open.push_back(node.high.get());
  }
}

std::vector<double> ErrorOverBand::rounding_spots(double tolerance) {
  constexpr std::size_t most = 100;
  std::vector<double> spots;
  where_it_fails(
      nullptr, tolerance, Measure::rounding, [&](double omega, const Node& node) {
        const double piece = node.interval.width() / pieces;
        spots.push_back(node.is_shortest()
                            ? omega
                            : worst_between({std::max(node.interval.first, omega - piece),
                                             std::min(node.interval.last, omega + piece)},
                                            tolerance, Measure::rounding));
        return spots.size() < most;
      });
  return spots;
}

std::optional<double> ErrorOverBand::exceeds(Small small, double tolerance,
                                             Measure measure, const Tell& tell) {
  std::optional<double> found;
  where_it_fails(
      small, tolerance, measure,
      [&](double omega, const Node&) {
        found = omega;
        return false;
      },
      tell);
  return found;
}

} // namespace flexgram
