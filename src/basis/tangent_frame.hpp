/// A frame of reference that follows an interface of a free body.

#pragma once

#include "medium/model.hpp"

#include <string>

namespace flexgram {

/// Empty: none.
std::string first_with_six_ports(const MediumModel& medium);

/// V_e − Φ_r (B_iᵀΦ_r)⁻¹ B_iᵀV_e: every elastic vector at rest at the interface; the first six of Q
/// are the rigid ones.
/// @throws Error if there is no such interface, or it has other than six ports.
Dense at_rest_at(const MediumModel& medium, const std::string& interface, const Dense& Q);

} // namespace flexgram
