/// The verbs reduce, certify, cut and plan, and their parts for Python. Called by main
/// and the Python module.

#pragma once

#include "medium/medium.hpp"
#include "run/body.hpp"

namespace flexgram {

/// The first step: the certified medium model of a body, by as much as the settings ask.
/// @param keep  for later cuts: all levels, and what a moving frame needs of the whole
/// medium space.
/// @note Collective on the body's communicator, like the next.
Medium certify_body(const Body& body, const Settings& settings, bool keep,
                    Observer& observer, const CheckpointSpec& checkpoint = {});
/// The second step. @throws Error for a method that does not go through a medium model.
ReducedModel cut_medium(const Medium& medium, const Settings& settings,
                        Observer& observer);
/// Both, or the paper's first route: the whole way from a body to its reduced model.
ReducedModel reduce_body(const Body& body, const Settings& settings, Observer& observer,
                         const CheckpointSpec& checkpoint = {});

/// What a medium model is, for the plan.
void tell_medium(const Medium& medium, Observer& observer);
/// Writes the medium model with its provenance.
void write_medium_file(const Medium& medium, const Settings& settings,
                       const Options& options, Observer& observer,
                       const std::string& path);

/// The verbs.
/// @return true if the tolerance is met, or none was given.
bool reduce(MPI_Comm comm, Settings& settings, const Options& options,
            Observer& observer);
bool cut(MPI_Comm comm, Settings& settings, const Options& options, Observer& observer);
void certify(MPI_Comm comm, Settings& settings, const Options& options,
             Observer& observer);
void plan_only(MPI_Comm comm, Settings& settings, const Options& options,
               Observer& observer);

} // namespace flexgram
