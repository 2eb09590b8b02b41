/// A = kK + mM + Σ g T as it is, without factors: what solutions are held against.

#pragma once

#include "linalg/block.hpp"

#include <petscmat.h>

#include <algorithm>
#include <complex>
#include <vector>

namespace flexgram {

/// A = k K + m M + Σ g T. Real where all of these are.
struct ShiftCoefficients {
  std::complex<double> k, m;
  std::vector<std::complex<double>> terms{}; ///< g of each T; none: A has no terms
  bool real() const {
    const auto is_real = [](std::complex<double> c) { return c.imag() == 0; };
    return is_real(k) && is_real(m) && std::all_of(terms.begin(), terms.end(), is_real);
  }
};

/// A, and solutions of A X = B.
struct ShiftedMatrix {
  ShiftedMatrix(Mat stiffness, Mat mass, std::vector<Mat> terms);

  MPI_Comm comm;
  Mat K, M; ///< M may be null
  std::vector<Mat> terms;
  RowRange rows;
  ShiftCoefficients coefficients{};

  double norm() const; ///< upper bound of ‖A‖∞

  /// R ← B − A X on [Re, Im] columns (Re only if A is real); returns the backward error.
  double residual(const Block& b, const Block& x, Block& r) const;

  /// @throws ShiftError if a Rayleigh quotient xᴴAx/xᴴx = xᴴb/xᴴx of the solution, an
  /// estimate of A's smallest eigenvalue, lies below the rounding of A.
  void require_regular(const Block& b, const Block& x) const;

private:
  double norm_K_, norm_M_;
  std::vector<double> norms_of_terms_;
};

} // namespace flexgram
