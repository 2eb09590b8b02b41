/// Inner products, and products of small matrices, with twice the digits.

#pragma once

#include "linalg/block.hpp"

namespace flexgram {

/// hi + lo, |lo| at most half a unit in the last place of hi.
struct AccurateDense {
  Dense hi, lo;
};

enum class Triangle { both, upper };

/// Xᵀ(Y + rest), each sum with twice the digits (Ogita, Rump, Oishi: Accurate sum and dot
/// product, 2005): wrong by at most (n u)² |X|ᵀ|Y|, u = 2⁻⁵³, beside the rounding to hi + lo.
/// @param rest  far smaller than Y, or empty. Collective.
/// @param triangle  upper: of a symmetric result, the other one is its mirror image.
AccurateDense inner_accurately(const Block& x, const Block& y, const Block& rest,
                               Triangle triangle = Triangle::both);

/// AB, entry (i, j) wrong by at most product_rounding(k) times the largest entries of row i of A
/// and of column j of B, k = the columns of A: slices of A and B whose products have no rounding
/// (Ozaki, Ogita, Oishi, Rump: Error-free transformations of matrix multiplication, 2012).
/// @note Ten plain products.
AccurateDense multiply_accurately(const Dense& a, const Dense& b);
double product_rounding(int k);

struct Congruence {
  AccurateDense product;
  std::vector<double> rounding; ///< s: entry (i, j) is wrong by at most s_i s_j
};
/// Uᵀ(hi + lo)U of a symmetric matrix.
Congruence congruence(const AccurateDense& a, const Dense& U);

} // namespace flexgram
