#pragma once

#include "linalg/dense.hpp"

#include <array>
#include <optional>
#include <string>
#include <vector>

namespace flexgram {

using Vector3 = std::array<double, 3>;

/// Those of files (solids, shells, beams), then point masses, springs to ground and between two nodes, and
/// nodes that no other element has.
enum class ElementType {
  tet4,
  tet10,
  hex8,
  hex20,
  wedge15,
  hex8_full,
  hex20_reduced,
  wedge6,
  wedge6_reduced,
  tri3,
  quad4,
  membrane3,
  membrane4,
  rod2,
  beam2,
  mass1,
  spring1,
  spring2,
  node1
};

/// Points at which the mass is integrated. full: exact for straight-edged elements.
/// reduced: the points of the stiffness (one for Tet4, four for Tet10), as CalculiX does.
/// lumped: all mass at the nodes, as Nastran does.
enum class MassRule { full, reduced, lumped };

/// Elastic law in the element's axes, 6×6 in the order xx, yy, zz, xy, yz, zx with
/// engineering shear strains [N/m²], and density [kg/m³].
struct SolidMaterial {
  std::array<double, 36> stiffness{};
  double density = 0;
  /// Strain of a warming by 1 K in the same order [1/K]; nothing: not known.
  std::optional<std::array<double, 6>> expansion = {};
};

/// One material, or one for each point of an element's stiffness.
using SolidMaterials = std::vector<SolidMaterial>;

/// E [N/m²], ν. @throws Error unless E > 0 and −1 < ν < 1/2.
SolidMaterial isotropic(double E, double nu, double density);

/// Engineering constants in the material axes: E1, E2, E3, ν12, ν13, ν23, G12, G13, G23;
/// `axes` holds the material's 1, 2, 3 directions as rows, orthonormal, in global
/// coordinates.
/// @throws Error unless the law is positive definite.
SolidMaterial orthotropic(const std::array<double, 9>& constants,
                          const std::array<double, 9>& axes, double density);

/// A law by its 6×6 matrix in the material axes, in the order of SolidMaterial [N/m²].
/// @throws Error unless it is symmetric and positive definite.
SolidMaterial anisotropic(const std::array<double, 36>& stiffness,
                          const std::array<double, 9>& axes, double density);

/// A material given in its own axes, the rows of `axes`, in global ones.
SolidMaterial turned(const SolidMaterial& material, const std::array<double, 9>& axes);

/// Three axes of two, which are orthonormal.
std::array<double, 9> with_third(const std::array<double, 6>& axes);

/// Cross section of a beam: area [m²], second moments of area about the local y and z
/// [m⁴], torsion constant J [m⁴], shear correction factors for forces along y and z.
/// `y_axis` points towards local y; its part along the beam is ignored.
struct BeamSection {
  double A = 0, I_y = 0, I_z = 0, J = 0, k_y = 1, k_z = 1;
  Vector3 y_axis{0, 1, 0};
  double torsional_inertia = 1; ///< where mass is lumped: its share of that of all mass
  double rotary_inertia = 1; ///< where it is not: share of what sections that turn have
};

struct BeamMaterial {
  double E = 0, G = 0, density = 0;
};

/// Element matrices, K [N/m] and M [kg], 3 dofs a node (shells, beams: 6), node by node.
struct ElementMatrices {
  Dense K, M;
  double mass = 0;        ///< [kg]
  double min_detJ = 0;    ///< smallest Jacobian determinant met; ≤ 0: inverted
  double shape_ratio = 1; ///< smallest over largest determinant, 1 for a perfect shape
  double aspect = 1; ///< ‖J‖‖J⁻¹‖/3 at most, 1 for a cube; about width over thickness
  /// Of shells, beams and point masses, dofs × 9: forces in an acceleration A r, by the entries of A
  /// (3i + j: a_i of r_j), on masses at r from the nodes that they belong to.
  Dense beside;
  /// Of a Hex8 M = TᵀM₀T: M₀, with the incompatible modes that follow the nodes by T, couples no
  /// directions. Of others empty, M couples none.
  Dense M_0, T;
};

/// Tetrahedra, hexahedra and wedges of any formulation.
bool is_solid(ElementType type);
int node_count(ElementType type);
int dofs_per_node(ElementType type);
/// "tetra", "tetra10", "hexahedron", "hexahedron20", "wedge15", "wedge", "triangle", "quad", "line":
/// meshio's names; with another formulation "hexahedron/full" (without incompatible modes),
/// "hexahedron20/reduced" (2×2×2 points), "wedge/reduced" (two points), "triangle/membrane",
/// "quad/membrane", "line/rod".
/// @throws Error listing the known ones.
ElementType element_type(const std::string& name);
const char* element_name(ElementType type);

/// Isoparametric solid with consistent mass. Node order of VTK (and Abaqus, CalculiX;
/// mid-edge nodes of gmsh's Tet10 differ, meshio translates). Hex8 has the three
/// incompatible modes of Taylor, Beresford and Wilson (1976), condensed. `with_stiffness`
/// false leaves K empty.
/// @param material  the same everywhere in it, or one for each point of the stiffness.
ElementMatrices solid_matrices(ElementType type, const std::vector<Vector3>& nodes,
                               const SolidMaterials& material, MassRule mass_rule,
                               bool with_stiffness = true);

/// Strain that a solid has without stress: by warming, and the same everywhere in it.
struct FreeStrain {
  std::vector<double> temperature; ///< of its nodes [K]; empty: as without stress
  std::vector<double>
      gradient; ///< of its nodes, along the normal of a shell [K/m]; empty: none
  std::array<double, 6> uniform{}; ///< engineering shears
};

/// What displacements u add to the stiffness of an element: the part that is linear in them (and in
/// free strain), and that which is quadratic, positive semidefinite.
struct StressStiffness {
  Dense linear, quadratic;
  Dense free = {}; ///< the load of its free strain, one column [N]; empty: it has none
};

/// What is told of displacements, gathered over elements.
struct Deformation {
  double stress =
      0; ///< the largest von Mises stress at points, of beams the axial one [N/m²]
  double energy = 0; ///< of solids, twice [J]
  double locked =
      0; ///< twice the energy of strains by turning that no displacement relieves [J]
};

/// What displacements u add to the stiffness of a solid: ∫ ∂Nᵀσ∂N of the linear stress σ, and by the
/// moved geometry ∫ B(u)ᵀC B(u) − B(0)ᵀC B(0), B(u) the strain of Green and Lagrange (Bathe, Finite
/// Element Procedures, 6.3.4); the incompatible modes of a Hex8 follow as they do in K.
/// @param u                    three numbers a node [m].
/// @param free                 strain without stress; null: none.
/// @param[in,out] deformation  takes in this element.
/// @throws Error if a material that is warm has no expansion.
StressStiffness solid_stress_stiffness(ElementType type,
                                       const std::vector<Vector3>& nodes,
                                       const SolidMaterials& material,
                                       const std::vector<double>& u,
                                       const FreeStrain* free, Deformation& deformation);

/// ∫ ∂Nᵀσ∂N alone.
Dense solid_geometric_stiffness(ElementType type, const std::vector<Vector3>& nodes,
                                const SolidMaterials& material,
                                const std::vector<double>& u);

/// Two-node Timoshenko beam with the interdependent interpolation of Friedman and
/// Kosmatka (1993): exact stiffness for end loads, no locking, consistent translational
/// and rotary mass. Dofs u, v, w, θx, θy, θz at each end, global axes.
ElementMatrices beam_matrices(const Vector3& first, const Vector3& second,
                              const BeamMaterial& material, const BeamSection& section);

/// The same for a beam, of its axial force alone: ∫ N (v'² + w'² + (I_y + I_z)/A φ'²).
/// @param u     twelve numbers, as in beam_matrices.
/// @param free  its axial strain without stress.
StressStiffness beam_stress_stiffness(const Vector3& first, const Vector3& second,
                                      const BeamMaterial& material,
                                      const BeamSection& section,
                                      const std::vector<double>& u, double free,
                                      double& stress);

/// By what a spin about `axis` softens a beam, for Ω² = 1: the second derivatives of
/// ½∫ρ|distance from the axis|², sections turned by finite angles included.
/// @param axis  of unit length.
Dense beam_spin_softening(const Vector3& first, const Vector3& second,
                          const BeamMaterial& material, const BeamSection& section,
                          const Vector3& axis);

/// The same of a solid: ∫ρ NᵀPN, P the projection across the axis.
Dense solid_spin_softening(const ElementMatrices& element, const Vector3& axis);

/// Coriolis forces of a solid in a frame that spins about `axis`, for Ω = 1: 2∫ρ Nᵀ[axis ×]N, skew.
Dense solid_coriolis(const ElementMatrices& element, const Vector3& axis);
/// The same of a beam, with those of sections that turn.
Dense beam_coriolis(const Vector3& first, const Vector3& second,
                    const BeamMaterial& material, const BeamSection& section,
                    const Vector3& axis);

/// What a spin of 1 rad/s does to a solid of revolution in the frame at rest, through which its
/// material runs. Of u(x, t) each component is carried along: ü becomes (∂_t + Ω∂_θ)²u, with ∂_θ
/// the derivative along the turn of the place, each component for itself.
struct Convection {
  Dense gyroscopic; ///< 2∫ρ Nᵀ∂_θN, skew
  Dense softening;  ///< ∫ρ (∂_θN)ᵀ∂_θN
};
/// @param T  of the element's incompatible modes; without data: it has none.
Convection solid_convection(ElementType type, const std::vector<Vector3>& nodes,
                            double density, MassRule mass_rule, const Dense& T,
                            const Vector3& axis, const Vector3& point);

/// Gyroscopic moments of a beam on the axis of a spin of 1 rad/s, in the frame at rest; skew, no
/// larger than twice its mass. @param point  on the axis.
/// @throws Error if it lies elsewhere, or if I_y and I_z differ.
Dense beam_gyroscopic(const Vector3& first, const Vector3& second,
                      const BeamMaterial& material, const BeamSection& section,
                      const Vector3& axis, const Vector3& point);

/// A rod: two hinged ends, 3 dofs a node, consistent mass. @param A  its area [m²].
ElementMatrices rod_matrices(const Vector3& first, const Vector3& second,
                             const BeamMaterial& material, double A);

/// What its tension adds to the stiffness across it. @param u  six numbers. @param free  its strain
/// without stress.
StressStiffness rod_stress_stiffness(const Vector3& first, const Vector3& second,
                                     const BeamMaterial& material, double A,
                                     const std::vector<double>& u, double free,
                                     double& stress);

} // namespace flexgram
