/// The supremum of the certified error over the bands, and where it is not within a tolerance
/// (docs/proof.md, section 4, "Together").

#include "medium/error_over_band.hpp"

#include "base/process.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <queue>

namespace flexgram {
namespace {

constexpr double infinity = std::numeric_limits<double>::infinity();
/// How close the supremum is to come to an attained value; that of a kind which is far below the
/// tolerance need not be as close.
constexpr double close = 1.05, close_of_small = 1.5, small_share = 0.1;

double largest(const std::vector<double>& values) {
  return *std::max_element(values.begin(), values.end());
}

} // namespace

ErrorOverBand::Unmet ErrorOverBand::unmet(const DenseSystem& system, double tolerance,
                                          double share) {
  constexpr double finest = 1e-6; // of the bands
  // Intervals that are looked at: each costs about the cube of the order, and what is told of
  // the band is worth a minute, not an hour.
  const double order = medium_.model().system.order();
  const double most = share * std::clamp(4e9 / (order * order * order), 300.0, 20000.0);
  const SmallModel small(system, medium_.model());
  double whole = 0;
  const auto narrower = [](const Node* a, const Node* b) {
    return a->interval.width() < b->interval.width();
  };
  // The widest first: if there are too many, what is left is narrow.
  std::priority_queue<Node*, std::vector<Node*>, decltype(narrower)> open(narrower);
  for (const auto& root : medium_.roots()) {
    whole += root->interval.width();
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
      return failed == 3 || (failed > 0 && here.width() <= finest * whole);
    };
    const bool is_small = node.is_shortest() ||
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
    result.share += whole > 0 ? i.width() / whole : 1.0;
  return result;
}

/// Beside undamped resonances: what is proved to be within the level is settled, what is not is
/// excluded as soon as it may be.
void ErrorOverBand::exclude(std::vector<Node*> zones, const SmallModel& small,
                            double allowed, Supremum& result) {
  while (!zones.empty()) {
    stop_if_interrupted();
    Node& node = *zones.back();
    zones.pop_back();
    ++result.intervals;
    const Look seen = look(node, &small, allowed);
    if (seen.worst <= allowed && seen.proved) {
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
  // Gram matrices lose half the digits of the errors of many ports. Intervals whose error is below
  // this level keep their upper bound: refining them cannot sharpen it.
  const double blurred = medium_.model().has_many_ports() ? 0.1 * level : 0.0;
  const auto priority = [&](const Look& seen) {
    double most_promising = 0;
    for (std::size_t v = 0; v < views; ++v) {
      if (seen.upper[v] <= blurred) continue; // NaN is not
      double ratio = best[v] > 0         ? seen.upper[v] / best[v]
                     : seen.upper[v] > 0 ? infinity
                                         : 0.0;
      if (v > 0 && seen.upper[v] <= small_share * level) ratio *= close / close_of_small;
      most_promising = std::max(most_promising, ratio);
    }
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
        top.node->is_shortest()) {
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
