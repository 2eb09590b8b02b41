/// Strains of shell elements over their dofs; see fem/shell.

#pragma once

#include "fem/shell.hpp"

#include <functional>

namespace flexgram {

/// At a point of the mass: how the middle surface moves, and how its normal turns.
struct ShellPoint {
  double area;    ///< [m²]
  Vector3 normal; ///< interpolated from the nodes'
  Dense moved;    ///< 3 × dofs of nodes
  Dense turned;   ///< the same: θ × normal
  Dense rotation; ///< the same: θ
  Dense
      drilling; ///< 1 × dofs of nodes: rotation about the normal, less that of the surface
};

/// At a point of the stiffness, over dofs of nodes and internal ones behind them, in the axes of the
/// section.
struct ShellStrain {
  double area;    ///< [m²]
  Dense stretch;  ///< 6 × dofs: strains xx, yy, xy, then curvatures
  Dense shear;    ///< 2 × dofs: xz, yz
  Dense drilling; ///< 1 × dofs: rotation about the normal, less that of the surface
  Dense slope;    ///< 6 × dofs: ∂u/∂x, then ∂u/∂y, in global components
  Vector3 normal; ///< of unit length
  std::array<Vector3, 2> axes; ///< of the section, in the surface
};

/// A shell's surface, with the normals of its own at its nodes.
class ShellShape {
public:
  ShellShape(ElementType type, std::vector<Vector3> nodes);

  /// Dofs of the nodes and internal ones.
  int dofs() const;
  std::vector<ShellPoint> mass_points() const;
  std::vector<ShellStrain> strains(const ShellPlace& place) const;

  std::vector<Vector3> normals;       ///< of unit length; at nodes
  double least_det = 0, most_det = 0; ///< of the surface over the reference element
  double size = 0;                    ///< root of the area [m]

private:
  struct Surface;
  struct Covariant;
  Surface surface_at(const Vector3& xi) const;
  Covariant covariant(const Vector3& xi) const;
  Dense tied_shear(const Vector3& xi) const;

  ElementType type_;
  std::vector<Vector3> x_;
  Vector3 centre_{};                  ///< of the reference element
  std::array<Vector3, 2> in_plane_{}; ///< axes at the centre, of internal dofs
  std::vector<Dense> tying_;          ///< covariant shear at the tying points
};

/// A matrix of the middle surface over the dofs of nodes below it, which move it by u + θ × o n.
Dense with_offset(ElementType type, const std::vector<Vector3>& nodes,
                  const ShellPlace& place,
                  const std::function<Dense(const ShellShape&)>& matrix);

/// As hold_shell. @param K  over all dofs, internal ones last, as those of `stretch`.
HeldShell hold(const Dense& K, int internal, const std::vector<Dense>& stretch,
               const std::vector<double>& area, const std::vector<Dense>& resultants);

/// K over all dofs, internal ones too.
Dense shell_stiffness(const ShellShape& shape, const std::vector<ShellStrain>& points,
                      const ShellLaw& law);

} // namespace flexgram
