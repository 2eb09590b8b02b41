#include "base/index.hpp"
#include "examples.hpp"
#include "linalg/accurate_inner.hpp"
#include "linalg/decompositions.hpp"
#include "linalg/lanes.hpp"
#include "linalg/last_turn.hpp"

#include <array>
#include <random>

using namespace flexgram;
using namespace flexgram::examples;

namespace {

/// Hilbert-like columns whose singular values fall over 16 decades.
Block graded(PetscInt n, PetscInt columns) {
  return block(n, columns, [](PetscInt i, PetscInt j) {
    return 1.0 / (1.0 + static_cast<double>(i) / 7 + static_cast<double>(j));
  });
}

double distance_from_identity(const Dense& g) {
  Dense e = g;
  for (int i = 0; i < e.rows; ++i) e(i, i) -= 1;
  return frobenius_norm(e);
}

} // namespace

TEST(Block, ProductsMatchDenseAlgebra) {
  const PetscInt n = 23;
  const Block x = graded(n, 4), y = graded(n, 3);
  const Dense expected = multiply_transposed(whole(x), whole(y)), found = inner(x, y);
  for (std::size_t i = 0; i < found.data.size(); ++i)
    EXPECT_NEAR(found.data[i], expected.data[i], 1e-14 * n);
  Dense q(4, 2);
  q(0, 0) = 1;
  q(3, 1) = -2;
  const Dense combined = whole(combine(x, q)), all = whole(x);
  for (int i = 0; i < combined.rows; ++i) {
    EXPECT_DOUBLE_EQ(combined(i, 0), all(i, 0));
    EXPECT_DOUBLE_EQ(combined(i, 1), -2 * all(i, 3));
  }
}

TEST(Block, SparseProductsAreTheSameColumnByColumnInAnyCompany) {
  const PetscInt n = 41;
  const auto entry = [](PetscInt i, PetscInt j) {
    return std::sin(static_cast<double>(i + j)) + (i == j ? 3.0 : 0.0);
  };
  const auto value = [](PetscInt i, PetscInt j) {
    return std::cos(0.7 * static_cast<double>(i) + 2.3 * static_cast<double>(j));
  };
  const Matrix a = sparse(n, entry, 5);
  const Dense each = whole(multiply(a, block(n, 26, value)));
  for (int j = 0; j < each.columns; ++j)
    for (PetscInt i = 0; i < n; ++i) {
      double expected = 0;
      for (PetscInt k = std::max<PetscInt>(0, i - 5); k <= std::min(n - 1, i + 5); ++k)
        expected += entry(i, k) * value(k, j);
      ASSERT_NEAR(each(i, j), expected, 1e-14) << i << " " << j;
    }
  for (int columns = 1; columns < each.columns; ++columns) {
    const Dense some = whole(multiply(a, block(n, columns, value)));
    for (std::size_t i = 0; i < some.data.size(); ++i)
      ASSERT_EQ(some.data[i], each.data[i]) << columns << " columns";
  }
}

namespace {

template <int native>
std::array<double, 24> accurate_sums(const std::vector<double>& a,
                                     const std::vector<double>& x) {
  AccurateSum<native> sum;
  typename AccurateSum<native>::Numbers left, right;
  for (std::size_t k = 0; k < a.size(); k += 8) {
    left.load(&a[k]);
    right.load(&x[k]);
    sum.add(left, right);
  }
  std::array<double, 24> all{};
  sum.hi.store(&all[0]);
  sum.lo.store(&all[8]);
  sum.squares.store(&all[16]);
  return all;
}

} // namespace

TEST(Block, AccurateSumsAreTheSameInVectorsOfEachProcessor) {
  std::vector<double> a, x;
  for (int k = 0; k < 800; ++k) {
    a.push_back(std::sin(k) * std::exp2(k % 90));
    x.push_back(std::cos(3 * k) * std::exp2(k % 7));
  }
  const auto two = accurate_sums<2>(a, x);
  EXPECT_EQ(accurate_sums<4>(a, x), two);
  EXPECT_EQ(accurate_sums<8>(a, x), two);
  for (std::size_t l = 0; l < 8; ++l) {
    long double sum = 0, most = 0;
    for (std::size_t k = l; k < a.size(); k += 8) {
      const long double product = static_cast<long double>(a[k]) * x[k];
      sum += product;
      most += std::abs(product);
    }
    const long double found = static_cast<long double>(two[l]) + two[8 + l];
    EXPECT_LT(std::abs(found - sum), 1e-17L * most); // of long double
  }
}

