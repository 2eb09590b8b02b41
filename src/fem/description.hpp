#pragma once

#include "fem/constraints.hpp"
#include "fem/elements.hpp"
#include "fem/shell.hpp"
#include "io/hdf5_file.hpp"
#include "model/second_order_model.hpp"

#include <map>
#include <optional>

namespace flexgram {

/// Elements of one type, material and section.
struct MeshBlock {
  std::string path; ///< /mesh/blocks/… in the file
  ElementType type;
  std::string material, section;
  std::int64_t elements = 0;
  /// Material axes of each element: 1, or one at each point of the stiffness; 0: the material's own.
  std::size_t axes = 0;
};

enum class Coupling { rigid, distributing, node };

/// Where forces act: six ports (three for a node without rotations) at a reference point.
struct Interface {
  std::string name;
  Coupling coupling;
  Vector3 position{};              ///< reference point [m]
  std::vector<std::int64_t> nodes; ///< 0-based rows of /mesh/points
  std::vector<double> weights;     ///< distributing; empty: equal
};

struct Support {
  std::string name;
  std::vector<std::int64_t> nodes;
  std::vector<int> components; ///< 0-2 translations, 3-5 rotations held at zero
};

/// Nodes, or an interface whose reference, or node, is meant.
struct Place {
  std::vector<std::int64_t> nodes;
  std::string interface;
};

/// A mass at each node of a place.
struct PointMass {
  Place at;
  double mass = 0;                 ///< [kg]
  std::array<double, 6> inertia{}; ///< xx, yy, zz, xy, yz, zx of the tensor [kg m²]
  Vector3 offset{};                ///< of its centre of mass from the node [m]
  /// In the place of these, its M over u and θ of the node; `mass` is then the mean along the axes.
  std::optional<Dense> matrix = {};
};

/// A part of the stiffness of a material, or of a spring, with a law of its own.
struct MaterialTerm {
  enum class Part {
    whole, ///< all moduli
    shear, ///< the shear modulus of an isotropic material
    bulk,  ///< its bulk modulus
    damper ///< the damping of a spring
  };
  Part part;
  Law law; ///< beside the stiffness that K holds
};

/// Springs and dashpots from each node of a place to ground, or to another node.
struct Spring {
  Place from, to;           ///< the second of as many nodes, or of one; empty: ground
  Dense stiffness, damping; ///< 6×6 over relative displacements and rotations, symmetric
  double loss = 0;          ///< factor η of the stiffness
  std::vector<MaterialTerm> terms; ///< of the whole stiffness, or of the damping

