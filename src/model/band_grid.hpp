#pragma once

#include "model/spec.hpp"

#include <vector>

namespace flexgram {

/// An eigenfrequency and half the width of its peak, both [rad/s].
struct Resonance {
  double omega, half_width;
  /// No solve resolves the peak: intervals beside it may be excluded from a claim.
  bool sharp() const { return half_width < 1e-6 * omega; }
};

/// Frequencies that show the band: evenly spread in ω and in ln ω, both ends, and on and
/// beside every resonance (of an undamped one not closer than 1e-4: there is no response
/// on it). [rad/s], ascending.
std::vector<double> band_grid(double first, double last, int count,
                              const std::vector<Resonance>& resonances);
/// The same for several bands, which share the count.
std::vector<double> band_grid(const std::vector<Interval>& bands, int count,
                              const std::vector<Resonance>& resonances);

} // namespace flexgram
