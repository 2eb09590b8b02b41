#pragma once

#include "linalg/block.hpp"

namespace flexgram {

/// A X for an AIJ matrix, several columns at a time: each entry of A is read once for
/// eight columns, whose values lie side by side. Other matrix types go through SLEPc.
/// @param a  square, n×n, rows and columns split like the rows of x. Collective.
/// @note Column by column the same sums in the same order, however many columns there
/// are.
Block multiply(Mat a, const Block& x);

} // namespace flexgram