TEST(Block, AccurateProductsKeepWhatCancels) {
  __extension__ typedef __float128 Quad;
  const PetscInt n = 30;
  const auto x = [](PetscInt i) { return 1 + 0.3 * std::sin(static_cast<double>(i)); };
  const auto beside = [](PetscInt i, PetscInt j) {
    return 1 + 0.1 * std::cos(static_cast<double>(3 * i + j));
  };
  const auto entry = [&](PetscInt i, PetscInt j) { // A x is what rounding leaves
    if (i != j) return beside(i, j);
    double sum = 0;
    for (PetscInt k : {i - 1, i + 1})
      if (k >= 0 && k < n) sum += beside(i, k) * x(k);
    return -sum / x(i);
  };
  const auto value = [&](PetscInt i, PetscInt j) {
    return x(i) / static_cast<double>(3 + j);
  };
  const Matrix a = sparse(n, entry, 1);
  const AccurateProduct found = multiply_accurately(a, block(n, 9, value));
  const Dense product = whole(found.product);
  for (int j = 0; j < product.columns; ++j) {
    double spread = 0;
    for (PetscInt i = 0; i < n; ++i) {
      Quad expected = 0;
      for (PetscInt k = std::max<PetscInt>(0, i - 1); k <= std::min(n - 1, i + 1); ++k) {
        const Quad term = static_cast<Quad>(entry(i, k)) * value(k, j);
        expected += term;
        spread += std::pow(static_cast<double>(term) * value(i, j), 2);
      }
      const auto rounded = static_cast<double>(expected);
      EXPECT_LT(std::abs(rounded), 1e-15);
      EXPECT_NEAR(product(i, j), rounded, 1e-15 * std::abs(rounded) + 1e-31);
    }
    EXPECT_NEAR(found.spread[as_size(j)], std::sqrt(spread), 1e-12 * std::sqrt(spread));
  }
}

namespace {

__extension__ typedef __float128 Quad;

/// UᵀAU in four times the digits of a float.
std::vector<Quad> exact_congruence(const Dense& A, const Dense& U) {
  const int n = A.rows, m = U.columns;
  std::vector<Quad> AU(as_size(n * m)), result(as_size(m * m));
  const auto at = [](int i, int j, int rows) { return as_size(i + j * rows); };
  for (int j = 0; j < m; ++j)
    for (int i = 0; i < n; ++i)
      for (int k = 0; k < n; ++k) AU[at(i, j, n)] += static_cast<Quad>(A(i, k)) * U(k, j);
  for (int j = 0; j < m; ++j)
    for (int i = 0; i < m; ++i)
      for (int k = 0; k < n; ++k)
        result[at(i, j, m)] += static_cast<Quad>(U(k, i)) * AU[at(k, j, n)];
  return result;
}

/// A dense spectrum over ten decades in a basis of its own.
Dense stiff(int n) {
  std::mt19937_64 random(5);
  std::uniform_real_distribution<double> even(-1, 1);
  Dense Q(n, n), K(n, n);
  for (double& q : Q.data) q = even(random);
  Q = orthonormal_columns(std::move(Q));
  for (int j = 0; j < n; ++j)
    for (int i = 0; i < n; ++i)
      for (int k = 0; k < n; ++k)
        K(i, j) += Q(i, k) * std::pow(10, 10.0 * k / n) * Q(j, k);
  symmetrise(K);
  return K;
}

} // namespace

TEST(Block, CongruencesOfSmallMatricesKeepTheirBound) {
  const int n = 40;
  const Dense K = stiff(n), U = symmetric_eigen(K).vectors;
  const Congruence found = congruence({K, Dense(n, n)}, U);
  const auto expected = exact_congruence(K, U);
  double worst = 0, largest = 0;
  for (int j = 0; j < n; ++j)
    for (int i = 0; i < n; ++i) {
      const Quad off = static_cast<Quad>(found.product.hi(i, j)) +
                       found.product.lo(i, j) - expected[as_size(i + j * n)];
      const double bound = found.rounding[as_size(i)] * found.rounding[as_size(j)];
      worst = std::max(worst, std::abs(static_cast<double>(off)) / bound);
      largest = std::max(largest, bound);
    }
  EXPECT_LE(worst, 1);
  EXPECT_LT(largest,
            1e-19 * 1e10); // where a plain product loses 1e-16 of the largest entry
}

