#include "linalg/orthonormal.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

namespace flexgram {
namespace {

double largest_entry(const Dense& a) {
  double largest = 0;
  for (double x : a.data) largest = std::max(largest, std::abs(x));
  return largest;
}

/// X ← X − V (WV)ᵀX; returns the largest coefficient that was removed.
double remove(Block& X, const Block& V, const Block& WV) {
  if (!V || V.columns() == 0) return 0;
  const Dense c = inner(WV, X);
  add_product(X, -1.0, V, c);
  return largest_entry(c);
}

std::vector<double> inverse_norms(const Dense& gram) {
  std::vector<double> inverse;
  for (int j = 0; j < gram.rows; ++j)
    inverse.push_back(gram(j, j) > 0 ? 1 / std::sqrt(gram(j, j)) : 0.0);
  return inverse;
}

} // namespace

Block InnerProduct::apply(const Block& x) const {
  Block y = multiply(M, x);
  if (kappa != 0) {
    const Block k = multiply(K, x);
    Block::Access from(k), to(y);
    for (std::size_t i = 0; i < to.all().size(); ++i)
      to.all()[i] += kappa * from.all()[i];
  }
  return y;
}

Orthonormalised orthonormalise(Block X, const Block& V, const Block& WV,
                               const InnerProduct& product, double tolerance) {
  Block WX = product.apply(X);
  scale_columns(X, inverse_norms(inner(X, WX))); // unit norm: tolerances are relative
  remove(X, V, WV);

  // Directions that V does not hold, from the Gram matrix; its small eigenvalues are
  // known to 1e-16 only, so the square of the tolerance must not lie below that.
  WX = product.apply(X);
  Dense gram = inner(X, WX);
  symmetrise(gram);
  const SymmetricEigen eigen = symmetric_eigen(gram);
  const double floor =
      std::max(tolerance * tolerance, 8 * std::numeric_limits<double>::epsilon());
  Dense keep(gram.rows, 0);
  for (int j = gram.rows - 1; j >= 0 && eigen.values[static_cast<std::size_t>(j)] > floor;
       --j) {
    Dense direction = part_of(eigen.vectors, 0, gram.rows, j, 1);
    for (double& x : direction.data)
      x /= std::sqrt(eigen.values[static_cast<std::size_t>(j)]);
    keep = beside(keep, direction);
  }
  share_from_first(X.comm(), keep.data);
  X = combine(X, keep);
  if (keep.columns == 0)
    return {std::move(X), Block(WX.comm(), WX.local_rows(), WX.rows(), 0)};

  for (int pass = 0; pass < 4; ++pass) {
    const double removed = remove(X, V, WV);
    WX = product.apply(X);
    Dense l = inner(X, WX);
    symmetrise(l);
    Dense distance = l;
    for (int j = 0; j < l.rows; ++j) distance(j, j) -= 1;
    if (cholesky(l) != 0)
      throw Error(
          "orthonormalisation failed: the inner product is not positive on the basis");
    Dense inverse = identity(l.rows);
    solve_right_transposed(l, inverse); // I L⁻ᵀ
    X = combine(X, inverse);
    WX = combine(WX, inverse);
    if (removed < 1e-13 && largest_entry(distance) < 1e-10) break;
  }
  return {std::move(X), std::move(WX)};
}

double loss_of_orthogonality(const Block& V, const Block& WV) {
  Dense gram = inner(V, WV);
  for (int j = 0; j < gram.rows; ++j) gram(j, j) -= 1;
  return largest_entry(gram);
}

} // namespace flexgram
