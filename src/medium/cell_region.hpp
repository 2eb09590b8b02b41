/// Spaces of a region of (ω, p), and A between them (docs/proof.md, section 5). Used by cell_bound.cpp.

#pragma once

#include "medium/cell_series.hpp"

namespace flexgram {

/// R: the small model's space Q, and modes with values of the region that it does not hold. Z: the
/// rest of V, with coordinates where E is I, E the stiffness at the softest and fastest corner of the
/// region, less what gyroscopic forces and a spin may take there. C: the rest of the body.
struct CellRegion {
  /// @param Q          orthonormal basis of the small model's space.
  /// @param couplings  of V to the rest of the body.
  CellRegion(const MediumModel& medium, const Dense& Q,
             const Certificate::Couplings& couplings, const Cell& region);

  bool holds = false; ///< E is positive definite on Z, and on Z and C together
  /// RᵀAR, ZᵀAR, ZᵀAZ, CᵀAR and CᵀAZ; QᵀAQ and RᵀAQ, none where R is Q.
  struct Blocks {
    Matrices RR, ZR, ZZ, CR, CZ, QQ, RQ;
  };
  Blocks of_A, of_transposed; ///< the second of Aᵀ; none where A is symmetric
  const Blocks& of_outputs() const {
    return of_transposed.RR.empty() ? of_A : of_transposed;
  }
  Dense R_ports, Z_ports, Q_ports; ///< inputs, then outputs if they are others
  std::vector<double> ZZ_norms, CZ_norms;
  std::vector<double> R_sizes; ///< of the columns of R
  double Z_size = 0;
  double chi = 0;              ///< ‖CᵀEZ‖
  double kept = 1;             ///< CᵀEC is no less
  std::vector<double> C_sizes; ///< of CᵀK, CᵀM, CᵀT: Frobenius
};

} // namespace flexgram
