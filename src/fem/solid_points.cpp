#include "fem/solid_points.hpp"

#include <cmath>

namespace flexgram {
namespace {

Jacobian inverse(const Jacobian& J, double det) {
  Jacobian inv;
  for (std::size_t a = 0; a < 3; ++a)
    for (std::size_t b = 0; b < 3; ++b) {
      const std::size_t a1 = (a + 1) % 3, a2 = (a + 2) % 3, b1 = (b + 1) % 3,
                        b2 = (b + 2) % 3;
      inv[b][a] = (J[a1][b1] * J[a2][b2] - J[a1][b2] * J[a2][b1]) / det;
    }
  return inv;
}

double norm(const Jacobian& J) {
  double square = 0;
  for (const Vector3& row : J)
    for (double x : row) square += x * x;
  return std::sqrt(square);
}

/// ∂N/∂x from ∂N/∂ξ.
Vector3 to_global(const Jacobian& inv, const Vector3& d) {
  Vector3 g{};
  for (std::size_t b = 0; b < 3; ++b)
    for (std::size_t a = 0; a < 3; ++a) g[b] += inv[b][a] * d[a];
  return g;
}

} // namespace

Jacobian jacobian(const ShapePoint& p, const std::vector<Vector3>& x) {
  Jacobian J{};
  for (std::size_t i = 0; i < x.size(); ++i)
    for (std::size_t a = 0; a < 3; ++a)
      for (std::size_t b = 0; b < 3; ++b) J[a][b] += p.dN[i][a] * x[i][b];
  return J;
}

double determinant(const Jacobian& J) {
  return J[0][0] * (J[1][1] * J[2][2] - J[1][2] * J[2][1]) -
         J[0][1] * (J[1][0] * J[2][2] - J[1][2] * J[2][0]) +
         J[0][2] * (J[1][0] * J[2][1] - J[1][1] * J[2][0]);
}

Jacobian inverse_jacobian(const ShapePoint& p, const std::vector<Vector3>& x) {
  const Jacobian J = jacobian(p, x);
  return inverse(J, determinant(J));
}

std::vector<Vector3> gradients(const ShapePoint& p, const std::vector<Vector3>& x) {
  const Jacobian inv = inverse_jacobian(p, x);
  std::vector<Vector3> result;
  for (const Vector3& d : p.dN) result.push_back(to_global(inv, d));
  return result;
}

void mirror(Dense& a) {
  for (int j = 0; j < a.columns; ++j)
    for (int i = j + 1; i < a.rows; ++i) a(i, j) = a(j, i);
}

std::vector<StiffnessPoint> points_of(ElementType type,
                                      const std::vector<Vector3>& nodes) {
  const bool incompatible = type == ElementType::hex8;
  Jacobian center_inverse{};
  double center_det = 0;
  if (incompatible) {
    const Jacobian center = jacobian(shape_at(type, {0, 0, 0}, 0), nodes);
    center_det = determinant(center);
    center_inverse = inverse(center, center_det);
  }
  std::vector<StiffnessPoint> result;
  for (const auto& p : stiffness_points(type)) {
    const Jacobian J = jacobian(p, nodes);
    const double det = determinant(J);
    const Jacobian inv = inverse(J, det);
    StiffnessPoint at{p.weight * det, norm(J) * norm(inv) / 3, p.xi, {}};
    for (const auto& d : p.dN) at.gradients.push_back(to_global(inv, d));
    if (incompatible)
      for (std::size_t a = 0; a < 3;
           ++a) { // gradients of 1 − ξ_a² by the centre's Jacobian
        Vector3 d{};
        d[a] = -2 * p.xi[a] * center_det / det;
        at.gradients.push_back(to_global(center_inverse, d));
      }
    result.push_back(std::move(at));
  }
  return result;
}

const SolidMaterial& at_point(const SolidMaterials& materials, std::size_t p) {
  return materials[materials.size() > 1 ? p : 0];
}

} // namespace flexgram
