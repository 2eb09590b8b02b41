#include "fem/elements.hpp"

#include "base/error.hpp"
#include "base/index.hpp"
#include "base/text.hpp"
#include "linalg/decompositions.hpp"

#include <algorithm>
#include <cmath>

namespace flexgram {
namespace {

/// Symmetric 6×6 inverse by Cholesky; false if not positive definite.
bool invert(Dense a, std::array<double, 36>& inverse) {
  if (cholesky(a) != 0) return false;
  const Dense x = inverse_transposed(a);
  const Dense result = multiply(x, transpose(x));
  for (std::size_t i = 0; i < 36; ++i) inverse[i] = result.data[i];
  return true;
}

/// Strains in material axes from strains in global axes; R holds the material axes as
/// rows.
Dense strain_rotation(const std::array<double, 9>& R) {
  // Order xx, yy, zz, xy, yz, zx: pairs of axes.
  constexpr int pair[6][2] = {{0, 0}, {1, 1}, {2, 2}, {0, 1}, {1, 2}, {2, 0}};
  const auto r = [&](int i, int j) { return R[as_size(3 * i + j)]; };
  Dense T(6, 6);
  for (int a = 0; a < 6; ++a)
    for (int b = 0; b < 6; ++b) {
      const int i = pair[a][0], j = pair[a][1], k = pair[b][0], l = pair[b][1];
      // ε'_ij = R_ik R_jl ε_kl, with γ = 2ε off the diagonal on both sides.
      const double product =
          k == l ? r(i, k) * r(j, k) : 0.5 * (r(i, k) * r(j, l) + r(i, l) * r(j, k));
      T(a, b) = (i == j ? 1 : 2) * product;
    }
  return T;
}

} // namespace

SolidMaterial isotropic(double E, double nu, double density) {
  if (!(E > 0)) throw Error(text("E = %g: Young's modulus must be positive", E));
  if (!(nu > -1 && nu < 0.5))
    throw Error(text("nu = %g must be above -1 and below 0.5", nu));
  SolidMaterial material;
  material.density = density;
  const double lambda = E * nu / ((1 + nu) * (1 - 2 * nu)), mu = E / (2 * (1 + nu));
  for (std::size_t i = 0; i < 3; ++i) {
    for (std::size_t j = 0; j < 3; ++j) material.stiffness[6 * i + j] = lambda;
    material.stiffness[7 * i] += 2 * mu;
    material.stiffness[7 * (i + 3)] = mu;
  }
  return material;
}

SolidMaterial orthotropic(const std::array<double, 9>& constants,
                          const std::array<double, 9>& axes, double density) {
  const auto [E1, E2, E3, nu12, nu13, nu23, G12, G13, G23] = constants;
  for (double value : {E1, E2, E3, G12, G13, G23})
    if (!(value > 0))
      throw Error(text("orthotropic material: the modulus %g must be positive", value));
  Dense compliance(6, 6);
  compliance(0, 0) = 1 / E1;
  compliance(1, 1) = 1 / E2;
  compliance(2, 2) = 1 / E3;
  compliance(0, 1) = compliance(1, 0) = -nu12 / E1;
  compliance(0, 2) = compliance(2, 0) = -nu13 / E1;
  compliance(1, 2) = compliance(2, 1) = -nu23 / E2;
  compliance(3, 3) = 1 / G12;
  compliance(4, 4) = 1 / G23;
  compliance(5, 5) = 1 / G13;
  std::array<double, 36> local{};
  if (!invert(compliance, local))
    throw Error("orthotropic material: Poisson's ratios make the law indefinite");
  return anisotropic(local, axes, density);
}

SolidMaterial anisotropic(const std::array<double, 36>& stiffness,
                          const std::array<double, 9>& axes, double density) {
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 3; ++j) {
      double dot = 0;
      for (int k = 0; k < 3; ++k)
        dot += axes[as_size(3 * i + k)] * axes[as_size(3 * j + k)];
      if (std::abs(dot - (i == j)) > 1e-9)
        throw Error("material: the axes must be orthonormal rows");
    }
  Dense C(6, 6);
  double largest = 0;
  for (std::size_t i = 0; i < 36; ++i) {
    C.data[i] = stiffness[i];
    largest = std::max(largest, std::abs(stiffness[i]));
  }
  for (int i = 0; i < 6; ++i)
    for (int j = 0; j < i; ++j)
      if (!(std::abs(C(i, j) - C(j, i)) <= 1e-9 * largest))
        throw Error("material: its stiffness must be symmetric");
  symmetrise(C);
  if (std::array<double, 36> unused; !invert(C, unused))
    throw Error("material: its stiffness must be positive definite");
  SolidMaterial material;
  material.density = density;
  std::copy(C.data.begin(), C.data.end(), material.stiffness.begin());
  return turned(material, axes);
}

SolidMaterial turned(const SolidMaterial& material, const std::array<double, 9>& axes) {
  Dense C(6, 6);
  std::copy(material.stiffness.begin(), material.stiffness.end(), C.data.begin());
  SolidMaterial result = material;
  const Dense T = strain_rotation(axes);
  const Dense global = multiply_transposed(T, multiply(C, T));
  std::copy(global.data.begin(), global.data.end(), result.stiffness.begin());
  if (material.expansion) {
    std::array<double, 9> back;
    for (std::size_t i = 0; i < 3; ++i)
      for (std::size_t j = 0; j < 3; ++j) back[3 * i + j] = axes[3 * j + i];
    const Dense B = strain_rotation(back);
    std::array<double, 6>& along = result.expansion.emplace();
    for (int i = 0; i < 6; ++i)
      for (int j = 0; j < 6; ++j)
        along[as_size(i)] += B(i, j) * (*material.expansion)[as_size(j)];
  }
  return result;
}

std::array<double, 9> with_third(const std::array<double, 6>& axes) {
  std::array<double, 9> all{};
  std::copy(axes.begin(), axes.end(), all.begin());
  for (std::size_t c = 0; c < 3; ++c) {
    const std::size_t next = (c + 1) % 3, last = (c + 2) % 3;
    all[6 + c] = axes[next] * axes[3 + last] - axes[last] * axes[3 + next];
  }
  return all;
}

} // namespace flexgram
