/// Linear constraints between displacements: dofs that follow others.

#pragma once

#include "io/hdf5_file.hpp"

#include <cstdint>
#include <span>
#include <vector>

namespace flexgram {

/// How much of a dof: factor · u(node, component).
struct Share {
  std::int64_t node;
  int component; ///< 0-2 displacements, 3-5 rotations
  double factor;
};

/// Dependent dofs, each a sum of shares of others, which depend on none.
struct Constraints {
  std::vector<std::int64_t> dof; ///< 6 · node + component of a dependent dof, ascending
  std::vector<std::size_t> start{0};
  std::vector<Share> shares; ///< of dof k: shares[start[k]] to shares[start[k + 1] - 1]

  /// Of a dependent dof.
  std::span<const Share> of(std::int64_t node, int component) const;
  /// Whether every dependent node is a mean of others, in all directions alike, so that u ↦ e × u of
  /// the independent nodes is that of the dependent ones too: no levers, no single directions.
  bool are_means() const;
};

/// Those of a body file (`/constraints`); none where it has no such group.
/// @param points  nodes of the mesh.
/// @throws Error for dofs that do not exist, depend twice, or depend on dependent ones.
Constraints read_constraints(const Hdf5File& file, std::int64_t points);

} // namespace flexgram
