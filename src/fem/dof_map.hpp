#pragma once

#include "fem/mesh.hpp"

#include <functional>

namespace flexgram {

/// Where nodes of the mesh are [m].
using Positions = std::function<Vector3(std::int64_t node)>;

/// Numbers the equations. Nodes of the mesh come first (0 … points − 1), then one
/// reference node for each rigid interface. A node has three dofs, six where a beam or a
/// shell ends or at a reference; slaves of a rigid interface, dependent dofs and dofs held
/// by a support have no equation. The equations of a rank follow each other, node by node.
/// The same on every rank, about 20 bytes a node.
struct DofMap {
  std::int64_t points = 0;             ///< nodes of the mesh
  std::vector<std::int8_t> dofs;       ///< 0 (unused), 3 or 6
  std::vector<std::uint8_t> held;      ///< bit c: component c is held by a support
  std::vector<std::uint8_t> dependent; ///< bit c: component c follows a constraint
  Constraints constraints;
  std::vector<int> reference;  ///< node number of the master of a slave, or −1
  std::vector<int> owner;      ///< rank, −1 for unused nodes
  std::vector<PetscInt> first; ///< first equation of the node, −1 if it has none
  std::vector<Vector3> reference_position; ///< of the reference nodes
  PetscInt n = 0;
  RowRange rows;

  /// Equation of component c of a node that is no slave and where it is not dependent, or −1.
  PetscInt equation(std::int64_t node, int c) const;
  /// Whether the node moves by its own dofs alone.
  bool moves_alone(std::int64_t node) const {
    const auto i = static_cast<std::size_t>(node);
    return reference[i] < 0 && dependent[i] == 0;
  }
  /// What component c of a node moves with: itself, dofs of a reference, or of other nodes. Some
  /// of these may be held.
  std::vector<Share> shares(std::int64_t node, int c, const Positions& position) const;
  int equations(std::int64_t node) const;
  bool is_held(std::int64_t node, int c) const;
  /// Reference node of interface i, −1 if it is not rigid.
  std::vector<std::int64_t> reference_of_interface;
};

/// @throws Error for a node in two rigid interfaces, a supported slave or dependent dof, a node of
/// an interface, support or constraint that belongs to no element. Collective.
DofMap number_equations(const Hdf5File& file, const BodyDescription& body,
                        const Partition& partition);

} // namespace flexgram
