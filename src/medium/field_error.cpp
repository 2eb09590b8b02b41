#include "medium/field_error.hpp"

#include "base/index.hpp"
#include "base/process.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <queue>

namespace flexgram {
namespace {

constexpr double infinity = std::numeric_limits<double>::infinity();
/// How close the supremum is to come to an attained value, and after how many intervals
/// it need not.
constexpr double close = 1.05;
constexpr int most = 6000;

/// Some columns of a series.
MatrixSeries columns_of(const MatrixSeries& all, const std::vector<int>& chosen) {
  const int p = static_cast<int>(chosen.size()), parts = all.coefficients.columns;
  MatrixSeries some{p, Dense(all.rows(), parts / all.columns * p), Dense(all.rows(), p)};
  for (int part = 0; part < parts / all.columns; ++part)
    for (int j = 0; j < p; ++j)
      std::copy_n(all.coefficients.column(part * all.columns + chosen[as_size(j)]),
                  all.rows(), some.coefficients.column(part * p + j));
  for (int j = 0; j < p; ++j)
    std::copy_n(all.tail.column(chosen[as_size(j)]), all.rows(), some.tail.column(j));
  return some;
}

/// All of it.
PortView whole(const MatrixSeries& series) {
  PortView view{"", std::vector<int>(as_size(series.rows())),
                std::vector<int>(as_size(series.columns))};
  std::iota(view.rows.begin(), view.rows.end(), 0);
  std::iota(view.columns.begin(), view.columns.end(), 0);
  return view;
}

} // namespace

FieldError::FieldError(MediumOverBand& medium, const Dense& Q, const DenseSystem& small)
    : medium_(medium), small_(small, medium.model().tau),
      lifted_(transpose(multiply(medium.model().strain_coordinates(Q), small_.U()))) {}

/// What the error may be on an interval, and about what it is in the middle.
FieldError::Look FieldError::look(Interval interval, const std::vector<int>& inputs,
                                  const MediumModel::FieldLoads& loads) const {
  const int degree = interval.half() > 0 ? series_degree : 0;
  const auto field = medium_.model().field(interval, degree, loads);
  const auto small = response_series(small_, interval, degree);
  if (!field || !small) return {infinity, infinity, false};
  const MatrixSeries away =
      difference_of(field->x, multiply_transposed(lifted_, columns_of(small->x, inputs)));
  const ViewNorms size = view_norms(field->x, whole(field->x)),
                  differs = view_norms(away, whole(away));
  const auto ratio = [&](double difference, double here) {
    const double error = difference + field->error + field->floor + solve_floor * here,
                 left = here - field->error;
    return left > 0 && error < infinity ? error / left : infinity;
  };
  double upper = 0;
  for (std::size_t i = 0; i < pieces; ++i)
    upper = std::max(upper, ratio(differs.above[i], size.below[i]));
  return {upper, ratio(differs.at[pieces / 2], size.at[pieces / 2]), field->proved};
}

FieldSupremum FieldError::supremum(const std::vector<int>& inputs,
                                   const std::vector<Interval>& excluded) const {
  struct Open {
    Interval interval;
    Look seen;
    bool operator<(const Open& other) const { return seen.upper < other.seen.upper; }
  };
  FieldSupremum result;
  if (!medium_.model().claims_field()) return {infinity, 0, 0, false};
  const MediumModel::FieldLoads loads = medium_.model().field_loads(inputs);
  std::priority_queue<Open> open;
  int count = 0;
  const auto is_excluded = [&](const Interval& interval) {
    return std::any_of(excluded.begin(), excluded.end(), [&](const Interval& e) {
      return interval.first >= e.first && interval.last <= e.last;
    });
  };
  const auto enter = [&](const Interval& interval) {
    if (is_excluded(interval)) return;
    ++count;
    const Look seen = look(interval, inputs, loads);
    const bool higher = seen.at_centre > result.attained && std::isfinite(seen.upper);
    if (const double omega = interval.centre(); higher && !is_excluded({omega, omega})) {
      const double here = look({omega, omega}, inputs, loads).upper;
      if (here > result.attained && std::isfinite(here)) {
        result.attained = here;
        result.at = omega;
      }
    }
    open.push({interval, seen});
  };
  for (const auto& root : medium_.roots()) {
    // Ends of excluded intervals are ends of these too.
    std::vector<double> ends{root->interval.first, root->interval.last};
    for (const Interval& e : excluded)
      for (double omega : {e.first, e.last})
        if (omega > ends.front() && omega < root->interval.last) ends.push_back(omega);
    std::sort(ends.begin(), ends.end());
    if (ends.front() == ends.back()) enter(root->interval);
    for (std::size_t k = 0; k + 1 < ends.size(); ++k)
      if (ends[k] < ends[k + 1]) enter({ends[k], ends[k + 1]});
  }
  while (!open.empty()) {
    stop_if_interrupted();
    const Open top = open.top();
    open.pop();
    const Interval& i = top.interval;
    if (top.seen.upper <= close * result.attained || count > most ||
        i.last - i.first <= 1e-10 * i.last) {
      result.worst = std::max(result.worst, top.seen.upper);
      result.proved = result.proved && top.seen.proved;
      continue;
    }
    enter({i.first, i.centre()});
    enter({i.centre(), i.last});
  }
  result.proved = result.proved && std::isfinite(result.worst);
  return result;
}

} // namespace flexgram
