#include "fem/elements.hpp"

#include "base/error.hpp"
#include "base/index.hpp"

#include <cmath>

namespace flexgram {
namespace {

Vector3 cross(const Vector3& a, const Vector3& b) {
  return {a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2],
          a[0] * b[1] - a[1] * b[0]};
}
double norm(const Vector3& a) {
  return std::sqrt(a[0] * a[0] + a[1] * a[1] + a[2] * a[2]);
}

/// Local axes as rows.
std::array<Vector3, 3> local_axes(const Vector3& first, const Vector3& second,
                                  const Vector3& y_axis, double& length) {
  Vector3 x{second[0] - first[0], second[1] - first[1], second[2] - first[2]};
  length = norm(x);
  if (!(length > 0)) return {};
  for (double& c : x) c /= length;
  Vector3 z = cross(x, y_axis);
  const double size = norm(z);
  if (!(size > 1e-6 * norm(y_axis)))
    throw Error("a beam runs along the y_axis of its section; give another direction");
  for (double& c : z) c /= size;
  return {x, cross(z, x), z};
}

/// One bending plane: displacement v and rotation θ with v' = θ for a slender beam.
/// Stiffness and mass for (v1, θ1, v2, θ2) by four Gauss points, exact for the cubic
/// interpolation.
void bending(double L, double EI, double shear, double line_mass, double rotary, Dense& K,
             Dense& M) {
  constexpr double x[4] = {-0.861136311594052575224, -0.339981043584856264803,
                           0.339981043584856264803, 0.861136311594052575224};
  constexpr double w[4] = {0.347854845137453857373, 0.652145154862546142627,
                           0.652145154862546142627, 0.347854845137453857373};
  const double phi = 12 * EI / (shear * L * L), f = 1 / (1 + phi);
  for (int q = 0; q < 4; ++q) {
    const double s = 0.5 * (1 + x[q]), weight = 0.5 * L * w[q];
    const double v[4] = {f * (2 * s * s * s - 3 * s * s - phi * s + 1 + phi),
                         f * L * (s * s * s - (2 + phi / 2) * s * s + (1 + phi / 2) * s),
                         -f * (2 * s * s * s - 3 * s * s - phi * s),
                         f * L * (s * s * s - (1 - phi / 2) * s * s - phi / 2 * s)};
    const double dv[4] = {
        f / L * (6 * s * s - 6 * s - phi), f * (3 * s * s - (4 + phi) * s + 1 + phi / 2),
        -f / L * (6 * s * s - 6 * s - phi), f * (3 * s * s - (2 - phi) * s - phi / 2)};
    const double t[4] = {f * 6 / L * (s * s - s),
                         f * (3 * s * s - (4 + phi) * s + 1 + phi),
                         -f * 6 / L * (s * s - s), f * (3 * s * s - (2 - phi) * s)};
    const double dt[4] = {f * 6 / (L * L) * (2 * s - 1), f / L * (6 * s - (4 + phi)),
                          -f * 6 / (L * L) * (2 * s - 1), f / L * (6 * s - (2 - phi))};
    for (int i = 0; i < 4; ++i)
      for (int j = 0; j < 4; ++j) {
        K(i, j) +=
            weight * (EI * dt[i] * dt[j] + shear * (dv[i] - t[i]) * (dv[j] - t[j]));
        M(i, j) += weight * (line_mass * v[i] * v[j] + rotary * t[i] * t[j]);
      }
  }
}

} // namespace

ElementMatrices beam_matrices(const Vector3& first, const Vector3& second,
                              const BeamMaterial& material, const BeamSection& section) {
  double L = 0;
  const auto axes = local_axes(first, second, section.y_axis, L);
  ElementMatrices result;
  result.min_detJ = 0.5 * L;
  if (!(L > 0)) return result;
  const double rho = material.density, line_mass = rho * section.A;
  result.mass = line_mass * L;
  Dense K(12, 12), M(12, 12);
  const auto bar = [&](int dof, double stiffness, double mass) {
    const int i = dof, j = dof + 6;
    K(i, i) = K(j, j) = stiffness / L;
    K(i, j) = K(j, i) = -stiffness / L;
    M(i, i) = M(j, j) = mass * L / 3;
    M(i, j) = M(j, i) = mass * L / 6;
  };
  bar(0, material.E * section.A, line_mass);
  bar(3, material.G * section.J, rho * (section.I_y + section.I_z));
  const auto plane = [&](const int(&dof)[4], double sign, double I, double k) {
    Dense k4(4, 4), m4(4, 4);
    bending(L, material.E * I, k * material.G * section.A, line_mass, rho * I, k4, m4);
    const double s[4] = {1, sign, 1, sign};
    for (int i = 0; i < 4; ++i)
      for (int j = 0; j < 4; ++j) {
        K(dof[i], dof[j]) += s[i] * s[j] * k4(i, j);
        M(dof[i], dof[j]) += s[i] * s[j] * m4(i, j);
      }
  };
  plane({1, 5, 7, 11}, 1, section.I_z, section.k_y);  // v' = θz
  plane({2, 4, 8, 10}, -1, section.I_y, section.k_z); // w' = −θy

  Dense R(12, 12); // local = R global
  for (int block = 0; block < 4; ++block)
    for (int i = 0; i < 3; ++i)
      for (int j = 0; j < 3; ++j)
        R(3 * block + i, 3 * block + j) = axes[as_size(i)][as_size(j)];
  result.K = multiply_transposed(R, multiply(K, R));
  result.M = multiply_transposed(R, multiply(M, R));
  symmetrise(result.K);
  symmetrise(result.M);
  return result;
}

} // namespace flexgram
