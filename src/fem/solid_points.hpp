/// Points of the stiffness of solids, and what is integrated there. Used by solid.cpp and
/// solid_stress.cpp.

#pragma once

#include "base/index.hpp"
#include "fem/elements.hpp"
#include "fem/shape_functions.hpp"

namespace flexgram {

using Jacobian = std::array<Vector3, 3>; ///< J[a][b] = ∂x_b / ∂ξ_a

Jacobian jacobian(const ShapePoint& p, const std::vector<Vector3>& x);
double determinant(const Jacobian& J);
/// ∂N/∂x of the nodes' functions at a point.
std::vector<Vector3> gradients(const ShapePoint& p, const std::vector<Vector3>& x);
/// ∂ξ/∂x.
Jacobian inverse_jacobian(const ShapePoint& p, const std::vector<Vector3>& x);

/// At a point of the stiffness: weight and Jacobian determinant, and the gradients of all (also
/// incompatible) modes.
struct StiffnessPoint {
  double volume;
  double aspect;
  Vector3 xi;
  std::vector<Vector3> gradients;
};

std::vector<StiffnessPoint> points_of(ElementType type,
                                      const std::vector<Vector3>& nodes);

/// The six strains of displacement component c with gradient g, engineering shears.
inline std::array<double, 6> linear_strain(std::size_t c, const Vector3& g) {
  switch (c) {
  case 0:
    return {g[0], 0, 0, g[1], 0, g[2]};
  case 1:
    return {0, g[1], 0, g[0], g[2], 0};
  default:
    return {0, 0, g[2], 0, g[1], g[0]};
  }
}

/// K += w Bᵀ C B for the gradients of all (also incompatible) modes; upper triangle.
/// @param strain  of a displacement component with a gradient.
template <class Strain>
void add_stiffness(Dense& K, const std::vector<Vector3>& gradients,
                   const std::array<double, 36>& C, double w, const Strain& strain) {
  const int n = 3 * static_cast<int>(gradients.size());
  std::vector<std::array<double, 6>> B(as_size(n)), CB(B.size());
  for (std::size_t i = 0; i < B.size(); ++i) {
    B[i] = strain(i % 3, gradients[i / 3]);
    for (std::size_t r = 0; r < 6; ++r) {
      double sum = 0;
      for (std::size_t s = 0; s < 6; ++s) sum += C[6 * r + s] * B[i][s];
      CB[i][r] = w * sum;
    }
  }
  for (int j = 0; j < n; ++j)
    for (int i = 0; i <= j; ++i) {
      double sum = 0;
      for (std::size_t r = 0; r < 6; ++r) sum += B[as_size(i)][r] * CB[as_size(j)][r];
      K(i, j) += sum;
    }
}

/// The upper triangle in the lower one too.
void mirror(Dense& a);

/// The material at a point of the stiffness.
const SolidMaterial& at_point(const SolidMaterials& materials, std::size_t p);

} // namespace flexgram
