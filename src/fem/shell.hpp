/// Shell elements: MITC4 (Dvorkin and Bathe 1984) and MITC3+ (Lee, Lee and Bathe 2014).
///
/// Six dofs a node: u, v, w, θx, θy, θz in global axes. A straight line across the shell stays straight:
/// a point at height z above the middle surface moves by u + z θ × n, n being the element's own normal
/// at its nodes, interpolated. Strains are those of the surface's covariant base, so that warped
/// quadrilaterals strain by no rigid motion; transverse shear is that of the papers' tying points.
/// Beside the papers: quadrilaterals have the incompatible modes of Taylor, Beresford and Wilson (1976)
/// in their plane, so that they bend there as well; the rotation about the normal is tied to that of
/// the surface (Hughes and Brezzi 1989) by a stiffness as small as that of the element's twist,
/// and has as much inertia against it as lines have: no rigid motion feels either, and M is regular.

#pragma once

#include "fem/elements.hpp"

namespace flexgram {

bool is_shell(ElementType type);

/// What a layer of a shell resists. One that bends or shears alone, or only stretches, is as thick as
/// the shell, in its middle; then no layer resists all.
enum class ShellRole { all, stretching, bending, shear };

/// A layer of a shell.
struct ShellLayer {
  std::array<double, 36> stiffness; ///< in the layer's axes, as SolidMaterial's [N/m²]
  double density = 0;               ///< [kg/m³]
  double thickness = 0;             ///< [m]
  double angle = 0; ///< of its first axis from the section's, about the normal [rad]
  ShellRole role = ShellRole::all;
  double factor = 1; ///< of t³/12, of one that bends; of t, of one that shears
  /// Of one that bends: heights of the bottom and the top of the shell [m].
  std::array<double, 2> sides{};
  /// Strain by 1 K in the layer's axes; nothing: not known.
  std::optional<std::array<double, 6>> expansion = std::nullopt;
};

/// Stress resultants over strains of the middle surface, and its mass, by its area.
struct ShellLaw {
  Dense ABD{6, 6};   ///< forces xx, yy, xy, then moments, over strains and curvatures
  Dense shear{2, 2}; ///< forces xz, yz
  double mass = 0, first = 0,
         second = 0;    ///< ∫ρ [kg/m²], ∫ρz [kg/m], ∫ρz² [kg]
  double thickness = 0; ///< [m]
};

/// Of layers from the bottom to the top, z from the middle. Stress across the shell vanishes; the
/// stiffness against transverse shear is that of its energy where moments vary (5/6 G t of one layer;
/// Rohwer 1988). Of layers with a role each gives what it resists: of the one that stretches it has its
/// mass too.
/// @throws Error unless thicknesses are positive.
ShellLaw shell_law(const std::vector<ShellLayer>& layers);

/// What some of the layers give of that law; all of them together give the whole. Against transverse
/// shear each has the share of the energy that is in it.
/// @param counts  for each layer whether it is one of them.
ShellLaw part_of_law(const std::vector<ShellLayer>& layers,
                     const std::vector<bool>& counts);

/// Of a layer's strain by 1 K, in the section's axes: xx, yy, xy.
/// @throws Error if its expansion is not known.
Dense heat_strain(const ShellLayer& layer);

/// Stress resultants that hold the strains of heat back: six of 1 K, and six of 1 K/m along the normal.
/// @throws Error if an expansion is not known.
Dense heat_resultants(const std::vector<ShellLayer>& layers);

/// Where a shell stands and how it is turned.
struct ShellPlace {
  double offset = 0; ///< of the middle surface above the nodes, along the normal [m]
  /// Direction of the law's first axis, projected onto the surface; where it is normal to that of an
  /// isotropic law, another is taken.
  Vector3 axis_1{1, 0, 0};
  bool isotropic = true;
};

/// K and consistent M, with rotary inertia, 6 dofs a node. `nodes` run counter-clockwise seen against
/// the normal.
/// @throws Error if axis_1 is along the normal of a law that is not isotropic.
ElementMatrices shell_matrices(ElementType type, const std::vector<Vector3>& nodes,
                               const ShellLaw& law, const ShellPlace& place,
                               bool with_stiffness = true);

/// At a point of the stiffness: strains and curvatures of the middle surface for unit motions of the
/// nodes (of membranes displacements alone), in the section's axes.
struct ShellStrainPoint {
  double area;                 ///< [m²]
  Dense stretch;               ///< 6 × dofs of nodes
  std::array<Vector3, 2> axes; ///< of the section, in the surface
};

/// With internal dofs as they follow in K.
std::vector<ShellStrainPoint> shell_strains(ElementType type,
                                            const std::vector<Vector3>& nodes,
                                            const ShellLaw& law, const ShellPlace& place);

/// A shell, or a membrane, whose nodes are held while it has strains without stress.
struct HeldShell {
  Dense forces; ///< of these strains at the nodes' dofs, one column
  std::vector<Dense>
      strains; ///< of the internal dofs that give way, at the points: 6 × 1
};

/// @param resultants  that hold the strains back, at the points of the stiffness: 6 × 1.
HeldShell hold_shell(ElementType type, const std::vector<Vector3>& nodes,
                     const ShellLaw& law, const ShellPlace& place,
                     const std::vector<Dense>& resultants);

/// The law of a layer under plane stress, in the section's axes: xx, yy, xy [N/m²].
Dense plane_stress(const ShellLayer& layer);

/// What some layers give of K: with internal dofs as those of the whole law have them.
/// @param part  of `law`.
Dense shell_part_stiffness(ElementType type, const std::vector<Vector3>& nodes,
                           const ShellLaw& law, const ShellLaw& part,
                           const ShellPlace& place);

/// As solid_spin_softening, with the straight lines across the shell that turn.
/// @throws Error if its middle surface, or its centre of mass, is not at the nodes.
Dense shell_spin_softening(ElementType type, const std::vector<Vector3>& nodes,
                           const ShellLaw& law, const ShellPlace& place,
                           const Vector3& axis);

/// As solid_coriolis.
Dense shell_coriolis(ElementType type, const std::vector<Vector3>& nodes,
                     const ShellLaw& law, const ShellPlace& place, const Vector3& axis);

/// What displacements u, six numbers a node, add to the stiffness: by forces in the plane, and by the
/// slopes of the moved surface, after von Kármán. Moments and shear forces add nothing.
/// @param free  its strain without stress, of temperatures alone; null: none.
/// @throws Error if its middle surface is not at the nodes, or the expansion of a layer is not known.
StressStiffness shell_stress_stiffness(ElementType type,
                                       const std::vector<Vector3>& nodes,
                                       const std::vector<ShellLayer>& layers,
                                       const ShellPlace& place,
                                       const std::vector<double>& u,
                                       const FreeStrain* free, Deformation& deformation);

/// What forces in the plane add, alone.
Dense shell_geometric_stiffness(ElementType type, const std::vector<Vector3>& nodes,
                                const ShellLaw& law, const ShellPlace& place,
                                const std::vector<double>& u);

} // namespace flexgram
