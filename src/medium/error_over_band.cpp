#include "medium/error_over_band.hpp"

#include "medium/view_norms.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <queue>

namespace flexgram {
namespace {

constexpr double infinity = std::numeric_limits<double>::infinity();
/// A factorisation of the full body tells H to no more digits than this.
constexpr double solve_floor = 1e-11;
/// Beside sharp resonances intervals may be excluded, no farther from the pole than `zone`
/// of its frequency, and looked at no closer than `nearest`, or a tenth of the half width.
constexpr double zone = 1e-4, nearest = 1e-7;
/// Relative length of intervals that are not halved any more.
constexpr double narrowest = 1e-10;
/// Degree of the polynomials, and how close the supremum is to come to an attained value.
constexpr int degree = 12;
constexpr double close = 1.05;
/// What is kept of the medium model's series; more is computed again.
constexpr std::size_t most_kept = 32u << 20; // numbers: 256 MB

double width_of(const Interval& interval) { return interval.last - interval.first; }

} // namespace

/// An interval and what the medium model says of it; halved when that is not enough.
struct ErrorOverBand::Node {
  Interval interval;
  std::unique_ptr<Node> low, high;
  bool seen = false, kept = false, proved = true;
  std::optional<MatrixSeries> H;    ///< none: a pole is too near
  std::vector<double> bound, floor; ///< of each view, in the unit of H; its rounding
  std::vector<ViewNorms> size;      ///< of each view
};

struct ErrorOverBand::Look {
  std::vector<double> upper; ///< of each view
  double worst = infinity;
  double omega = 0;   ///< where the error seems largest
  bool known = false; ///< no pole is too near for a bound
  bool proved = true;
};

double ErrorOverBand::Point::worst() const {
  return *std::max_element(certified.begin(), certified.end());
}

ErrorOverBand::ErrorOverBand(const MediumModel& medium, std::vector<Interval> bands,
                             std::vector<double> grid, RelativeTo relative_to)
    : medium_(medium), relative_to_(relative_to), omega_(std::move(grid)) {
  for (const PortView& view : medium.views) views_.push_back({view, 0, {}, {}, {}});
  for (double omega : omega_) {
    MediumModel::Value value = medium.at(omega);
    for (std::size_t v = 0; v < views_.size(); ++v) {
      Seen& seen = views_[v];
      const Certificate::Bound& bound = value.bounds[v];
      const double size = frobenius_norm(seen.view.of(value.H)),
                   floor = bound.floor + solve_floor * size;
      seen.size.push_back(size);
      seen.bound.push_back(bound.error + floor);
      seen.floor.push_back(floor / size);
      assumed_ = std::max(assumed_, bound.assumed / size);
      if (bound.proved) seen.largest = std::max(seen.largest, size - seen.bound.back());
    }
    H_.push_back(std::move(value.H));
  }
  for (const Resonance& r : medium.resonances)
    if (r.sharp())
      sharp_.push_back({{r.omega * (1 - zone), r.omega * (1 + zone)},
                        r.omega,
                        r.half_width > 10 * narrowest * r.omega ? 0.1 * r.half_width
                                                                : nearest * r.omega});
  for (const Interval& band : bands) {
    // Zones of exclusion are intervals of their own.
    std::vector<double> ends{band.first, band.last};
    for (const Sharp& s : sharp_)
      for (double end : {s.zone.first, s.zone.last})
        if (end > band.first && end < band.last) ends.push_back(end);
    std::sort(ends.begin(), ends.end());
    for (std::size_t i = 0; i + 1 < ends.size(); ++i) {
      const double whole = ends[i + 1] - ends[i];
      const int count =
          1 + static_cast<int>(31 * whole / std::max(width_of(band), 1e-300));
      for (int l = 0; l < count; ++l) {
        auto node = std::make_unique<Node>();
        node->interval = {ends[i] + whole * l / count,
                          l + 1 == count ? ends[i + 1]
                                         : ends[i] + whole * (l + 1) / count};
        roots_.push_back(std::move(node));
      }
    }
    if (width_of(band) == 0) {
      roots_.push_back(std::make_unique<Node>());
      roots_.back()->interval = band;
    }
  }
}

ErrorOverBand::~ErrorOverBand() = default;

double ErrorOverBand::ratio(std::size_t view, double difference, double size,
                            double bound) const {
  const double known =
      relative_to_ == RelativeTo::band ? views_[view].largest : size - bound;
  const double most = difference + bound;
  return known > 0 && most < infinity ? most / known : infinity; // NaN too
}

double ErrorOverBand::certified(const Seen& seen, std::size_t l,
                                const ComplexDense& H_r) const {
  double sum = 0;
  for (int j : seen.view.columns)
    for (int i : seen.view.rows) sum += std::norm(H_[l](i, j) - H_r(i, j));
  return ratio(static_cast<std::size_t>(&seen - views_.data()), std::sqrt(sum),
               seen.size[l], seen.bound[l]);
}

double ErrorOverBand::least() const {
  double least = 0;
  for (std::size_t v = 0; v < views_.size(); ++v)
    for (std::size_t l = 0; l < omega_.size(); ++l)
      least = std::max(least, ratio(v, 0, views_[v].size[l], views_[v].bound[l]));
  return least;
}

double ErrorOverBand::largest_floor() const {
  double largest = 0;
  for (const Seen& seen : views_)
    for (double floor : seen.floor) largest = std::max(largest, floor);
  return largest;
}

ErrorOverBand::Errors ErrorOverBand::of(const DenseSystem& small) const {
  const DenseResponse response(small, medium_.tau);
  Errors errors;
  errors.worst_of.assign(views_.size(), 0.0);
  for (std::size_t l = 0; l < omega_.size(); ++l) {
    const ComplexDense H_r = response.transfer(omega_[l]);
    for (std::size_t v = 0; v < views_.size(); ++v) {
      const double bound = certified(views_[v], l, H_r);
      errors.worst_of[v] = std::max(errors.worst_of[v], bound);
      if (bound > errors.worst) {
        errors.worst = bound;
        errors.at = omega_[l];
      }
      if (v > 0) continue;
      ComplexDense difference = H_[l];
      for (std::size_t i = 0; i < difference.data.size(); ++i)
        difference.data[i] -= H_r.data[i];
      errors.relative.push_back(frobenius_norm(difference) / views_[v].size[l]);
      errors.bound.push_back(bound);
    }
  }
  return errors;
}

/// The certified errors at one frequency.
ErrorOverBand::Point ErrorOverBand::point(double omega,
                                          const DenseResponse* small) const {
  Point result{std::vector<double>(views_.size(), infinity), true};
  const auto medium = medium_.over({omega, omega}, 0);
  if (!medium) return result;
  MatrixSeries difference;
  if (small) {
    const auto series = response_series(*small, {omega, omega}, 0);
    if (!series) return result;
    difference =
        difference_of(medium->H, multiply_transposed(small->modal_outputs(), series->x));
  }
  for (std::size_t v = 0; v < views_.size(); ++v) {
    const PortView& view = views_[v].view;
    const ViewNorms size = view_norms(medium->H, view);
    const Certificate::Bound& bound = medium->bounds[v];
    result.certified[v] =
        ratio(v, small ? view_norms(difference, view).above[0] : 0.0, size.below[0],
              bound.error + (small ? bound.floor + solve_floor * size.above[0] : 0.0));
    result.proved = result.proved && bound.proved;
  }
  return result;
}

/// The medium model over an interval: nothing if it is too long for a series, or for a
/// proof that there is at its centre.
std::optional<MediumModel::Stretch>
ErrorOverBand::provable_over(const Interval& interval) const {
  auto medium = medium_.over(interval, degree);
  const auto proved = [](const MediumModel::Stretch& stretch) {
    return std::all_of(stretch.bounds.begin(), stretch.bounds.end(),
                       [](const Certificate::Bound& bound) { return bound.proved; });
  };
  if (!medium || proved(*medium) || width_of(interval) == 0) return medium;
  const double centre = interval.centre();
  const auto there = medium_.over({centre, centre}, 0);
  if (there && proved(*there)) return std::nullopt;
  return medium;
}

ErrorOverBand::Look ErrorOverBand::look(Node& node, const DenseResponse* small) {
  Look look{std::vector<double>(views_.size(), infinity), infinity,
            node.interval.centre(), false, true};
  if (!node.seen) {
    node.seen = true;
    if (auto medium = provable_over(node.interval)) {
      for (std::size_t v = 0; v < views_.size(); ++v) {
        node.size.push_back(view_norms(medium->H, views_[v].view));
        const Certificate::Bound& bound = medium->bounds[v];
        const auto& above = node.size.back().above;
        node.bound.push_back(bound.error);
        node.floor.push_back(bound.floor +
                             solve_floor * *std::max_element(above.begin(), above.end()));
        node.proved = node.proved && bound.proved;
      }
      node.H = std::move(medium->H);
    }
  }
  if (!node.H) return look;
  MatrixSeries difference;
  if (small) {
    const auto series = response_series(*small, node.interval, degree);
    if (!series) return look;
    difference =
        difference_of(*node.H, multiply_transposed(small->modal_outputs(), series->x));
  }
  look.known = true;
  look.worst = 0;
  look.proved = node.proved;
  double largest = -1;
  for (std::size_t v = 0; v < views_.size(); ++v) {
    const ViewNorms away = small ? view_norms(difference, views_[v].view) : ViewNorms();
    const double bound = node.bound[v] + (small ? node.floor[v] : 0.0);
    look.upper[v] = 0;
    for (std::size_t i = 0; i < pieces; ++i)
      look.upper[v] =
          std::max(look.upper[v], ratio(v, away.above[i], node.size[v].below[i], bound));
    look.worst = std::max(look.worst, look.upper[v]);
    for (std::size_t i = 0; i <= pieces; ++i) {
      const double here =
          ratio(v, away.at[i] + (small ? 0.0 : bound), node.size[v].at[i], 0);
      if (here <= largest) continue;
      largest = here;
      look.omega =
          node.interval.first + width_of(node.interval) * static_cast<double>(i) / pieces;
    }
  }
  if (!node.kept && kept_ + node.H->coefficients.data.size() > most_kept) {
    node.seen = false;
    node.proved = true;
    node.H.reset();
    node.bound.clear();
    node.floor.clear();
    node.size.clear();
  } else if (!node.kept) {
    node.kept = true;
    kept_ += node.H->coefficients.data.size();
  }
  return look;
}

void ErrorOverBand::split(Node& node) const {
  if (node.low) return;
  const double middle = node.interval.centre();
  node.low = std::make_unique<Node>();
  node.high = std::make_unique<Node>();
  node.low->interval = {node.interval.first, middle};
  node.high->interval = {middle, node.interval.last};
}

/// In the zone of a sharp resonance, and short beside the distance from its pole.
bool ErrorOverBand::may_be_excluded(const Interval& interval) const {
  return std::any_of(sharp_.begin(), sharp_.end(), [&](const Sharp& s) {
    const double distance =
        std::max({interval.first - s.pole, s.pole - interval.last, 0.0});
    return s.holds(interval) &&
           width_of(interval) <= std::max(0.25 * distance, s.nearest);
  });
}

bool ErrorOverBand::near_pole(const Interval& interval) const {
  return std::any_of(sharp_.begin(), sharp_.end(),
                     [&](const Sharp& s) { return s.holds(interval); });
}

bool ErrorOverBand::meets(const DenseSystem& system, double tolerance) {
  const DenseResponse small(system, medium_.tau);
  const auto fails = [&](std::size_t l) {
    const ComplexDense H_r = small.transfer(omega_[l]);
    return std::any_of(views_.begin(), views_.end(), [&](const Seen& seen) {
      return !(certified(seen, l, H_r) <= tolerance);
    });
  };
  for (double omega : hard_omega_)
    if (!(point(omega, &small).worst() <= tolerance)) return false;
  if (!hard_.empty() && fails(hard_.front())) return false;
  // Far apart first: a failure is found early.
  for (std::size_t step = 16, first = 0; step >= 1; step /= 2, first = step)
    for (std::size_t l = first; l < omega_.size(); l += first == 0 ? step : 2 * step)
      if (fails(l)) {
        hard_.assign(1, l);
        return false;
      }
  const std::optional<double> worse = exceeds(&small, tolerance); // between them
  if (!worse) return true;
  hard_omega_.insert(hard_omega_.begin(), *worse);
  if (hard_omega_.size() > 8) hard_omega_.pop_back();
  return false;
}

std::optional<double> ErrorOverBand::weak_spot(double tolerance) {
  return exceeds(nullptr, tolerance);
}

/// A frequency where the certified error of the small model, or of the medium model
/// itself without rounding, is not proved to be within the tolerance.
std::optional<double> ErrorOverBand::exceeds(const DenseResponse* small,
                                             double tolerance) {
  std::vector<Node*> open;
  for (const auto& root : roots_) open.push_back(root.get());
  for (int count = 0; !open.empty(); ++count) {
    Node& node = *open.back();
    open.pop_back();
    const Look seen = look(node, small);
    if (seen.worst <= tolerance) continue;
    if (may_be_excluded(node.interval)) continue;
    if (!near_pole(node.interval) && seen.known &&
        !(point(seen.omega, small).worst() <= tolerance))
      return seen.omega;
    if (width_of(node.interval) <= narrowest * node.interval.last || count > 20000)
      return node.interval.centre();
    split(node);
    open.push_back(node.low.get());
    open.push_back(node.high.get());
  }
  return std::nullopt;
}

/// Beside undamped resonances: what is within the level is settled, what is not is
/// excluded as soon as it may be.
void ErrorOverBand::exclude(std::vector<Node*> zones, const DenseResponse& small,
                            double allowed, Supremum& result) {
  while (!zones.empty()) {
    Node& node = *zones.back();
    zones.pop_back();
    ++result.intervals;
    const Look seen = look(node, &small);
    if (seen.worst <= allowed) {
      settle(seen, result);
    } else if (may_be_excluded(node.interval)) {
      result.excluded.push_back(node.interval);
    } else {
      split(node);
      zones.push_back(node.low.get());
      zones.push_back(node.high.get());
    }
  }
  std::sort(result.excluded.begin(), result.excluded.end(),
            [](const Interval& a, const Interval& b) { return a.first < b.first; });
  std::vector<Interval> joined;
  for (const Interval& e : result.excluded)
    if (!joined.empty() && e.first <= joined.back().last)
      joined.back().last = std::max(joined.back().last, e.last);
    else
      joined.push_back(e);
  result.excluded = std::move(joined);
}

/// What an interval shows belongs to the result.
void ErrorOverBand::settle(const Look& seen, Supremum& result) {
  for (std::size_t v = 0; v < result.worst_of.size(); ++v)
    result.worst_of[v] = std::max(result.worst_of[v], seen.upper[v]);
  result.proved = result.proved && seen.proved;
}

ErrorOverBand::Supremum ErrorOverBand::supremum(const DenseSystem& system, double level,
                                                RelativeTo relative_to, int most) {
  std::swap(relative_to_, relative_to); // until the end: nodes hold norms, not ratios
  const DenseResponse small(system, medium_.tau);
  struct Open {
    Node* node;
    Look seen;
    double priority;
    bool operator<(const Open& other) const { return priority < other.priority; }
  };
  Supremum result;
  result.worst_of.assign(views_.size(), 0.0);
  std::vector<double>& best = result.attained_of;
  best.assign(views_.size(), 0.0);
  result.at_of.assign(views_.size(), 0.0);
  const auto visit = [&](double omega) {
    const Point here = point(omega, &small);
    result.proved = result.proved && here.proved;
    for (std::size_t v = 0; v < views_.size(); ++v) {
      if (here.certified[v] <= best[v]) continue;
      best[v] = here.certified[v];
      result.at_of[v] = omega;
    }
  };
  const auto priority = [&](const Look& seen) {
    double largest = 0;
    for (std::size_t v = 0; v < views_.size(); ++v)
      largest = std::max(largest, best[v] > 0         ? seen.upper[v] / best[v]
                                  : seen.upper[v] > 0 ? infinity
                                                      : 0.0);
    return largest;
  };
  std::priority_queue<Open> open;
  std::vector<Node*> zones;
  const auto enter = [&](Node& node) {
    ++result.intervals;
    Look seen = look(node, &small);
    bool higher = false;
    if (seen.known)
      for (std::size_t v = 0; v < views_.size(); ++v) higher |= seen.upper[v] > best[v];
    if (higher) visit(seen.omega);
    const double now = priority(seen);
    open.push({&node, std::move(seen), now});
  };
  for (const auto& root : roots_)
    if (near_pole(root->interval))
      zones.push_back(root.get());
    else
      enter(*root);
  while (!open.empty()) {
    const Open top = open.top();
    open.pop();
    // `best` may have risen since; an infinite error at one frequency ends the search.
    const double now = priority(top.seen);
    const bool unbounded =
        std::any_of(best.begin(), best.end(), [](double b) { return b == infinity; });
    // What may be within the level is to be known to be.
    bool open_question = false;
    for (std::size_t v = 0; v < views_.size(); ++v)
      open_question |= best[v] <= level && top.seen.upper[v] > level;
    if ((now <= close && !open_question) || unbounded || result.intervals > most ||
        width_of(top.node->interval) <= narrowest * top.node->interval.last) {
      settle(top.seen, result);
      continue;
    }
    split(*top.node);
    enter(*top.node->low);
    enter(*top.node->high);
  }

  result.worst = *std::max_element(result.worst_of.begin(), result.worst_of.end());
  const bool nothing_else = zones.size() == roots_.size();
  exclude(std::move(zones), small, std::max(level, result.worst), result);
  if (nothing_else && result.worst_of == std::vector<double>(views_.size(), 0.0))
    result.worst_of.assign(views_.size(), infinity); // all of the band is excluded
  result.worst = *std::max_element(result.worst_of.begin(), result.worst_of.end());
  std::swap(relative_to_, relative_to);
  return result;
}

} // namespace flexgram
