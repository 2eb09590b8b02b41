#include "model/spec.hpp"

#include <cmath>
#include <limits>

namespace flexgram {

const char* word_of(RelativeTo reference) {
  return reference == RelativeTo::band      ? "band"
         : reference == RelativeTo::elastic ? "elastic"
                                            : "pointwise";
}

int order_by_rule(const std::vector<double>& sigma) {
  const double threshold = std::sqrt(std::numeric_limits<double>::epsilon());
  int order = 1;
  while (order < static_cast<int>(sigma.size()) &&
         sigma[static_cast<std::size_t>(order)] >= threshold * sigma.front())
    ++order;
  return order;
}

} // namespace flexgram
