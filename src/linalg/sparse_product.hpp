#pragma once

#include "linalg/block.hpp"

namespace flexgram {

/// A X for an AIJ matrix, several columns at a time: each entry of A is read once for
/// twelve columns, whose values lie side by side. Other matrix types go through SLEPc.
/// @param a  square, n×n, rows and columns split like the rows of x. Collective.
/// @note Column by column the same sums in the same order, however many columns there
/// are.
Block multiply(Mat a, const Block& x);

/// A X summed with twice the digits and rounded once: forces far below the rounding of A X, as
/// those of rigid motions, come out with all digits.
struct AccurateProduct {
  Block product;
  /// For each column √Σ (x_i a_ij x_j)²: XᵀAX changes by ε times this, if the entries of
  /// A are rounded at random.
  std::vector<double> spread;
  /// √Σ_j (a_ij x_j)² of each row, if asked for: a row of A X changes by ε times this.
  Block row_spread;
  Block rest; ///< A X − product, if asked for
};
struct AccurateParts {
  bool row_spread = false, rest = false;
};
/// @param a  AIJ, rows and columns split like the rows of x. Collective.
AccurateProduct multiply_accurately(Mat a, const Block& x, AccurateParts with = {});

/// |A| x: Σ_j |a_ij| x_j of this rank's rows i. @param a  AIJ. Collective.
std::vector<double> absolute_product(Mat a, const std::vector<double>& x);
/// Most entries of a row of an AIJ matrix, on any rank. Collective.
PetscInt longest_row(Mat a);

} // namespace flexgram
