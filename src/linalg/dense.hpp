#pragma once

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
        data(static_cast<std::size_t>(row_count) *
             static_cast<std::size_t>(column_count)) {}
  T& operator()(int i, int j) { return data[index(i, j)]; }
  const T& operator()(int i, int j) const { return data[index(i, j)]; }
  T* column(int j) { return data.data() + index(0, j); }
  const T* column(int j) const { return data.data() + index(0, j); }

  int rows = 0, columns = 0;
  std::vector<T> data;

private:
  std::size_t index(int i, int j) const {
    return static_cast<std::size_t>(i) +
           static_cast<std::size_t>(j) * static_cast<std::size_t>(rows);
  }
};
using Dense = DenseOf<double>;
using ComplexDense = DenseOf<std::complex<double>>;

Dense identity(int order);
Dense transpose(const Dense& a);
Dense multiply(const Dense& a, const Dense& b);            ///< A B
Dense multiply_transposed(const Dense& a, const Dense& b); ///< Aᵀ B
Dense first_columns(const Dense& a, int count);
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

/// Generalised problem A x = λ B x, B positive definite (LAPACK sygvd); Xᵀ B X = I.
/// @throws Error if B is not positive definite.
SymmetricEigen symmetric_eigen(Dense a, Dense b);

/// Lower triangle L with A = L Lᵀ. Returns the order of the leading minor that is not
/// positive, or 0 on success.
int cholesky(Dense& a);
/// X ← X L⁻ᵀ, so that X L⁻ᵀ has the columns that Cholesky-QR wants.
void solve_right_transposed(const Dense& l, Dense& x);

/// Singular values (descending) and left singular vectors, rows × min(rows, columns), by
/// the SLEPc SVD solver of LAPACK type on one rank's copy.
struct LeftSvd {
  std::vector<double> values;
  Dense vectors;
};
LeftSvd left_svd(const Dense& a);

/// X = A⁻¹ B by LU with partial pivoting (LAPACK gesv); A is overwritten.
/// @throws ShiftError if A is singular.
ComplexDense solve(ComplexDense a, ComplexDense b);

} // namespace flexgram
