#pragma once

#include <vector>

namespace flexgram {

/// An eigenfrequency and half the width of its peak, both [rad/s].
struct Resonance {
  double omega, half_width;
};

/// Frequencies that show the band: evenly spread in ω and in ln ω, both ends, and on and
/// beside every resonance (of an undamped one not closer than 1e-4: there is no response
/// on it). [rad/s], ascending.
std::vector<double> band_grid(double first, double last, int count,
                              const std::vector<Resonance>& resonances);

} // namespace flexgram
