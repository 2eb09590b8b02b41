/// What gyroscopic forces, and terms that are not positive semidefinite, may take from K − ω²M
/// (docs/proof.md, section 2). Found once by certify, kept by the certificate.

#pragma once

#include "linalg/shifted_solver.hpp"
#include "model/second_order_model.hpp"

#include <algorithm>
#include <cmath>

namespace flexgram {

/// How much of mass and stiffness is taken, at most, as Hermitian forms and with all values of the
/// body's parameters:
///
///     ±iG <= gyration·M + gyration_stiffness·K, G the sum of all skew terms,
///     −Σ g T <= mass·M + stiffness·K, the sum over the others that have no sign.
///
/// With them the real part of A(ω) is at least (1 − stiffness − ω gyration_stiffness) (K −
/// needed_square(ω) M), so that K − ω_c²M does for frequencies up to ω if ω_c² is no less than that.
struct Softening {
  double gyration = 0; ///< [rad/s]; of Coriolis forces in a frame that spins at Ω: 2Ω
  double gyration_stiffness = 0; ///< [s] far below 1/ω; for dofs that have no mass
  double mass = 0;               ///< [rad²/s²]; of a spin about Ω²
  double stiffness = 0;          ///< far below 1

  bool any() const { return gyration > 0 || mass > 0 || stiffness > 0; }
  /// [rad²/s²] infinite if ω is too large for this.
  double needed_square(double omega) const {
    const double left = kept(omega);
    return left > 0 ? (omega * omega + omega * gyration + mass) / left : HUGE_VAL;
  }
  /// 1/(1 − stiffness − ω gyration_stiffness).
  double enlarges(double omega) const {
    const double left = kept(omega);
    return left > 0 ? 1 / left : HUGE_VAL;
  }
  /// [rad²/s²] K + Σ g T + τM is positive with it, if K + `tau` M is.
  double stabilised(double tau) const {
    return std::max(tau, mass + tau * (1 - stiffness));
  }

private:
  double kept(double omega) const { return 1 - stiffness - omega * gyration_stiffness; }
};

/// Proved by inertias: of G by that of a real symmetric matrix of twice the order.
/// @param omega  [rad/s] up to where it is needed. @param tau  [rad²/s²] K + τM is positive.
/// @throws Error if such forces act on dofs without mass so strongly that no bound is found.
/// @note Collective. Some solves with M + κK, κ small, and a few factorisations; none of a body
/// whose terms are positive semidefinite.
Softening softening_of(const SecondOrderModel& body, double omega, double tau,
                       const SolverOptions& options);

} // namespace flexgram