  /// Whether the damping is a term.
  bool has_varying_damping() const;
};

/// A load that is the body's mass in a field of acceleration: uniform (gravity), e × x of
/// an angular acceleration about a point, or away from an axis through it (spin, for
/// Ω² = 1 rad²/s²).
struct AccelerationField {
  enum class Type { uniform, angular, spin };
  std::string name;
  Type type;
  Vector3 point{}, axis{}; ///< [m]; of unit length
  /// Of a uniform one whose only input is a multiple of this [m/s²].
  std::optional<Vector3> vector = std::nullopt;
};

/// Loads, or outputs, given by forces at nodes for a unit of each column.
struct NodalVectors {
  std::string name;
  std::vector<std::string> columns; ///< "p", "tx", "ux": kind and direction
  std::vector<std::int64_t> nodes;
  std::vector<double> values = {}; ///< nodes × columns × components
  std::size_t components = 3;      ///< forces, or forces and moments: 6
  Feedthrough feedthrough = {};    ///< of outputs: what loads add to them at once
};

/// The temperatures that a load means, above those without stress.
struct NodeTemperatures {
  std::string input; ///< of the load, for which they are given
  std::vector<std::int64_t> nodes;
  std::vector<double> values; ///< [K]
  /// Along the normal of shells, whose middle has these temperatures [K/m]; empty: none.
  std::vector<double> gradients = {};
};

/// A bolt that is tightened: the elements that have all of these nodes shorten along its axis.
struct Pretension {
  std::string input;               ///< of a load: the forces of a shortening by 1
  std::vector<std::int64_t> nodes; ///< ascending
  Vector3 axis{};
  double held =
      0; ///< ∫ of the stress along the axis, for that, with all nodes held [N m]
  double length = 0; ///< along the axis [m]
};

/// Forces and moments by which supports hold nodes, summed, as outputs.
struct Reaction {
  std::string name;
  std::vector<std::int64_t> nodes; ///< ascending
  Vector3 point{};                 ///< of the moments [m]
  std::vector<int> axes;           ///< 0-2 forces, 3-5 moments
};

/// A layer of a shell's section.
struct SectionLayer {
  std::string material;
  double thickness = 0; ///< [m]
  double angle = 0;     ///< of the material's first axis from the section's [rad]
  ShellRole role = ShellRole::all;
  double factor = 1;             ///< as ShellLayer's
  std::array<double, 2> sides{}; ///< so
};

/// A shell's section.
struct ShellSection {
  std::vector<SectionLayer>
      layers;           ///< bottom to top; none: one of its elements' material
  double thickness = 0; ///< [m]
  double offset = 0;    ///< of the middle surface above the nodes, along the normal [m]
  std::optional<Vector3>
      axis_1; ///< projected onto the surface: the material's first axis
  /// What bends and what shears, where it is told apart from what stretches; without a material that
  /// of the element.
  std::vector<SectionLayer> apart;
};

struct Material {
  SolidMaterial solid;
  SolidMaterial in_own_axes; ///< the same in the material's axes
  Vector3 axis_1{1, 0, 0};   ///< the first of these
  BeamMaterial beam;         ///< E and G; only for isotropic ones
  bool isotropic = true;
  double loss = 0; ///< factor η_k of its stiffness: K_k (1 + iη_k)
  std::vector<MaterialTerm> terms;
};

/// Inputs of a body by their names, and how much of each.
using LoadValues = std::vector<std::pair<std::string, double>>;

/// A body that turns: the field of its spin at 1 rad/s, and the speeds [rad/s] that it may have.
struct SpinRange {
  AccelerationField field;
  double least, most, value;
  bool turning; ///< seen in the frame that turns with the body, else in the frame at rest
};

/// A body given by its mesh: what to assemble, without the mesh itself.
struct BodyDescription {
  std::int64_t points = 0;
  std::vector<MeshBlock> blocks;
  std::map<std::string, Material> materials;
  std::map<std::string, BeamSection> sections;
  std::map<std::string, ShellSection> shells; ///< their sections
  std::map<std::string, PointMass> masses;
  std::map<std::string, Spring> springs;
  std::vector<MeshBlock> discrete; ///< of masses and springs, the material is their name
  std::vector<Interface> interfaces;
  std::vector<Support> supports;
  Constraints constraints;
  std::vector<AccelerationField> fields;
  std::vector<NodalVectors> loads, outputs;
  std::vector<Reaction> reactions;
  std::vector<NodeTemperatures> temperatures; ///< of loads
  std::vector<Pretension> pretensions;        ///< of loads
  /// Inputs that stay while the body vibrates, and how large they are.
  LoadValues preload;
  std::optional<SpinRange> spin; ///< the body turns, at a speed known between two numbers
  MassRule mass_rule = MassRule::full;
  std::vector<std::string> warnings; ///< doubtful values
};

/// @throws Error naming file and object on all ranks. Collective on file.comm().
BodyDescription read_description(const Hdf5File& file);

/// The layers of a block of shells, bottom to top.
std::vector<SectionLayer> layers_of(const BodyDescription& body, const MeshBlock& block);
/// What the elements of a block are made of, each material once.
std::vector<std::string> materials_of(const BodyDescription& body,
                                      const MeshBlock& block);

} // namespace flexgram
