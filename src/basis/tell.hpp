/// What the second step says of its result. Called by cut.cpp.

#pragma once

#include "basis/cut.hpp"
#include "basis/order_choice.hpp"

namespace flexgram {

/// A cut from beginning to end.
struct CutStory {
  const Medium& whole;
  const CutRequest& request;
  MediumOverBand& seen; ///< keeps what it is asked for
  const OrderChoice& choice;
  const DenseSystem& small;
  const ErrorOverBox::Supremum& sup;
  /// What errors are relative to: `both` only of a body that has an elastic part.
  RelativeTo relative_to() const { return resolved(request.relative_to, whole); }
};

/// Order, error in words, reduced modes: the facts of the plan, and a warning where the
/// tolerance is not met. Prints the plan.
void tell(const CutStory& cut, const ReducedModel& rom, Observer& observer);

} // namespace flexgram
