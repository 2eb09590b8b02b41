#include "linalg/sparse.hpp"

#include "base/text.hpp"

#include "base/index.hpp"
#include "linalg/shifted_solver.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdlib>
#include <limits>
#include <string>

namespace flexgram {

Matrix make_sparse(MPI_Comm comm, RowRange rows, PetscInt n, const LocalRows& local,
                   RowRange columns, PetscInt c) {
  Matrix a;
  FG_CALL(MatCreate(comm, a.out()));
  FG_CALL(MatSetSizes(a, rows.size(), columns.size(), n, c));
  FG_CALL(MatSetType(a, MATAIJ));
  FG_CALL(MatSeqAIJSetPreallocationCSR(a, local.start.data(), local.column.data(),
                                       local.value.data()));
  FG_CALL(MatMPIAIJSetPreallocationCSR(a, local.start.data(), local.column.data(),
                                       local.value.data()));
  return a;
}

Matrix make_sparse(MPI_Comm comm, RowRange rows, PetscInt n, const LocalRows& local) {
  Matrix a = make_sparse(comm, rows, n, local, rows, n);
  FG_CALL(MatSetOption(a, MAT_SYMMETRIC, PETSC_TRUE));
  return a;
}

RowRange owned_rows(Mat a) {
  RowRange rows;
  FG_CALL(MatGetOwnershipRange(a, &rows.begin, &rows.end));
  return rows;
}

Matrix move_sparse(Mat a, MPI_Comm comm, RowRange rows) {
  PetscInt n = 0;
  FG_CALL(MatGetSize(a, &n, nullptr));
  Handle<IS> wanted, everything;
  FG_CALL(ISCreateStride(PETSC_COMM_SELF, rows.size(), rows.begin, 1, wanted.out()));
  FG_CALL(ISCreateStride(PETSC_COMM_SELF, n, 0, 1, everything.out()));
  Mat* part = nullptr;
  const IS row_set = wanted, column_set = everything;
  FG_CALL(MatCreateSubMatrices(a, 1, &row_set, &column_set, MAT_INITIAL_MATRIX, &part));
  Matrix result;
  FG_CALL(MatCreateMPIMatConcatenateSeqMat(comm, part[0], rows.size(), MAT_INITIAL_MATRIX,
                                           result.out()));
  FG_CALL(MatDestroySubMatrices(1, &part));
  FG_CALL(MatSetOption(result, MAT_SYMMETRIC, PETSC_TRUE));
  return result;
}

namespace {

/// Calls visit(row, column, value) for every stored entry of this rank's rows.
template <class Visit>
void for_each_entry(Mat a, Visit&& visit) {
  const RowRange rows = owned_rows(a);
  for (PetscInt row = rows.begin; row < rows.end; ++row) {
    PetscInt count = 0;
    const PetscInt* columns = nullptr;
    const PetscScalar* values = nullptr;
    FG_CALL(MatGetRow(a, row, &count, &columns, &values));
    for (PetscInt k = 0; k < count; ++k) visit(row, columns[k], values[k]);
    FG_CALL(MatRestoreRow(a, row, &count, &columns, &values));
  }
}

MPI_Comm comm_of(Mat a) { return PetscObjectComm(reinterpret_cast<PetscObject>(a)); }

double frobenius(Mat a) {
  PetscReal norm = 0;
  FG_CALL(MatNorm(a, NORM_FROBENIUS, &norm));
  return norm;
}

Matrix duplicate(Mat a) {
  Matrix copy;
  FG_CALL(MatDuplicate(a, MAT_COPY_VALUES, copy.out()));
  return copy;
}

} // namespace

LocalRows local_rows(Mat a) {
  LocalRows local;
  PetscInt current = owned_rows(a).begin;
  const auto close_until = [&](PetscInt row) {
    for (; current < row; ++current)
      local.start.push_back(static_cast<PetscInt>(local.column.size()));
  };
  for_each_entry(a, [&](PetscInt row, PetscInt column, double value) {
    close_until(row);
    local.column.push_back(column);
    local.value.push_back(value);
  });
  close_until(owned_rows(a).end);
  return local;
}

LocalRows nonzeros(const LocalRows& rows) {
  LocalRows kept;
  for (std::size_t i = 0; i + 1 < rows.start.size(); ++i) {
    for (auto k = as_size(rows.start[i]); k < as_size(rows.start[i + 1]); ++k)
      if (rows.value[k] != 0) {
        kept.column.push_back(rows.column[k]);
        kept.value.push_back(rows.value[k]);
      }
    kept.start.push_back(static_cast<PetscInt>(kept.column.size()));
  }
  return kept;
}

std::vector<double> diagonal(Mat a) {
  Handle<Vec> d;
  FG_CALL(MatCreateVecs(a, nullptr, d.out()));
  FG_CALL(MatGetDiagonal(a, d));
  const PetscScalar* values = nullptr;
  FG_CALL(VecGetArrayRead(d, &values));
  std::vector<double> result(values, values + owned_rows(a).size());
  FG_CALL(VecRestoreArrayRead(d, &values));
  return result;
}

bool is_diagonal(Mat a) {
  std::int64_t off = 0;
  for_each_entry(a, [&](PetscInt i, PetscInt j, double x) { off += i != j && x != 0; });
  return sum_over(comm_of(a), off) == 0;
}

Asymmetry find_asymmetry(Mat a, double tolerance) {
  Asymmetry result;
  // A probe costs two products; only if it finds a difference is the transpose formed.
  Handle<Vec> x, ax, atx;
  FG_CALL(MatCreateVecs(a, x.out(), ax.out()));
  FG_CALL(VecDuplicate(ax, atx.out()));
  FG_CALL(VecSetRandom(x, nullptr));
  FG_CALL(MatMult(a, x, ax));
  FG_CALL(MatSetOption(a, MAT_SYMMETRIC, PETSC_FALSE));
  FG_CALL(MatMultTranspose(a, x, atx));
  PetscReal size = 0, difference = 0;
  FG_CALL(VecNorm(ax, NORM_INFINITY, &size));
  FG_CALL(VecAXPY(atx, -1.0, ax));
  FG_CALL(VecNorm(atx, NORM_INFINITY, &difference));
  result.norm = frobenius(a);
  // Products of a symmetric matrix differ by the order of their sums.
  if (difference <= 4 * std::numeric_limits<double>::epsilon() * result.norm) {
    FG_CALL(MatSetOption(a, MAT_SYMMETRIC, PETSC_TRUE));
    return result;
  }
  Matrix skew;
  FG_CALL(MatTranspose(a, MAT_INITIAL_MATRIX, skew.out()));
  FG_CALL(MatAYPX(skew, -1.0, a, DIFFERENT_NONZERO_PATTERN)); // A − Aᵀ
  double largest = 0, entry_max = 0;
  for_each_entry(skew, [&](PetscInt i, PetscInt j, double value) {
    if (std::abs(value) > largest) {
      largest = std::abs(value);
      result.row = i;
      result.column = j;
    }
  });
  std::int64_t above = 0, below = 0;
  for_each_entry(a, [&](PetscInt i, PetscInt j, double value) {
    entry_max = std::max(entry_max, std::abs(value));
    above += j > i && value != 0;
    below += j < i && value != 0;
  });
  const MPI_Comm comm = comm_of(a);
  entry_max = max_over(comm, entry_max);
  result.one_triangle = sum_over(comm, above) == 0 || sum_over(comm, below) == 0;
  result.skew_norm = 0.5 * frobenius(skew);
  struct {
    double value;
    int rank;
  } mine{largest, comm_rank(comm)}, worst{};
  MPI_Allreduce(&mine, &worst, 1, MPI_DOUBLE_INT, MPI_MAXLOC, comm);
  PetscInt place[2] = {result.row, result.column};
  MPI_Bcast(place, 2, MPIU_INT, worst.rank, comm);
  result.row = place[0];
  result.column = place[1];
  const auto entry = [&](PetscInt row, PetscInt column) {
    double found = 0;
    for_each_entry(a, [&](PetscInt i, PetscInt j, double value) {
      if (i == row && j == column) found = value;
    });
    return sum_over(comm, found);
  };
  result.upper = entry(result.row, result.column);
  result.lower = entry(result.column, result.row);
  result.symmetric = worst.value <= tolerance * entry_max;
  for_each_entry(skew, [&](PetscInt i, PetscInt j, double value) {
    result.pairs += i < j && std::abs(value) > tolerance * entry_max;
  });
  result.pairs = sum_over(comm, result.pairs);
  if (result.symmetric) FG_CALL(MatSetOption(a, MAT_SYMMETRIC, PETSC_TRUE));
  return result;
}

ProportionalFit fit_proportional(Mat D, Mat M, Mat K, double tolerance) {
  Handle<Vec> x, d, m, k;
  FG_CALL(MatCreateVecs(D, x.out(), d.out()));
  FG_CALL(VecDuplicate(d, m.out()));
  FG_CALL(VecDuplicate(d, k.out()));
  FG_CALL(VecSetRandom(x, nullptr));
  FG_CALL(MatMult(D, x, d));
  FG_CALL(MatMult(M, x, m));
  FG_CALL(MatMult(K, x, k));
  // Least squares for D x = α M x + β K x by Gram-Schmidt on (K x, M x).
  PetscReal norm_k = 0, norm_m = 0;
  PetscScalar km = 0, kd = 0, md = 0;
  FG_CALL(VecNorm(k, NORM_2, &norm_k));
  FG_CALL(VecScale(k, 1 / norm_k));
  FG_CALL(VecNorm(m, NORM_2, &norm_m));
  FG_CALL(VecScale(m, 1 / norm_m));
  FG_CALL(VecDot(k, m, &km));
  FG_CALL(VecDot(k, d, &kd));
  FG_CALL(VecDot(m, d, &md));
  ProportionalFit fit;
  const double determinant = 1 - km * km;
  if (!(determinant > 1e-8)) return fit; // M and K are multiples of each other
  fit.alpha = (md - km * kd) / determinant / norm_m;
  fit.beta = (kd - km * md) / determinant / norm_k;
  const double size = frobenius(D);
  if (std::abs(fit.alpha) * frobenius(M) < 1e-12 * size) fit.alpha = 0;
  if (std::abs(fit.beta) * frobenius(K) < 1e-12 * size) fit.beta = 0;
  Matrix rest = duplicate(D);
  FG_CALL(MatAXPY(rest, -fit.alpha, M, DIFFERENT_NONZERO_PATTERN));
  FG_CALL(MatAXPY(rest, -fit.beta, K, DIFFERENT_NONZERO_PATTERN));
  fit.proportional = frobenius(rest) <= tolerance * size;
  return fit;
}

int count_negative_eigenvalues(Mat a, double floor, SolverOptions options) {
  Matrix scaled = duplicate(a);
  Handle<Vec> scale;
  FG_CALL(MatCreateVecs(a, nullptr, scale.out()));
  {
    std::vector<double> d = diagonal(a);
    PetscScalar* values = nullptr;
    FG_CALL(VecGetArray(scale, &values));
    for (std::size_t i = 0; i < d.size(); ++i)
      values[i] = d[i] != 0 ? 1 / std::sqrt(std::abs(d[i])) : 1.0;
    FG_CALL(VecRestoreArray(scale, &values));
  }
  FG_CALL(MatDiagonalScale(scaled, scale, scale));
  // Not MatShift: it cannot insert a diagonal entry that a parallel matrix lacks.
  const RowRange rows = owned_rows(a);
  PetscInt n = 0;
  FG_CALL(MatGetSize(a, &n, nullptr));
  LocalRows unit;
  for (PetscInt row = rows.begin; row < rows.end; ++row) {
    unit.column.push_back(row);
    unit.value.push_back(1.0);
    unit.start.push_back(static_cast<PetscInt>(unit.column.size()));
  }
  FG_CALL(MatAXPY(
      scaled, floor,
      make_sparse(PetscObjectComm(reinterpret_cast<PetscObject>(a)), rows, n, unit),
      DIFFERENT_NONZERO_PATTERN));
  options.precision = Precision::double_precision;
  options.mumps.icntl.try_emplace(31, 1); // factors are not kept
  ShiftedSolver solver(scaled, nullptr, {}, {}, options);
  solver.count_pivots(true);
  solver.factorise({1.0, 0.0});
  return solver.negative_pivots();
}

double printed_digits_rounding(Mat a) {
  constexpr int fewest = 6, most = 15;
  std::array<double, most - fewest + 3> counts{}; // by digits; all; with more digits
  const RowRange rows = owned_rows(a);
  const PetscInt step = std::max<PetscInt>(1, rows.size() / 200);
  for (PetscInt i = rows.begin; i < rows.end; i += step) {
    PetscInt count = 0;
    const PetscScalar* values = nullptr;
    FG_CALL(MatGetRow(a, i, &count, nullptr, &values));
    for (PetscInt k = 0; k < std::min<PetscInt>(count, 10); ++k) {
      if (!(std::abs(values[k]) >= std::numeric_limits<double>::min())) continue;
      int digits = fewest;
      while (digits <= most && std::strtod(text("%.*e", digits - 1, values[k]).c_str(),
                                           nullptr) != values[k])
        ++digits;
      ++counts[as_size(digits - fewest)];
      ++counts.back();
    }
    FG_CALL(MatRestoreRow(a, i, &count, nullptr, &values));
  }
  MPI_Allreduce(MPI_IN_PLACE, counts.data(), static_cast<int>(counts.size()), MPI_DOUBLE,
                MPI_SUM, PetscObjectComm(reinterpret_cast<PetscObject>(a)));
  double within = 0;
  for (int digits = fewest; digits <= most; ++digits) {
    const double here = counts[as_size(digits - fewest)];
    within += here; // of numbers with d random digits one in ten ends in a zero
    if (digits > fewest && here > 0.5 * counts.back() && within > 0.95 * counts.back())
      return 5 * std::pow(10.0, -digits);
  }
  return 0;
}

} // namespace flexgram
