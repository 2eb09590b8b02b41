/// Reading, planning and checking a body, and what verbs have in common. Used by
/// run/reduce, run/sweep, main and the Python module.

#pragma once

#include "base/observer.hpp"
#include "model/checks.hpp"
#include "run/settings.hpp"

namespace flexgram {

/// A body, and whether it was assembled here.
struct Body {
  SecondOrderModel model;
  bool assembled = false;
};

/// Reads or assembles the body file, keeps the ports asked for and begins the plan.
/// Collective.
Body load_body(MPI_Comm comm, const Settings& settings, Observer& observer);

/// Keeps the ports asked for and begins the plan of a body that is already there.
void begin_plan(Body& body, const Settings& settings, Observer& observer);

/// The checks that the chosen method needs.
BodyFacts check(const Body& body, const Settings& settings, Observer& observer);

/// Refuses an output that cannot be written or would replace an input, before any work.
void check_output(MPI_Comm comm, const std::string& path,
                  const std::vector<std::string>& inputs);

/// Stages with their seconds, and the peak of memory.
void print_summary(const Observer& observer, MPI_Comm comm);

} // namespace flexgram
