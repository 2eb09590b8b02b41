#include "model/band_grid.hpp"

#include <algorithm>
#include <cmath>

namespace flexgram {

std::vector<double> band_grid(double first, double last, int count,
                              const std::vector<Resonance>& resonances) {
  std::vector<double> grid{first, last};
  for (int l = 0; l < count; ++l) {
    const double t = (l + 0.5) / count;
    grid.push_back(first + t * (last - first));
    if (l % 3 == 0 && last > first)
      grid.push_back(std::exp(std::log(std::max(first, 1e-4 * last)) * (1 - t) +
                              std::log(last) * t));
  }
  for (const auto& [omega, half_width] : resonances)
    for (const double offset : {-3.0, -1.0, 0.0, 1.0, 3.0}) {
      const bool damped = half_width > 1e-7 * omega;
      if (offset == 0 && !damped) continue;
      const double at = omega + offset * (damped ? half_width : 1e-4 * omega);
      if (at > first && at < last) grid.push_back(at);
    }
  std::sort(grid.begin(), grid.end());
  grid.erase(std::unique(grid.begin(), grid.end()), grid.end());
  return grid;
}

std::vector<double> band_grid(const std::vector<Interval>& bands, int count,
                              const std::vector<Resonance>& resonances) {
  std::vector<double> grid;
  for (const Interval& band : bands) {
    const auto part = band_grid(band.first, band.last,
                                count / static_cast<int>(bands.size()), resonances);
    grid.insert(grid.end(), part.begin(), part.end());
  }
  return grid;
}

} // namespace flexgram
