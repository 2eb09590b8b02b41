/// The verb sweep: full solves over frequencies. Called by main.

#pragma once

#include "run/body.hpp"
#include "sampling/frequency_solves.hpp"

namespace flexgram {

/// The verb sweep: H of the full body over frequencies, and the error of a reduced one.
void sweep(MPI_Comm comm, const Settings& settings, const Options& options,
           Observer& observer);

/// What the solves will take, for the plan.
void plan_solves(const FrequencySolves& solves, std::size_t tasks, Observer& observer);

} // namespace flexgram
