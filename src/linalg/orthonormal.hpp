#pragma once

#include "linalg/basis.hpp"

namespace flexgram {

/// The inner product xᵀWy with W = M + κK. κ = 0 is the mass inner product; a body whose
/// M is singular needs κ > 0.
struct InnerProduct {
  Mat M = nullptr, K = nullptr;
  double kappa = 0;
  Block apply(const Block& x) const; ///< W X
};

/// New basis vectors, W times them, and the norm of what each given column had outside V.
struct Orthonormalised {
  Block vectors, weighted;
  std::vector<double> outside;
};

/// An orthonormal basis of what X adds to span V: W-orthonormal, and W-orthogonal to V.
/// Directions whose part outside V is below `tolerance` times their norm are dropped, by
/// the eigenvalues of the Gram matrix of the normalised columns. Gram-Schmidt in blocks,
/// repeated until what it still removes is rounding.
/// @param[in] V  basis so far; may be empty. W V is not kept: products with a few columns
///               cost no more than reading it would.
/// @note Collective. May return no columns.
Orthonormalised orthonormalise(Block X, const Basis& V, const InnerProduct& product,
                               double tolerance);

/// Directions of X, as columns in its coordinates, whose square in `gram` exceeds the floor: of length
/// 1 there, the largest first. @param least  becomes the smallest of these squares.
Dense kept_directions(const Dense& gram, double floor, double& least);

/// Largest entry of |VᵀWV − I| in so many columns, spread evenly over V, or in all it has.
double loss_of_orthogonality(const Basis& V, const InnerProduct& product, int columns);

} // namespace flexgram
