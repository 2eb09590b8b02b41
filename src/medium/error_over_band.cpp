#include "medium/error_over_band.hpp"

#include "base/process.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <queue>

namespace flexgram {
namespace {

constexpr double infinity = std::numeric_limits<double>::infinity();
/// Relative length of intervals that are not halved any more.
constexpr double narrowest = 1e-10;
/// How close the supremum is to come to an attained value.
constexpr double close = 1.05;

double width_of(const Interval& interval) { return interval.last - interval.first; }

/// Ascending; those that touch, or have no more than a gap between them, as one.
std::vector<Interval> joined(std::vector<Interval> intervals, double gap = 0) {
  std::sort(intervals.begin(), intervals.end(),
            [](const Interval& a, const Interval& b) { return a.first < b.first; });
  std::vector<Interval> result;
  for (const Interval& i : intervals)
    if (!result.empty() && i.first <= result.back().last + gap)
      result.back().last = std::max(result.back().last, i.last);
    else
      result.push_back(i);
  return result;
}

double largest(const std::vector<double>& values) {
  return *std::max_element(values.begin(), values.end());
}

} // namespace

/// What a small model's error may be on an interval.
struct ErrorOverBand::Look {
  std::vector<double> upper; ///< of each view
  double worst = infinity;
  double omega = 0;   ///< where the error seems largest
  bool known = false; ///< no pole is too near for a bound
  bool proved = true;
};

/// The certified errors at one frequency.
struct ErrorOverBand::Point {
  std::vector<double> certified; ///< of each view
  bool proved = true;
  double worst() const { return largest(certified); }
};

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
              : ratio(v, 0, sizes[v],
                      bound.error + (measure == Measure::claim ? bound.floor : 0));
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
                 of_medium = error + (measure == Measure::claim ? medium->floor[v] : 0);
    look.upper[v] = 0;
    for (std::size_t i = 0; i < pieces; ++i)
      look.upper[v] =
          std::max(look.upper[v], small ? measured(measure, v, away.above[i],
                                                   size.below[i], error, medium->floor[v])
                                        : ratio(v, 0, size.below[i], of_medium));
    look.worst = std::max(look.worst, look.upper[v]);
    for (std::size_t i = 0; i <= pieces; ++i) {
      const double here = ratio(v, away.at[i] + (small ? 0.0 : of_medium), size.at[i], 0);
      if (here <= most) continue;
      most = here;
      look.omega =
          node.interval.first + width_of(node.interval) * static_cast<double>(i) / pieces;
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

std::optional<double> ErrorOverBand::weak_spot(double tolerance) {
  return exceeds(nullptr, tolerance, Measure::model_error);
}

/// Where in an interval the error of the medium model is about largest, by golden sections.
double ErrorOverBand::worst_between(Interval interval, double tolerance,
                                    Measure measure) {
  constexpr double golden = 0.6180339887498949;
  const auto at = [&](double omega) {
    return point(omega, nullptr, tolerance, measure).worst();
  };
  double low = interval.last - golden * width_of(interval),
         high = interval.first + golden * width_of(interval), of_low = at(low),
         of_high = at(high);
  for (int step = 0; step < 24; ++step)
    if (of_low > of_high) {
      interval.last = high;
      high = low, of_high = of_low;
      of_low = at(low = interval.last - golden * width_of(interval));
    } else {
      interval.first = low;
      low = high, of_low = of_high;
      of_high = at(high = interval.first + golden * width_of(interval));
    }
  return of_low > of_high ? low : high;
}

std::vector<double> ErrorOverBand::rounding_spots(double tolerance) {
  constexpr std::size_t most = 100;
  std::vector<double> spots;
  std::vector<Node*> open;
  for (const auto& root : medium_.roots()) open.push_back(root.get());
  for (int count = 0; !open.empty() && spots.size() < most && count < 20000; ++count) {
    stop_if_interrupted();
    Node& node = *open.back();
    open.pop_back();
    const Look seen = look(node, nullptr, tolerance, Measure::claim);
    if (seen.worst <= tolerance || medium_.may_be_excluded(node.interval)) continue;
    if (!medium_.near_pole(node.interval) && seen.known &&
        !(point(seen.omega, nullptr, tolerance, Measure::claim).worst() <= tolerance)) {
      const double piece = width_of(node.interval) / pieces;
      spots.push_back(worst_between({std::max(node.interval.first, seen.omega - piece),
                                     std::min(node.interval.last, seen.omega + piece)},
                                    tolerance, Measure::claim));
    } else if (width_of(node.interval) <= narrowest * node.interval.last) {
      spots.push_back(node.interval.centre());
    } else {
      medium_.split(node);
      open.push_back(node.low.get());
      open.push_back(node.high.get());
    }
  }
  return spots;
}

/// A frequency where the error of the small model, or of the medium model itself, is not proved to be within the tolerance.
std::optional<double> ErrorOverBand::exceeds(Small small, double tolerance,
                                             Measure measure) {
  std::vector<Node*> open;
  for (const auto& root : medium_.roots()) open.push_back(root.get());
  for (int count = 0; !open.empty(); ++count) {
    stop_if_interrupted();
    Node& node = *open.back();
    open.pop_back();
    const Look seen = look(node, small, tolerance, measure);
    if (seen.worst <= tolerance) continue;
    if (medium_.may_be_excluded(node.interval)) continue;
    if (!medium_.near_pole(node.interval) && seen.known &&
        !(point(seen.omega, small, tolerance, measure).worst() <= tolerance))
      return seen.omega;
    if (width_of(node.interval) <= narrowest * node.interval.last || count > 20000)
      return node.interval.centre();
    medium_.split(node);
    open.push_back(node.low.get());
    open.push_back(node.high.get());
  }
  return std::nullopt;
}

ErrorOverBand::Unmet ErrorOverBand::unmet(const DenseSystem& system, double tolerance) {
  constexpr double finest = 1e-6; // of the bands
  constexpr int most = 20000;     // intervals that are looked at
  const SmallModel small(system, medium_.model());
  double whole = 0;
  const auto narrower = [](const Node* a, const Node* b) {
    return width_of(a->interval) < width_of(b->interval);
  };
  // The widest first: if there are too many, what is left is narrow.
  std::priority_queue<Node*, std::vector<Node*>, decltype(narrower)> open(narrower);
  for (const auto& root : medium_.roots()) {
    whole += width_of(root->interval);
    open.push(root.get());
  }
  const auto exceeds_at = [&](double omega) {
    return !(point(omega, &small, tolerance).worst() <= tolerance);
  };
  Unmet result;
  for (int count = 0; !open.empty(); ++count) {
    stop_if_interrupted();
    Node& node = *open.top();
    open.pop();
    const Interval& here = node.interval;
    if (look(node, &small, tolerance).worst <= tolerance) continue;
    if (medium_.may_be_excluded(here)) continue;
    // Beside resonances an interval may be too wide to be looked at: what no frequency shows
    // is no reason to stop.
    const auto fails = [&] {
      const int failed = static_cast<int>(exceeds_at(here.first)) +
                         static_cast<int>(exceeds_at(here.centre())) +
                         static_cast<int>(exceeds_at(here.last));
      return failed == 3 || (failed > 0 && width_of(here) <= finest * whole);
    };
    const bool is_small = width_of(here) <= narrowest * here.last ||
                          (!medium_.near_pole(here) && fails()); // else until excluded
    if (count > most || is_small) {
      result.intervals.push_back(here);
      continue;
    }
    medium_.split(node);
    open.push(node.low.get());
    open.push(node.high.get());
  }
  result.intervals = joined(std::move(result.intervals), finest * whole);
  for (const Interval& i : result.intervals)
    result.share += whole > 0 ? width_of(i) / whole : 1.0;
  return result;
}

/// Beside undamped resonances: what is within the level is settled, what is not is
/// excluded as soon as it may be.
void ErrorOverBand::exclude(std::vector<Node*> zones, const SmallModel& small,
                            double allowed, Supremum& result) {
  while (!zones.empty()) {
    stop_if_interrupted();
    Node& node = *zones.back();
    zones.pop_back();
    ++result.intervals;
    const Look seen = look(node, &small, allowed);
    if (seen.worst <= allowed) {
      settle(seen, result);
      bool higher = false; // than what is attained: beside the resonance, maybe
      for (std::size_t v = 0; seen.known && v < seen.upper.size(); ++v)
        higher |= seen.upper[v] > 1.1 * result.attained_of[v];
      if (higher)
        for (double omega : {node.interval.first, node.interval.last})
          visit(omega, small, allowed, result);
    } else if (medium_.may_be_excluded(node.interval)) {
      result.excluded.push_back(node.interval);
    } else {
      medium_.split(node);
      zones.push_back(node.low.get());
      zones.push_back(node.high.get());
    }
  }
  result.excluded = joined(std::move(result.excluded));
}

/// What an interval shows belongs to the result.
void ErrorOverBand::settle(const Look& seen, Supremum& result) {
  for (std::size_t v = 0; v < result.worst_of.size(); ++v)
    result.worst_of[v] = std::max(result.worst_of[v], seen.upper[v]);
  result.proved = result.proved && seen.proved;
}

/// The certified error at a frequency, a lower bound of the supremum.
void ErrorOverBand::visit(double omega, const SmallModel& small, double level,
                          Supremum& result) {
  const Point here = point(omega, &small, level);
  result.proved = result.proved && here.proved;
  for (std::size_t v = 0; v < result.attained_of.size(); ++v) {
    if (here.certified[v] <= result.attained_of[v]) continue;
    result.attained_of[v] = here.certified[v];
    result.at_of[v] = omega;
  }
}

ErrorOverBand::Supremum ErrorOverBand::supremum(const DenseSystem& system, double level,
                                                int most) {
  const SmallModel small(system, medium_.model());
  struct Open {
    Node* node;
    Look seen;
    double priority;
    bool operator<(const Open& other) const { return priority < other.priority; }
  };
  const std::size_t views = medium_.model().views.size();
  Supremum result;
  result.worst_of.assign(views, 0.0);
  std::vector<double>& best = result.attained_of;
  best.assign(views, 0.0);
  result.at_of.assign(views, 0.0);
  // Gram matrices tell errors of many ports down to the root of rounding, and no closer for
  // being looked at again: what is `negligible` is left at what it may be at most.
  const double blurred = medium_.model().has_many_ports() ? 0.1 * level : 0.0;
  const auto priority = [&](const Look& seen) {
    double most_promising = 0;
    for (std::size_t v = 0; v < views; ++v)
      if (!(seen.upper[v] <= blurred)) // NaN too
        most_promising = std::max(most_promising, best[v] > 0 ? seen.upper[v] / best[v]
                                                  : seen.upper[v] > 0 ? infinity
                                                                      : 0.0);
    return most_promising;
  };
  std::priority_queue<Open> open;
  std::vector<Node*> zones;
  const auto enter = [&](Node& node) {
    ++result.intervals;
    const double matters = std::max(level, *std::min_element(best.begin(), best.end()));
    Look seen = look(node, &small, matters);
    bool higher = false;
    if (seen.known)
      for (std::size_t v = 0; v < views; ++v) higher |= seen.upper[v] > best[v];
    if (higher) visit(seen.omega, small, matters, result);
    const double now = priority(seen);
    open.push({&node, std::move(seen), now});
  };
  for (const auto& root : medium_.roots())
    if (medium_.near_pole(root->interval))
      zones.push_back(root.get());
    else
      enter(*root);
  while (!open.empty()) {
    stop_if_interrupted();
    const Open top = open.top();
    open.pop();
    // `best` may have risen since; an infinite error at one frequency ends the search.
    const double now = priority(top.seen);
    const bool unbounded =
        std::any_of(best.begin(), best.end(), [](double b) { return b == infinity; });
    // What may be within the level is to be known to be.
    bool open_question = false;
    for (std::size_t v = 0; v < views; ++v)
      open_question |= best[v] <= level && top.seen.upper[v] > level;
    if ((now <= close && !open_question) || unbounded || result.intervals > most ||
        width_of(top.node->interval) <= narrowest * top.node->interval.last) {
      settle(top.seen, result);
      continue;
    }
    medium_.split(*top.node);
    enter(*top.node->low);
    enter(*top.node->high);
  }

  result.worst = largest(result.worst_of);
  const bool nothing_else = zones.size() == medium_.roots().size();
  // Where nothing is claimed elsewhere either, resonances are told apart by the tolerance.
  const bool is_bounded = std::isfinite(result.worst) || level == 0;
  exclude(std::move(zones), small, is_bounded ? std::max(level, result.worst) : level,
          result);
  if (nothing_else && result.worst_of == std::vector<double>(views, 0.0))
    result.worst_of.assign(views, infinity); // all of the band is excluded
  result.worst = largest(result.worst_of);
  // A value at one frequency may come from a looser bound than that of its interval.
  for (std::size_t v = 0; v < views; ++v)
    result.attained_of[v] = std::min(result.attained_of[v], result.worst_of[v]);
  for (std::size_t v = 0; v < views; ++v) { // the errors themselves
    result.worst_of[v] *= allowed(v);
    result.attained_of[v] *= allowed(v);
  }
  result.worst = largest(result.worst_of);
  return result;
}

} // namespace flexgram
