/// Which loads a reduction is for, where not for each port by itself. Used by run/reduce.

#pragma once

#include "run/body.hpp"

namespace flexgram {

/// The loads that -mor_loads names or -mor_load_patterns finds; nothing: each port by
/// itself. Collective.
std::optional<LoadSpan> loads_of(const Body& body, const Settings& settings,
                                 Observer& observer);

} // namespace flexgram
