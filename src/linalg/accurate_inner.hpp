/// Inner products with twice the digits.

#pragma once

#include "linalg/block.hpp"

namespace flexgram {

/// hi + lo, |lo| at most half a unit in the last place of hi.
struct AccurateDense {
  Dense hi, lo;
};

/// Xᵀ(Y + rest), each sum with twice the digits (Ogita, Rump, Oishi: Accurate sum and dot
/// product, 2005): wrong by at most (n u)² |X|ᵀ|Y|, u = 2⁻⁵³, beside the rounding to hi + lo.
/// @param rest  far smaller than Y, or empty. Collective.
AccurateDense inner_accurately(const Block& x, const Block& y, const Block& rest);

} // namespace flexgram
