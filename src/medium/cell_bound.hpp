/// The bound of a small model's error over cells of (ω, p) within a region (docs/proof.md,
/// section 5). Used by error_between.cpp.

#pragma once

#include "medium/cell_region.hpp"

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
  const MediumModel& medium_;
  const Certificate::Couplings& couplings_;
  CellRegion spaces_;
};

} // namespace flexgram
