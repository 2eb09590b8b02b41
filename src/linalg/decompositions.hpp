/// Eigenvalues, factors and solves of small dense matrices, by LAPACK.

#pragma once

#include "base/error.hpp"
#include "linalg/dense.hpp"

namespace flexgram {

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

/// B is not positive definite.
class IndefiniteError : public Error {
  using Error::Error;
};

/// Generalised problem A x = λ B x, B positive definite (LAPACK sygvd); Xᵀ B X = I.
/// @throws IndefiniteError if B is not positive definite.
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

/// Whether a Hermitian matrix is positive definite, of which the lower half is read: by Cholesky's
/// method, so up to rounding of the size of its norm.
bool is_positive_definite(ComplexDense a);
/// Eigenvalues of a Hermitian matrix, ascending (LAPACK zheev).
std::vector<double> hermitian_eigenvalues(ComplexDense a);

/// Eigenvalues of a general real matrix (LAPACK dgeev).
std::vector<std::complex<double>> general_eigenvalues(Dense a);

/// Eigenvalues and right eigenvectors of a general complex matrix (LAPACK zgeev).
struct ComplexEigen {
  std::vector<std::complex<double>> values;
  ComplexDense vectors; ///< columns of Euclidean norm 1
};
ComplexEigen complex_eigen(ComplexDense a);

/// X = A⁻¹ B by LU with partial pivoting (LAPACK gesv); A is overwritten.
/// @throws ShiftError if A is singular.
ComplexDense solve(ComplexDense a, ComplexDense b);

} // namespace flexgram
