/// Converged position Gramians of a small system (Fehr, Eberhard, Lehner, eqs. 5, 8, 11).
/// Called by methods.

#pragma once

#include "model/dense_system.hpp"
#include "model/quadrature.hpp"

namespace flexgram {

/// A weight over the frequency: piecewise linear through (ω, w) points, zero outside
/// them.
struct BandWeight {
  std::vector<double> omega, weight;
  double at(double w) const;
  static BandWeight flat(double first, double last) {
    return {{first, last}, {1.0, 1.0}};
  }
};

/// A factor F with FFᵀ = P of the position Gramian of a small system, in its own
/// coordinates,
///   P = (1/π) ∫ w(ω) Q̃ Q̃ᵀ dω
/// (Fehr, Eberhard, Lehner, eqs. 8 and 11; eq. 5 over the whole axis).
/// Gauss rules on intervals no longer than their distance to the nearest pole: converged
/// to about 1e-12 whatever the damping, and nothing is squared. With proportional damping
/// the response is diag(1/a_i) B in modal coordinates, so the rule is applied to the
/// 1/a_i alone. An undamped body's Gramian does not exist over a resonance: it gets a
/// loss factor of 1 % for this purpose.
/// @param equal_ports  each port's part is divided by its norm in M, so that ports weigh
/// alike.
/// @param half_the_digits  eigenvalues of the Gramian below ε of the largest need not be
/// known: without a damping matrix the price is then without the ports.
/// @return N × at most N.
Dense gramian_factor(const DenseResponse& response, const std::vector<BandWeight>& bands,
                     bool equal_ports, bool half_the_digits = false);

/// The same over the whole axis, 0 to ∞ (eq. 5), of a body without rigid modes.
Dense whole_axis_factor(const DenseResponse& response, bool equal_ports);

} // namespace flexgram
