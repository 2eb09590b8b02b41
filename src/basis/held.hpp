/// What an engineer checks of a free body that joints will hold: its frequencies and its static
/// compliance with each interface held, small against medium model.

#pragma once

#include "medium/model.hpp"
#include "model/reduced_model.hpp"

namespace flexgram {

/// Each interface with ports for forces or moments in turn, as far as the dense work is small.
/// @param last  [rad/s] frequencies up to this are compared.
/// @return  none of a body with parameters; those that leave the body no rigid motion when they are held.
std::vector<HeldInterface> held_interfaces(const MediumModel& medium,
                                           const DenseSystem& small, double last);

/// In words, for the plan; empty if there are none.
std::string held_words(const std::vector<HeldInterface>& held);

} // namespace flexgram
