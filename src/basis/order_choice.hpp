/// Which method at which order: by the certified error, a given order, or the paper's
/// rule (section 2.2). Called by cut.

#pragma once

#include "basis/method.hpp"
#include "medium/error_over_box.hpp"

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

/// By the tolerance: the smallest order whose certified error meets it, of any of the named
/// second stages. If none does because of rounding or of the medium model, the smallest order
/// whose own error (ErrorOverBand::Measure::model_error) meets it: elsewhere in the band the
/// body is then as good as was asked. By a given order: the stage with the smallest certified
/// error. Else by the paper's rule.
/// @throws Error with the reason if the order cannot be had.
OrderChoice choose_order(const std::vector<std::string>& names, const SecondStage& stage,
                         ErrorOverBox& errors, const OrderSpec& order);

} // namespace flexgram
