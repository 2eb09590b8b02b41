#pragma once

#include "base/handle.hpp"
#include "base/parallel.hpp"
#include "linalg/shifted_solver.hpp"

#include <string>
#include <vector>

namespace flexgram {

/// This rank's rows of a sparse matrix: row i has columns column[start[i] … start[i+1]),
/// sorted.
struct LocalRows {
  std::vector<PetscInt> start{0}, column;
  std::vector<double> value;
};

/// The entries that are not zero. M couples no directions: two thirds of the pattern that
/// it shares with K are zero.
LocalRows nonzeros(const LocalRows& rows);
/// This rank's rows of a.
LocalRows local_rows(Mat a);

/// n×n AIJ matrix with the given rows here. Collective.
Matrix make_sparse(MPI_Comm comm, RowRange rows, PetscInt n, const LocalRows& local);
/// n×c AIJ matrix with the given rows here, for vectors with the rows `columns` here.
Matrix make_sparse(MPI_Comm comm, RowRange rows, PetscInt n, const LocalRows& local,
                   RowRange columns, PetscInt c);

/// Rows of a on this rank.
RowRange owned_rows(Mat a);

/// A copy of a on `comm` (a part of a's communicator), rows `rows` here. Collective on a.
Matrix move_sparse(Mat a, MPI_Comm comm, RowRange rows);

/// Diagonal, this rank's rows.
std::vector<double> diagonal(Mat a);

/// All entries off the diagonal zero (or absent), on every rank.
bool is_diagonal(Mat a);

/// The entry pair (i, j), (j, i) whose difference is largest; difference 0 if a is
/// symmetric to `tolerance` times its largest entry.
struct Asymmetry {
  PetscInt row = 0, column = 0;
  double upper = 0, lower = 0;
  double skew_norm = 0, norm = 0; ///< Frobenius norms of (A − Aᵀ)/2 and A
  std::int64_t pairs = 0;         ///< of entries that differ by more than the tolerance
  bool one_triangle = false;      ///< every entry on one side of the diagonal is zero
  bool symmetric = true;
};
Asymmetry find_asymmetry(Mat a, double tolerance);

/// Largest relative rounding of the entries if most of them have the same number of decimal
/// digits, 7 to 15, as printed numbers do; else 0. Looks at some thousand entries a rank.
/// Collective.
double printed_digits_rounding(Mat a);

/// α, β with D = αM + βK to `tolerance` in the Frobenius norm, if there are any.
struct ProportionalFit {
  bool proportional = false;
  double alpha = 0, beta = 0;
};
ProportionalFit fit_proportional(Mat D, Mat M, Mat K, double tolerance);

/// Negative eigenvalues of A after scaling to unit diagonal, below −floor. A is real
/// symmetric; rows without a diagonal entry are left unscaled. One factorisation.
int count_negative_eigenvalues(Mat a, double floor, SolverOptions options);

} // namespace flexgram
