/// A = kK + mM + dD as it is, without factors: what solutions are held against.

#pragma once

#include "linalg/block.hpp"

#include <petscmat.h>

#include <complex>

namespace flexgram {

/// A = k K + m M + d D. Real where all three are real.
struct ShiftCoefficients {
  std::complex<double> k, m, d;
  bool real() const { return k.imag() == 0 && m.imag() == 0 && d.imag() == 0; }
};

/// A, and solutions of A X = B.
struct ShiftedMatrix {
  ShiftedMatrix(Mat stiffness, Mat mass, Mat damping);

  MPI_Comm comm;
  Mat K, M, D; ///< D may be null
  RowRange rows;
  ShiftCoefficients coefficients{};

  double norm() const; ///< upper bound of ‖A‖∞

  /// R ← B − A X on [Re, Im] columns (Re only if A is real); returns the backward error.
  double residual(const Block& b, const Block& x, Block& r) const;

  /// @throws ShiftError if a Rayleigh quotient xᴴAx/xᴴx = xᴴb/xᴴx of the solution, an
  /// estimate of A's smallest eigenvalue, lies below the rounding of A.
  void require_regular(const Block& b, const Block& x) const;

private:
  double norm_K_, norm_M_, norm_D_;
};

} // namespace flexgram
