#include "model/spec.hpp"

#include "base/index.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

namespace flexgram {

std::vector<Interval> joined(std::vector<Interval> intervals, double gap) {
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

const char* word_of(RelativeTo reference) {
  return reference == RelativeTo::band      ? "band"
         : reference == RelativeTo::elastic ? "elastic"
         : reference == RelativeTo::both    ? "both"
                                            : "pointwise";
}

double OrderSpec::smallest() const {
  double least = *tolerance;
  for (const auto& [kind, own] : of_kinds) least = std::min(least, own);
  return least;
}

KindSpec OrderSpec::kinds() const {
  KindSpec spec;
  spec.each = tolerance && each_kind;
  if (!spec.each || of_kinds.empty()) return spec;
  spec.others = *tolerance / smallest();
  for (const auto& [kind, own] : of_kinds) {
    spec.kinds.push_back(kind);
    spec.allowed.push_back(own / smallest());
  }
  return spec;
}

int order_by_rule(const std::vector<double>& sigma) {
  const double threshold = std::sqrt(std::numeric_limits<double>::epsilon());
  int order = 1;
  while (order < static_cast<int>(sigma.size()) &&
         sigma[as_size(order)] >= threshold * sigma.front())
    ++order;
  return order;
}

} // namespace flexgram