TEST(Block, TheLastTurnLeavesWhatItSays) {
  const int n = 30;
  const Dense K = stiff(n), M = identity(n), U = symmetric_eigen(K).vectors;
  Dense K_U = congruence({K, Dense(n, n)}, U).product.hi,
        M_U = congruence({M, Dense(n, n)}, U).product.hi;
  for (Dense* A : {&K_U, &M_U})
    for (int j = 0; j < n; ++j)
      for (int i = 0; i < j; ++i) (*A)(j, i) = (*A)(i, j);
  const LastTurn turn = last_turn(K_U, M_U);
  double before = 0, after = 0;
  for (const Dense* A : {&K_U, &M_U}) {
    const Dense& rest = A == &K_U ? turn.rest_K : turn.rest_M;
    // (I + Z)ᵀA(I + Z): I + Z itself has no digits for Z in doubles.
    for (int j = 0; j < n; ++j)
      for (int i = 0; i < n; ++i) {
        if (i == j) continue;
        Quad left = (*A)(i, j);
        for (int k = 0; k < n; ++k) {
          left += static_cast<Quad>(turn.Z(k, i)) * (*A)(k, j) +
                  static_cast<Quad>((*A)(i, k)) * turn.Z(k, j);
          for (int l = 0; l < n; ++l)
            left += static_cast<Quad>(turn.Z(k, i)) * (*A)(k, l) * turn.Z(l, j);
        }
        const double unit = std::sqrt(std::abs((*A)(i, i) * (*A)(j, j)));
        EXPECT_LE(std::abs(static_cast<double>(left)), rest(i, j));
        before = std::max(before, std::abs((*A)(i, j)) / unit);
        after = std::max(after, rest(i, j) / unit);
      }
  }
  EXPECT_GT(before, 1e-17);
  EXPECT_LT(after, 1e-6 * before);
}

TEST(Block, TsqrGivesOrthonormalColumnsThatReproduceTheBlock) {
  const PetscInt n = 200, k = 12;
  Block q = graded(n, k);
  const Dense r = tsqr(q);
  // Householder QR: orthonormal to rounding whatever the condition (here 1e16).
  EXPECT_LT(distance_from_identity(inner(q, q)), 1e-13);
  const Dense product = whole(combine(q, r)), original = whole(graded(n, k));
  for (std::size_t i = 0; i < product.data.size(); ++i)
    EXPECT_NEAR(product.data[i], original.data[i], 1e-14);
}

TEST(Block, SvdOfTallAndOfWideBlocksFindsTheSameValues) {
  // Tall goes through TSQR, wide through the gathered path; both must see small values.
  for (const auto& [n, k] :
       {std::pair<PetscInt, PetscInt>{300, 15}, {20, 60}, {31, 30}}) {
    const LeftSvd reference = left_svd(whole(graded(n, k)));
    const BlockSvd svd = left_svd(graded(n, k), 1e-13);
    ASSERT_EQ(svd.values.size(), reference.values.size());
    for (std::size_t j = 0; j < svd.values.size(); ++j)
      EXPECT_NEAR(svd.values[j], reference.values[j], 1e-14 * reference.values[0]);
    EXPECT_LT(distance_from_identity(inner(svd.left, svd.left)), 1e-12);
    for (PetscInt j = 0; j < svd.left.columns(); ++j)
      EXPECT_GT(svd.values[as_size(j)], 1e-13 * svd.values[0]);
  }
}

TEST(Block, MovingABlockKeepsIt) {
  const PetscInt n = 17;
  const Block x = graded(n, 3);
  const Block moved = move_block(world(), x, PETSC_COMM_SELF, {0, n});
  const Dense expected = whole(x);
  const Block::Access access(moved);
  for (int j = 0; j < 3; ++j)
    for (int i = 0; i < n; ++i) EXPECT_EQ(access.column(j)[i], expected(i, j));
}

TEST(Block, DenseEigenSolversAndCholesky) {
  Dense a(2, 2), b = identity(2);
  a(0, 0) = 2;
  a(1, 1) = 5;
  b(1, 1) = 4;
  EXPECT_NEAR(symmetric_eigen(a, b).values[0], 1.25, 1e-15);
  EXPECT_NEAR(symmetric_eigen(a).values[1], 5, 1e-15);
  b(0, 0) = -1;
  EXPECT_THROW(symmetric_eigen(a, b), Error);
  EXPECT_EQ(cholesky(b), 1);
  ComplexDense singular(2, 2), rhs(2, 1);
  EXPECT_THROW(solve(singular, rhs), ShiftError);
}
