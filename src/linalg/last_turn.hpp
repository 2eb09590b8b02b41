/// The last step of an eigenvalue problem that rounding has left undone.

#pragma once

#include "linalg/dense.hpp"

namespace flexgram {

/// A turn by I + Z, after which two nearly diagonal symmetric matrices K and M are diagonal to
/// first order: eigenvectors in doubles leave some 1e-16 beside the diagonals, which Z takes away
/// where it can be kept apart from them, in what is small already.
struct LastTurn {
  Dense Z;
  Dense rest_K, rest_M; ///< size of what is left of each entry, diagonals too, at most
};
/// Entries that a turn by more than a millionth would take away, as those between equal
/// eigenvalues, stay.
LastTurn last_turn(const Dense& K, const Dense& M);

} // namespace flexgram
