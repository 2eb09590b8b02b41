/// Elements, and the nodes whose dofs move them: those of a rigid interface follow its reference,
/// and dependent dofs follow those of other nodes.

#pragma once

#include "fem/dof_map.hpp"
#include "linalg/dense.hpp"

#include <functional>
#include <span>

namespace flexgram {

/// An element, its nodes, and its masters: each of its nodes, or what it follows.
struct PlacedElement {
  const LocalElements& elements;
  std::size_t number; ///< in these
  const std::int64_t* nodes;
  std::vector<Vector3> x; ///< of the nodes [m]
  const std::int64_t* masters;
  std::size_t master_count;
  bool rigid; ///< all nodes follow one reference: there is no strain
  std::span<const std::array<double, 6>>
      axes; ///< of its material; empty: the material's own

  const MeshBlock& block() const { return *elements.block; }
};

/// The elements of this rank with their masters.
class Followers {
public:
  /// Both outlive this.
  Followers(const DofMap& map, const LocalMesh& mesh);

  void for_each(const std::function<void(const PlacedElement&)>& visit) const;

  /// Dofs of the element from those of its masters; empty where they are the same.
  Dense transformation(const PlacedElement& at) const;
  /// Displacements of its dofs. @param T  its transformation. @param u  of a master's component.
  Dense displacement(const PlacedElement& at, const Dense& T,
                     const std::function<double(std::int64_t, int)>& u) const;
  /// What forces at its nodes add to the stiffness where these follow a reference that turns: a
  /// slave at distance d moves by θ×d + ½θ×(θ×d) where its reference turns by θ, and with a force F
  /// between them the second derivatives of the energy are ½(F dᵀ + d Fᵀ) − Fᵀd I.
  /// @param forces  of the element at its dofs, less what loads exert there.
  /// @return over the dofs of the masters; empty without slaves.
  Dense turning(const PlacedElement& at, const Dense& forces) const;

  /// Of element e the masters are nodes()[k], start()[e] <= k < start()[e + 1].
  const std::vector<std::size_t>& start() const { return start_; }
  const std::vector<std::int64_t>& nodes() const { return node_; }

private:
  /// First dof of each master of the element, and behind them the number of all.
  std::vector<int> first_dofs(const PlacedElement& at) const;
  std::size_t place_of(const PlacedElement& at, std::int64_t master) const;
  const Vector3& position(std::int64_t node) const; ///< of a node, or of a reference [m]
  Vector3 arm(std::int64_t node, int reference) const;
  std::vector<Share> shares(std::int64_t node, int c) const;

  const DofMap& map_;
  const LocalMesh& mesh_;
  std::vector<std::size_t> start_{0};
  std::vector<std::int64_t> node_;
};

} // namespace flexgram
