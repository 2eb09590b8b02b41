/// What an unfinished `certify` leaves behind, for one that goes on. Called by resume.cpp
/// alone.

#pragma once

#include "linalg/basis.hpp"
#include "medium/medium.hpp"

#include <optional>

namespace flexgram {

/// What `certify` has finished beside the levels of the medium model: the space.
struct CheckpointState {
  Basis V;           ///< W-orthonormal
  Dense K, D, ports; ///< VᵀKV, VᵀDV and Vᵀ[B, C], scaled: what tells bodies apart
  Block image; ///< (K − ω_c²M)⁻¹T of the last level: the next Krylov block; or empty
  Dense rigid_stiffness; ///< among rigid modes, as the stored K has it (MediumSpace)
  int geometric = 0, blocks = 0;
  bool inertia_is_safe = false;
  /// Of slow modes: those judged to be no rigid ones; whether all were found exactly.
  int judged_elastic = 0;
  bool exact_modes = false;
  std::vector<double> grid; ///< [rad/s]
  double least_eigenvalue = 0, of_rounding = 0;
};

/// Writes the medium model so far and the state beside the output, whole or not at all.
/// Collective.
void write_checkpoint(const Medium& medium, const CheckpointState& state,
                      const SecondOrderModel& body, const std::string& path);

/// Both, rows as this run has them: a body assembled on another number of ranks has them
/// in another order. @return nothing if there is no such file.
/// @param medium  becomes what it was, without V.
/// @throws Error naming the difference if it is of another body, band, ports or version.
/// Collective.
std::optional<CheckpointState> read_checkpoint(const SecondOrderModel& body,
                                               const CertifySpec& spec,
                                               const std::string& path, Medium& medium);

} // namespace flexgram
