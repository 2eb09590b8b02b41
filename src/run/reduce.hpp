#pragma once

#include "run/body.hpp"

namespace flexgram {

/// The whole way from a body to its reduced model, by the method that the settings name.
/// @note Collective on the body's communicator.
ReducedModel reduce_body(const Body& body, const Settings& settings, Plan& plan,
                         Monitor& monitor);

/// The verbs reduce and plan.
/// @return true if the tolerance is met, or none was given.
bool reduce(MPI_Comm comm, const Settings& settings, const Options& options,
            Monitor& monitor);
void plan_only(MPI_Comm comm, const Settings& settings, Monitor& monitor);

} // namespace flexgram
