/// Many modes below a cutoff, and what the responses need beside them, by block Lanczos with the
/// shift-inverted operator S = (K − σM)⁻¹M (Ericsson and Ruhe 1980; Grimes, Lewis and Simon 1994),
/// each block orthogonal to all before it. Called by modal_space.cpp.

#pragma once

#include "base/observer.hpp"
#include "linalg/orthonormal.hpp"
#include "medium/factors.hpp"

#include <vector>

namespace flexgram {

/// What is searched for.
struct LanczosSpec {
  InnerProduct product; ///< W, in which S is symmetric
  double shift = 0;     ///< σ [rad²/s²]
  double cutoff = 0;    ///< ω_c² [rad²/s²], no less than σ
  int expected = 0;     ///< modes below it, without those that are deflated
  double enough = 1e-2; ///< about the angle that may be left of each
  /// So many first columns of the start are the responses (K − ω_c²M)⁻¹B, of equal weight.
  int ports = 0;
  std::vector<double> samples =
      {};                   ///< ω² [rad²/s²] of further responses to the same loads
  double negligible = 1e-4; ///< part of these, beside the modes, that may be dropped
  int most = 0;             ///< columns of the Krylov space at most
};

/// What was found; W-orthonormal but for rounding.
struct LanczosModes {
  Block modes;                ///< Ritz vectors of the modes below the cutoff
  std::vector<double> lambda; ///< [rad²/s²] of those that are found to the angle
  /// Directions of the responses that the modes do not hold, the weighty ones first.
  Block beside;
  int columns = 0;       ///< of the Krylov space that they come from
  int solves = 0;        ///< right-hand sides
  bool complete = false; ///< all that were expected, each to the angle
};

/// @param factors   of K − σM.
/// @param deflated  modes that are known, W-orthonormal; may be empty.
/// @param start     the first block, n × b.
/// @return what was found when the modes were complete, or the space was full or exhausted. No
/// Ritz value is below the cutoff without an eigenvalue (Cauchy): more than expected are a
/// miscount.
/// @note Collective.
LanczosModes lanczos_modes(const LanczosSpec& spec, RealFactors& factors,
                           const Block& deflated, Block start, Observer& observer);

} // namespace flexgram
