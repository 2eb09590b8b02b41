#pragma once

#include "fem/elements.hpp"

namespace flexgram {

/// A quadrature point on the reference element with shape functions and their derivatives
/// with respect to the reference coordinates there.
struct ShapePoint {
  Vector3 xi{};
  double weight = 0;
  std::vector<double> N;
  std::vector<Vector3> dN;
};

/// Points of the stiffness: 1 (Tet4), 4 (Tet10), 2×2×2 (Hex8), 3×3×3 (Hex20), 3×3
/// (Wedge15), 2×2×2 (hexahedra of the other formulations), 3×2 or 1×2 (wedges of 6 nodes), 6
/// (triangle), 2×2 (quadrilateral).
const std::vector<ShapePoint>& stiffness_points(ElementType type);
/// Points that integrate N Nᵀ exactly on straight-edged elements.
const std::vector<ShapePoint>& mass_points(ElementType type);

/// Shape functions and derivatives at one reference point.
ShapePoint shape_at(ElementType type, const Vector3& xi, double weight);

} // namespace flexgram
