#pragma once

#include "fem/description.hpp"

namespace flexgram {

/// Which rank owns each node and element. The same on every rank: four bytes a node and
/// element.
struct Partition {
  std::vector<int> node_owner;                 ///< −1: in no element
  std::vector<std::vector<int>> element_owner; ///< by block
};

/// METIS partition of the mesh into as many parts as comm has ranks, made on rank 0. One
/// rank needs none. Collective.
Partition partition_mesh(const Hdf5File& file, const BodyDescription& body);

/// The elements of this rank and the coordinates of their nodes.
struct LocalElements {
  const MeshBlock* block;
  std::vector<std::int64_t> number;       ///< 0-based in the block
  std::vector<std::int64_t> connectivity; ///< node_count a element, global node numbers
  /// First and second axis of the material, block->axes of each element; empty: the material's own.
  std::vector<std::array<double, 6>> axes = {};
};

struct LocalMesh {
  std::vector<LocalElements> elements;
  std::vector<std::int64_t> nodes;  ///< global numbers, ascending
  std::vector<Vector3> coordinates; ///< of nodes [m]
  /// Place of a global node in `nodes`.
  std::size_t place(std::int64_t node) const;
};

/// Streams the mesh from the file and keeps this rank's part. Also keeps the nodes in
/// `extra`. Collective.
LocalMesh read_local_mesh(const Hdf5File& file, const BodyDescription& body,
                          const Partition& partition, std::vector<std::int64_t> extra);

} // namespace flexgram
