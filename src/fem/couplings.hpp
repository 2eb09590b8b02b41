#pragma once

#include "fem/dof_map.hpp"
#include "linalg/block.hpp"

#include <functional>

namespace flexgram {

/// Motion of a point at distance d from a reference node: u_c = Σ_j G(c, j) q_j for the
/// six motions q (three translations, three small rotations) of the reference. 3 × 6.
Dense rigid_motion(const Vector3& d);

struct Ports {
  Block B; ///< n × ports
  std::vector<std::string> names;
  std::vector<std::string> remarks = {}; ///< of components that are held
};

/// Takes the part of a load that acts straight on a held component of a node.
using HeldForces = std::function<void(const std::string& input, std::int64_t node,
                                      int component, double value)>;

/// Ports of all interfaces. rigid: unit loads on the six dofs of the reference node. node:
/// unit loads on its dofs. distributing: B = W G (Gᵀ W G)⁻¹ over the nodes of the set, so
/// that a load at the reference is spread statically equivalently and the output is the
/// weighted mean motion (RBE3).
/// @param held  called on rank 0 for all interfaces; may be null.
Ports interface_ports(MPI_Comm comm, const BodyDescription& body, const DofMap& map,
                      const Positions& position, const HeldForces& held);

} // namespace flexgram
