#pragma once

#include "base/monitor.hpp"
#include "reduce/medium_space.hpp"

#include <functional>

namespace flexgram {

/// The eigenpairs of (K, M) below a cutoff that a space holds.
struct FoundModes {
  std::vector<double> lambda; ///< [rad²/s²], ascending, without the space's rigid modes
  /// Sine of the angle between each mode's exact eigenspace and the space, in the norm of
  /// K + τM.
  std::vector<double> angle;
  int solves = 0; ///< right-hand sides
};

/// Extends the space until it holds every mode below sigma, and rotates it so that these
/// modes are the columns after the rigid ones. Block Rayleigh-Ritz with the
/// shift-inverted operator S = (K − σM)⁻¹M: for a Ritz pair (λ, φ), d = φ − (λ − σ) S φ
/// is both the direction that the space lacks and the proof of its accuracy: modes below
/// σ have negative eigenvalues 1/(λ − σ) of S, all others positive ones, so sin ∠ ≤
/// ‖d‖/‖φ‖ whatever the clustering (Davis, Kahan). Each round applies S to the Ritz
/// vectors that are not yet good, to the next ones above σ and to random vectors while
/// modes are missing.
/// @param[in] factor    holds K − σM, with its pivots counted.
/// @param[in] allowed   the largest sine that will do for a mode with eigenvalue λ.
/// @param[in] expected  modes below σ by Sylvester's law, without the rigid modes of the
/// space.
/// @throws Error if a mode that the inertia counts cannot be found, or if there are more.
/// @note Collective.
FoundModes find_modes(MediumSpace& space, ShiftedSolver& factor, double sigma,
                      int expected, const std::function<double(double)>& allowed,
                      Monitor& monitor);

} // namespace flexgram
