/// How strong the gyroscopic forces of a body are beside its inertia (docs/proof.md, section 2).
/// Found once by certify, kept by the certificate.

#pragma once

#include "linalg/shifted_solver.hpp"
#include "model/second_order_model.hpp"

namespace flexgram {

/// ±iG <= mass·M + stiffness·K as Hermitian forms, G the sum of all skew terms. With them the real
/// part of A(ω) is at least (1 − ω stiffness) (K − needed_square(ω) M), so that K − ω_c²M does for
/// frequencies up to ω if ω_c² is no less than that.
struct Gyration {
  double mass = 0;      ///< [rad/s]; of Coriolis forces in a frame that spins at Ω: 2Ω
  double stiffness = 0; ///< [s] far below 1/ω; for dofs that have no mass

  /// [rad²/s²] infinite if ω is too large for this.
  double needed_square(double omega) const {
    const double kept = 1 - omega * stiffness;
    return kept > 0 ? (omega * omega + omega * mass) / kept : HUGE_VAL;
  }
  /// 1/(1 − ω stiffness).
  double enlarges(double omega) const {
    const double kept = 1 - omega * stiffness;
    return kept > 0 ? 1 / kept : HUGE_VAL;
  }
};

/// Proved by the inertia of a real symmetric matrix of twice the order. @param omega  [rad/s] up to
/// where it is needed. @param tau  [rad²/s²] K + τM is positive. @throws Error if gyroscopic forces act on dofs without mass so strongly that
/// no bound is found.
/// @note Collective. Some solves with M + κK, κ small, and a few factorisations; none of a body
/// whose terms are symmetric.
Gyration gyration_of(const SecondOrderModel& body, double omega, double tau,
                     const SolverOptions& options);

} // namespace flexgram
