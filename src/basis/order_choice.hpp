/// Which method at which order: by the certified error, a given order, or the paper's
/// rule (section 2.2). Called by cut.

#pragma once

#include "basis/method.hpp"
#include "medium/error_over_band.hpp"

namespace flexgram {

/// Smallest order of a candidate that is good enough; 0 if none up to `most` is. For
/// nested bases every order up to 64 is tried, so m − 1 is not; then, and of others,
/// orders are halved: m − 1 is not, one below that may be.
int smallest_order(const Candidate& candidate, const MediumModel& medium, int most,
                   const std::function<bool(const DenseSystem&)>& good);

/// Which second stage at which order, and in words why.
struct OrderChoice {
  std::vector<Candidate> candidates;
  std::size_t best = 0;
  int order = 0;
  std::string chosen_by, tried;
  std::string shortfall; ///< why the tolerance is not met; empty: it is, or there is none
};

/// By the tolerance: the smallest order that any of the named second stages needs, or if
/// none meets it the smallest that comes about as close as any; by a given order: the
/// stage with the smallest certified error; else by the paper's rule.
/// @throws Error with the reason if the order cannot be had.
OrderChoice choose_order(const std::vector<std::string>& names, const SecondStage& stage,
                         ErrorOverBand& errors, const OrderSpec& order);

} // namespace flexgram
