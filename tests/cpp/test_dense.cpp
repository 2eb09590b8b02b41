/// Norms of small matrices: balanced ones, and the spectral norm against all singular values.

#include "linalg/decompositions.hpp"
#include "medium/cell_series.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

using namespace flexgram;

namespace {

ComplexDense random_matrix(int rows, int columns, unsigned seed) {
  std::mt19937 random(seed);
  std::normal_distribution<double> normal;
  ComplexDense a(rows, columns);
  for (auto& x : a.data) x = {normal(random), normal(random)};
  return a;
}

/// A similarity that is undone: slow modes beside fast ones.
TEST(Dense, BalancingFindsTheScale) {
  const int n = 12;
  ComplexDense a = random_matrix(n, n, 1);
  const double known = norm_bound(a);
  for (int j = 0; j < n; ++j)
    for (int i = 0; i < n; ++i)
      a(i, j) *= std::pow(10.0, 0.5 * ((i * 5) % n) - 0.5 * ((j * 5) % n));
  EXPECT_GT(norm_bound(a), 100 * known);
  EXPECT_LT(norm_bound(balanced(a, balancing(a))), 1.5 * known);
}

/// Rows and columns of zeros, and one order of magnitude too far, leave a matrix as it is.
TEST(Dense, BalancingIsBounded) {
  ComplexDense a(3, 3);
  a(0, 1) = 1e30;
  a(1, 0) = 1e-30;
  for (double d : balancing(a)) {
    EXPECT_GE(d, 1e-3);
    EXPECT_LE(d, 1e3);
  }
  EXPECT_EQ(balancing(ComplexDense(2, 2)), std::vector<double>(2, 1.0));
}

TEST(Dense, SpectralNormIsAnUpperBoundAndClose) {
  const auto exact = [](const ComplexDense& a) {
    return std::sqrt(hermitian_eigenvalues(multiply_transposed(a, a, true)).back());
  };
  for (unsigned seed = 0; seed < 40; ++seed) {
    ComplexDense a = random_matrix(20 + static_cast<int>(seed), 20, seed);
    if (seed % 4 == 1) // one direction is large
      for (int i = 0; i < a.rows; ++i) a(i, 3) *= 1e6;
    if (seed % 4 == 2) { // few are there at all
      const ComplexDense b = random_matrix(a.rows, 2, seed + 100);
      a = multiply(b, random_matrix(2, 20, seed + 200));
    }
    if (seed % 4 == 3) // two that are alike
      for (int i = 0; i < a.rows; ++i) a(i, 3) *= 1e3, a(i, 7) *= 1e3;
    const double norm = spectral_norm(a), known = exact(a);
    EXPECT_GE(norm, known * (1 - 1e-12)) << seed;
    EXPECT_LE(norm, known * 1.01) << seed;
  }
  EXPECT_EQ(spectral_norm(ComplexDense(4, 3)), 0);
}

} // namespace
