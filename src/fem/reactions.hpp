/// Forces and moments by which supports hold nodes, as outputs.

#pragma once

#include "fem/loads.hpp"

namespace flexgram {

/// The reaction at held dofs s is K_sf u + s²M_sf u − f_s: no row of C alone, for its
/// second term. Let w be the motion of s that works with the force asked for (a unit
/// translation or rotation of the nodes, of what is held of them) and ψ the motion of the free dofs with
/// M_ff ψ = −M_fs w, which dies off a few elements from the support. Then
///   wᵀ(K_sf + s²M_sf) u + ψᵀ(K_ff + s²M_ff) u = (K_fs w + K_ff ψ)ᵀ u,  and
///   ψᵀ(K_ff + s²M_ff) u = ψᵀf_f:
/// the reaction is (K_fs w + K_ff ψ)ᵀ u with −ψᵀf_f − wᵀf_s at once, exactly, with damping
/// by αM too. With βK and η the first term is (1 + iωβ + iη) times that (`OutputDamping`).
/// Both terms are large where ψ reaches far; neither is a force by itself.
class Reactions {
public:
  Reactions(MPI_Comm comm, const BodyDescription& body, const DofMap& map,
            const LocalMesh& mesh);
  bool any() const { return !columns_.empty(); }
  /// @param K, M  of the element, `dofs` rows a node.
  void add_element(const std::int64_t* nodes, const std::vector<Vector3>& x, int dofs,
                   const Dense& K, const Dense& M);
  /// What of the loads acts straight on held dofs; null where no reaction asks.
  HeldForces held_forces();
  /// Outputs, and what the inputs B add to them at once. Collective.
  Ports take(Mat K, Mat M, const Block& B, const std::vector<std::string>& inputs,
             Feedthrough& direct);

private:
  struct Column {
    const Reaction* reaction;
    int axis; ///< 0-2 force, 3-5 moment
  };
  /// How far the motion of the column moves a held component of a node; 0 for others.
  double motion(const Column& column, std::int64_t node, int c) const;
  /// The same of one that may follow held ones.
  double followed(const Column& column, std::int64_t node, int c) const;

  MPI_Comm comm_;
  const DofMap& map_;
  const LocalMesh& mesh_;
  std::vector<Column> columns_;
  NodalSums stiffness_, mass_;                      ///< K_fs w and M_fs w
  std::map<std::string, std::vector<double>> held_; ///< wᵀf_s of each input
};

} // namespace flexgram
