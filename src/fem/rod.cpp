#include "fem/elements.hpp"

#include <algorithm>
#include <cmath>

namespace flexgram {
namespace {

/// Its direction, and how long it is.
std::pair<Vector3, double> line_of(const Vector3& first, const Vector3& second) {
  Vector3 along;
  double square = 0;
  for (std::size_t c = 0; c < 3; ++c) {
    along[c] = second[c] - first[c];
    square += along[c] * along[c];
  }
  const double length = std::sqrt(square);
  for (double& c : along) c /= length > 0 ? length : 1.0;
  return {along, length};
}

/// [A, −A; −A, A] of a 3×3 matrix A.
Dense between_ends(const Dense& A) {
  Dense result(6, 6);
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 3; ++j) {
      result(i, j) = result(3 + i, 3 + j) = A(i, j);
      result(i, 3 + j) = result(3 + i, j) = -A(i, j);
    }
  return result;
}

} // namespace

ElementMatrices rod_matrices(const Vector3& first, const Vector3& second,
                             const BeamMaterial& material, double A) {
  const auto [along, length] = line_of(first, second);
  ElementMatrices result;
  result.min_detJ = 0.5 * length;
  if (!(length > 0)) return result;
  result.mass = material.density * A * length;
  Dense direction(3, 3);
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 3; ++j)
      direction(i, j) = material.E * A / length * along[as_size(i)] * along[as_size(j)];
  result.K = between_ends(direction);
  result.M = Dense(6, 6);
  for (int i = 0; i < 6; ++i) {
    result.M(i, i) = result.mass / 3;
    result.M(i, (i + 3) % 6) = result.mass / 6;
  }
  return result;
}

StressStiffness rod_stress_stiffness(const Vector3& first, const Vector3& second,
                                     const BeamMaterial& material, double A,
                                     const std::vector<double>& u, double free,
                                     double& stress) {
  const auto [along, length] = line_of(first, second);
  double stretch = 0;
  for (std::size_t c = 0; c < 3; ++c) stretch += along[c] * (u[3 + c] - u[c]);
  const double EA = material.E * A, tension = EA * (stretch / length - free);
  stress = std::max(stress, std::abs(tension / A));
  Dense across(3, 3);
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 3; ++j)
      across(i, j) =
          tension / length * ((i == j) - along[as_size(i)] * along[as_size(j)]);
  StressStiffness result{between_ends(across), Dense(6, 6)};
  if (free == 0) return result;
  result.free = Dense(6, 1);
  for (int i = 0; i < 3; ++i) {
    result.free(3 + i, 0) = EA * free * along[as_size(i)];
    result.free(i, 0) = -result.free(3 + i, 0);
  }
  return result;
}

} // namespace flexgram
