#include "base/error.hpp"
#include "base/index.hpp"
#include "fem/elements.hpp"
#include "linalg/decompositions.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

using namespace flexgram;

namespace {
constexpr double E = 210e9, rho = 7850;
} // namespace

TEST(Elements, ABeamUnderEndLoadsIsExact) {
  const BeamMaterial steel{E, E / 2.6, rho};
  BeamSection section;
  section.A = 4e-4;
  section.I_y = 2e-8;
  section.I_z = 1e-8;
  section.J = 1.5e-8;
  section.k_y = section.k_z = 5.0 / 6;
  const double L = 0.7;
  const auto element = beam_matrices({0, 0, 0}, {L, 0, 0}, steel, section);
  // Clamp the first end: the tip's flexibility is L³/3EI + L/kGA, L/EA, L/GJ, ...
  Dense tip(6, 6);
  for (int i = 0; i < 6; ++i)
    for (int j = 0; j < 6; ++j) tip(i, j) = element.K(6 + i, 6 + j);
  ASSERT_EQ(cholesky(tip), 0);
  Dense x = identity(6);
  solve_right_transposed(tip, x);
  const Dense flexibility = multiply(x, transpose(x));
  const double shear = L / (5.0 / 6 * steel.G * section.A);
  const auto near = [](double found, double expected) {
    EXPECT_NEAR(found, expected, 1e-10 * std::abs(expected));
  };
  near(flexibility(0, 0), L / (E * section.A));
  near(flexibility(1, 1), L * L * L / (3 * E * section.I_z) + shear);
  near(flexibility(2, 2), L * L * L / (3 * E * section.I_y) + shear);
  near(flexibility(3, 3), L / (steel.G * section.J));
  near(flexibility(1, 5), L * L / (2 * E * section.I_z));
  near(flexibility(2, 4), -L * L / (2 * E * section.I_y));
  near(element.mass, rho * section.A * L);
}

TEST(Elements, BeamFrequenciesConvergeToTimoshenkoTheory) {
  // Pinned-pinned: EI k⁴ − ω² (ρA + ρI k² + EI ρA k²/(κGA)) + ω⁴ ρI ρA/(κGA) = 0, k =
  // jπ/L.
  const BeamMaterial steel{E, E / 2.6, rho};
  BeamSection section;
  section.A = 0.01;
  section.I_y = section.I_z = 0.01 / 1200; // square of 0.1 m: stocky, shear matters
  section.J = 1.4e-5;
  section.k_y = section.k_z = 5.0 / 6;
  const double L = 1, kGA = 5.0 / 6 * steel.G * section.A, EI = E * section.I_z;
  const double rA = rho * section.A, rI = rho * section.I_z;
  std::vector<double> error;
  for (const int elements : {32, 64}) {
    const int dofs = 2 * (elements + 1);
    Dense K(dofs, dofs), M(dofs, dofs);
    const double h = L / elements;
    const auto element = beam_matrices({0, 0, 0}, {h, 0, 0}, steel, section);
    const int local[4] = {1, 5, 7, 11}; // v and θz
    for (int e = 0; e < elements; ++e)
      for (int i = 0; i < 4; ++i)
        for (int j = 0; j < 4; ++j) {
          K(2 * e + i, 2 * e + j) += element.K(local[i], local[j]);
          M(2 * e + i, 2 * e + j) += element.M(local[i], local[j]);
        }
    // Pins: drop v at both ends.
    std::vector<int> kept;
    for (int i = 1; i < dofs; ++i)
      if (i != dofs - 2) kept.push_back(i);
    const int n = static_cast<int>(kept.size());
    Dense k(n, n), m(n, n);
    for (int i = 0; i < n; ++i)
      for (int j = 0; j < n; ++j) {
        k(i, j) = K(kept[as_size(i)], kept[as_size(j)]);
        m(i, j) = M(kept[as_size(i)], kept[as_size(j)]);
      }
    const auto values = symmetric_eigen(k, m).values;
    double worst = 0;
    for (int mode = 1; mode <= 3; ++mode) {
      const double w = mode * M_PI / L, a = rI * rA / kGA,
                   b = rA + rI * w * w + EI * rA * w * w / kGA, c = EI * w * w * w * w;
      const double exact = 2 * c / (b + std::sqrt(b * b - 4 * a * c)); // smaller ω²
      worst = std::max(worst, std::abs(values[as_size(mode - 1)] / exact - 1));
    }
    error.push_back(worst);
  }
  // Exact in statics, of second order in the rotary and shear inertia: (kh)²/12 = 0.018
  // for the third mode on 64 elements, times the share of shear in its energy (a sixth).
  EXPECT_LT(error[1], 4e-4);
  EXPECT_NEAR(error[0] / error[1], 4, 0.2);
}

TEST(Elements, BeamsTurnWithTheirAxis) {
  const BeamMaterial steel{E, E / 2.6, rho};
  BeamSection section;
  section.A = 4e-4;
  section.I_y = 2e-8;
  section.I_z = 1e-8;
  section.J = 1.5e-8;
  section.y_axis = {0, 1, 0};
  const auto along_x = beam_matrices({0, 0, 0}, {0.5, 0, 0}, steel, section);
  section.y_axis = {0, 0, 1};
  const auto along_y = beam_matrices({0, 0, 0}, {0, 0.5, 0}, steel, section);
  // x → y, y → z, z → x: cyclic, so dof c of the first is dof (c + 1) mod 3 of the
  // second.
  for (int i = 0; i < 12; ++i)
    for (int j = 0; j < 12; ++j) {
      const auto turn = [](int d) { return d / 3 * 3 + (d % 3 + 1) % 3; };
      EXPECT_NEAR(along_x.K(i, j), along_y.K(turn(i), turn(j)), 1e-12 * along_x.K(0, 0));
      EXPECT_NEAR(along_x.M(i, j), along_y.M(turn(i), turn(j)), 1e-12 * along_x.M(0, 0));
    }
  EXPECT_THROW(beam_matrices({0, 0, 0}, {0, 0, 1}, steel, section), Error);
}
