#include "linalg/orthonormal.hpp"

#include "base/event.hpp"
#include "base/index.hpp"
#include "linalg/decompositions.hpp"
#include "linalg/sparse_product.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

namespace flexgram {
namespace {

/// X ← X − V VᵀWX from WX; returns the coefficients VᵀWX.
Dense remove(Block& X, const Basis& V, const Block& WX) {
  if (!V) return Dense(0, static_cast<int>(X.columns()));
  Dense c = inner(V, WX);
  add_product(X, -1.0, V, c);
  return c;
}

} // namespace

Dense kept_directions(const Dense& gram, double floor, double& least) {
  const SymmetricEigen eigen = symmetric_eigen(gram);
  Dense keep(gram.rows, 0);
  least = 1;
  for (int j = gram.rows - 1; j >= 0 && eigen.values[as_size(j)] > floor; --j) {
    least = eigen.values[as_size(j)];
    Dense direction = part_of(eigen.vectors, 0, gram.rows, j, 1);
    for (double& x : direction.data) x /= std::sqrt(least);
    keep = beside(keep, direction);
  }
  return keep;
}

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

Orthonormalised orthonormalise(Block X, const Basis& V, const InnerProduct& product,
                               double tolerance) {
  static Event event("Orthonormalise");
  const auto timed = event.timed();
  Orthonormalised result;
  Block WX = product.apply(X);
  const Dense inside = remove(X, V, WX);
  if (V) WX = product.apply(X);
  Dense gram = inner(X, WX);
  symmetrise(gram);
  std::vector<double> inverse; // of the norms before the removal (Pythagoras)
  for (int j = 0; j < gram.rows; ++j) {
    double square = std::max(gram(j, j), 0.0);
    result.outside.push_back(std::sqrt(square));
    for (int i = 0; i < inside.rows; ++i) square += inside(i, j) * inside(i, j);
    inverse.push_back(square > 0 ? 1 / std::sqrt(square) : 0.0);
  }
  for (int j = 0; j < gram.rows; ++j)
    for (int i = 0; i < gram.rows; ++i)
      gram(i, j) *= inverse[as_size(i)] * inverse[as_size(j)];

  // Small eigenvalues of a Gram matrix are known to 1e-16 of the largest only.
  const double epsilon = std::numeric_limits<double>::epsilon();
  double least = 1;
  Dense keep = kept_directions(gram, std::max(tolerance * tolerance, 8 * epsilon), least);
  for (int j = 0; j < keep.columns; ++j)
    for (int i = 0; i < keep.rows; ++i) keep(i, j) *= inverse[as_size(i)];
  share_from_first(X.comm(), keep.data);
  X = combine(X, keep);
  WX = combine(WX, keep);

  // What was magnified much is multiplied anew; what is nearly right is corrected.
  bool anew = least < 1e-6;
  for (int pass = 0; keep.columns > 0 && pass < 4; ++pass) {
    if (anew) WX = product.apply(X);
    const Dense removed = remove(X, V, WX);
    if (max_norm(removed) > 1e-12) WX = product.apply(X); // else W V c is rounding
    Dense l = inner(X, WX);
    symmetrise(l);
    Dense distance = l;
    for (int j = 0; j < l.rows; ++j) distance(j, j) -= 1;
    Dense correction;
    if (const Dense gram_of_rest = l; cholesky(l) == 0) {
      correction = inverse_transposed(l);
    } else { // V spans all but rounding of them: what is left of unit length is new
      correction = kept_directions(gram_of_rest, 0.1, least);
      share_from_first(X.comm(), correction.data);
    }
    X = combine(X, correction);
    WX = combine(WX, correction);
    if (correction.columns == 0) break;
    // The next pass would remove the square of this one: rounding.
    if (max_norm(removed) < 1e-8 && max_norm(distance) < 1e-7) break;
    anew = true;
  }
  result.vectors = std::move(X);
  result.weighted = std::move(WX);
  return result;
}

double loss_of_orthogonality(const Basis& V, const InnerProduct& product, int columns) {
  const int all = static_cast<int>(V.columns()), count = std::min(columns, all);
  Dense chosen(all, count);
  for (int j = 0; j < count; ++j)
    chosen(count > 1 ? j * (all - 1) / (count - 1) : 0, j) = 1;
  Dense gram = inner(V, product.apply(combine(V, chosen)));
  add_to(gram, chosen, -1);
  return max_norm(gram);
}

} // namespace flexgram
