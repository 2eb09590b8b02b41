/// What a user needs to know of a run: what came in, what came out, what is claimed of it and
/// what to do next. The plan tells the rest ({monitor} plan). Used by the other files of run,
/// main and the Python module.

#pragma once

#include "base/observer.hpp"
#include "model/reduced_model.hpp"
#include "model/spec.hpp"

namespace flexgram {

/// "10-500 Hz"
std::string words_of(const std::vector<Interval>& bands);
/// The error over the bands and whether it is proved, in sentences; empty if nothing is known
/// between the frequencies.
std::string words_of(const Claim& claim);

/// What came in, where no plan tells it.
void say_body(const SecondOrderModel& body, const Observer& observer);
/// Orders and the claim.
void say_result(const ReducedModel& rom, const SecondOrderModel& body,
                const Observer& observer);
/// Where the time went and the peak of memory: of a long run, or in the plan. Collective.
void say_time(const Observer& observer, MPI_Comm comm);
/// A command that a new user may want next, where no plan is told.
void say_next(const std::string& command, const Observer& observer);

} // namespace flexgram
