/// The bound of a small model's error over cells of (ω, p) within a region (docs/proof.md,
/// section 5). Used by error_between.cpp.

#pragma once

#include "medium/cell_region.hpp"

#include <optional>

namespace flexgram {

class CellBound {
public:
  /// @param Q          orthonormal basis of the small model's space.
  /// @param couplings  of V to the rest of the body; outlives this.
  CellBound(const MediumModel& medium, const Dense& Q,
            const Certificate::Couplings& couplings, const Cell& region);

  /// Whether E at the softest and fastest corner of the region is positive definite beside Q.
  bool holds() const { return spaces_.holds; }

  struct Look {
    std::vector<double> worst_of; ///< ε of each view; none: unknown
    std::size_t longest = 0;      ///< variable along which the cell is longest
  };
  /// @pre holds(); the cell lies in the region.
  Look look(const Cell& cell) const;

private:
  struct Side;
  struct Norms;
  Side side(const Cell& cell, const CellFactors& factors,
            const CellRegion::Blocks& A) const;
  /// Nothing if S may be singular. @param along  of each variable how far ZᵀAZ moves by it.
  std::optional<Norms> norms(const Cell& cell, const CellFactors& factors,
                             const Side& inputs, const Side& outputs,
                             std::vector<double>& along) const;
  void solve(Side& side, const Side& other, const CellRegion::Blocks& A,
             const CellFactors& factors, const Norms& n) const;

  const MediumModel& medium_;
  const Certificate::Couplings& couplings_;
  CellRegion spaces_;
};

} // namespace flexgram
