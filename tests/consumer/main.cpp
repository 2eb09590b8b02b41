#include "fem/elements.hpp"
#include "model/quadrature.hpp"

#include <cmath>
#include <cstdio>

/// Uses one thing of each end of the library.
int main() {
  double length = 0;
  for (double weight : flexgram::band_quadrature(1, 3, 5).weight) length += weight;
  const auto steel = flexgram::isotropic(210e9, 0.3, 7850);
  std::printf("%.15g %.6g\n", length, steel.stiffness[0]);
  return std::abs(length - 2) < 1e-14 && steel.density == 7850 ? 0 : 1;
}
