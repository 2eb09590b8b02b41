#pragma once

#include "base/index.hpp"

#include <complex>
#include <cstddef>
#include <vector>

namespace flexgram {

/// A small dense matrix, column-major, the same on every rank.
template <class T>
struct DenseOf {
  DenseOf() = default;
  DenseOf(int row_count, int column_count)
      : rows(row_count), columns(column_count),
        data(as_size(row_count) * as_size(column_count)) {}
  T& operator()(int i, int j) { return data[index(i, j)]; }
  const T& operator()(int i, int j) const { return data[index(i, j)]; }
  T* column(int j) { return data.data() + index(0, j); }
  const T* column(int j) const { return data.data() + index(0, j); }

  int rows = 0, columns = 0;
  std::vector<T> data;

private:
  std::size_t index(int i, int j) const {
    return as_size(i) + as_size(j) * as_size(rows);
  }
};
using Dense = DenseOf<double>;
using ComplexDense = DenseOf<std::complex<double>>;

Dense identity(int order);
Dense transpose(const Dense& a);
Dense multiply(const Dense& a, const Dense& b);            ///< A B
Dense multiply_transposed(const Dense& a, const Dense& b); ///< Aᵀ B
/// Rows [r0, r0 + rows) and columns [c0, c0 + columns) of A.
Dense part_of(const Dense& a, int r0, int rows, int c0, int columns);
/// Copies `part` into A from row r0, column c0 on.
void set_part(Dense& a, int r0, int c0, const Dense& part);
Dense beside(const Dense& a, const Dense& b); ///< [A B]; either may be empty
Dense first_columns(const Dense& a, int count);
/// The chosen columns, in that order.
Dense columns_of(const Dense& a, const std::vector<int>& columns);
ComplexDense columns_of(const ComplexDense& a, const std::vector<int>& columns);
/// The same, column j of A divided by divisors[j].
Dense columns_of(const Dense& a, const std::vector<int>& columns,
                 const std::vector<double>& divisors);
Dense absolute(Dense a);                                  ///< |A_ij|
void add_to(Dense& a, const Dense& b, double factor = 1); ///< A ← A + factor B
double frobenius_norm(const Dense& a);
double frobenius_norm(const ComplexDense& a);
/// Replaces A by (A + Aᵀ)/2.
void symmetrise(Dense& a);

/// Eigenvalues ascending, eigenvectors as columns (LAPACK syevd).
struct SymmetricEigen {
  std::vector<double> values;
  Dense vectors;
};
SymmetricEigen symmetric_eigen(Dense a);

/// FᵀF = A + added, A positive semidefinite but for rounding; added = 1e-15 rows ‖A‖ on its
/// diagonal.
struct GramFactor {
  Dense F, inverse;
  std::vector<double> roots; ///< of the eigenvalues of FᵀF, ascending: norms of F's rows
  double added = 0;
};
GramFactor gram_factor(const Dense& a);

/// Generalised problem A x = λ B x, B positive definite (LAPACK sygvd); Xᵀ B X = I.
/// @throws Error if B is not positive definite.
SymmetricEigen symmetric_eigen(Dense a, Dense b);

/// Orthonormal basis of nested column spans: the first j columns of the result span those
/// of A (Householder QR). A has at least as many rows as columns.
Dense orthonormal_columns(Dense a);

/// A square L (rows × rows) with LLᵀ = AAᵀ, by QR of Aᵀ: nothing is squared. A has at
/// least as many columns as rows; narrower ones come back as they are.
Dense compressed(const Dense& a);

/// Lower triangle L with A = L Lᵀ. Returns the order of the leading minor that is not
/// positive, or 0 on success.
int cholesky(Dense& a);
/// X ← X L⁻ᵀ, so that X L⁻ᵀ has the columns that Cholesky-QR wants.
void solve_right_transposed(const Dense& l, Dense& x);
Dense inverse_transposed(const Dense& l); ///< L⁻ᵀ of a lower triangle

/// Singular values (descending) and left singular vectors, rows × min(rows, columns), by
/// the SLEPc SVD solver of LAPACK type on one rank's copy.
struct LeftSvd {
  std::vector<double> values;
  Dense vectors;
};
LeftSvd left_svd(const Dense& a);

/// Eigenvalues of a Hermitian matrix, ascending (LAPACK zheev).
std::vector<double> hermitian_eigenvalues(ComplexDense a);

ComplexDense multiply(const Dense& a, const ComplexDense& b);            ///< A B
ComplexDense multiply_transposed(const Dense& a, const ComplexDense& b); ///< Aᵀ B
ComplexDense multiply(const ComplexDense& a, const ComplexDense& b);     ///< A B
/// AᵀB without, AᴴB with conjugation.
ComplexDense multiply_transposed(const ComplexDense& a, const ComplexDense& b,
                                 bool conjugate = false);

/// Eigenvalues of a general real matrix (LAPACK dgeev).
std::vector<std::complex<double>> general_eigenvalues(Dense a);

/// X = A⁻¹ B by LU with partial pivoting (LAPACK gesv); A is overwritten.
/// @throws ShiftError if A is singular.
ComplexDense solve(ComplexDense a, ComplexDense b);

} // namespace flexgram
