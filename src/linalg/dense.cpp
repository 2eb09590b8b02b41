#include "linalg/dense.hpp"

#include "base/handle.hpp"
#include "base/index.hpp"
#include "base/text.hpp"

#include <petscblaslapack.h>

#include <algorithm>
#include <cmath>
#include <stdexcept>

extern "C" {
void zgesv_(const int* n, const int* nrhs, std::complex<double>* a, const int* lda,
            int* ipiv, std::complex<double>* b, const int* ldb, int* info);
void zgemm_(const char* op_a, const char* op_b, const int* m, const int* n, const int* k,
            const std::complex<double>* alpha, const std::complex<double>* a,
            const int* lda, const std::complex<double>* b, const int* ldb,
            const std::complex<double>* beta, std::complex<double>* c, const int* ldc);
void dgeqrt_(const int* m, const int* n, const int* block, double* a, const int* lda,
             double* t, const int* ldt, double* work, int* info);
void dorgqr_(const int* m, const int* n, const int* k, double* a, const int* lda,
             const double* tau, double* work, const int* lwork, int* info);
void zheev_(const char* job, const char* uplo, const int* n, std::complex<double>* a,
            const int* lda, double* w, std::complex<double>* work, const int* lwork,
            double* rwork, int* info);
void dgeev_(const char* left, const char* right, const int* n, double* a, const int* lda,
            double* re, double* im, double* vl, const int* ldvl, double* vr,
            const int* ldvr, double* work, const int* lwork, int* info);
void dsyevd_(const char* job, const char* uplo, const int* n, double* a, const int* lda,
             double* w, double* work, const int* lwork, int* iwork, const int* liwork,
             int* info);
void dsygvd_(const int* type, const char* job, const char* uplo, const int* n, double* a,
             const int* lda, double* b, const int* ldb, double* w, double* work,
             const int* lwork, int* iwork, const int* liwork, int* info);
}

namespace flexgram {
namespace {

Dense gemm(const char* op_a, const char* op_b, const Dense& a, const Dense& b) {
  const bool ta = *op_a == 'T', tb = *op_b == 'T';
  Dense c(ta ? a.columns : a.rows, tb ? b.rows : b.columns);
  if (c.data.empty()) return c;
  const PetscBLASInt m = c.rows, n = c.columns, k = ta ? a.rows : a.columns;
  const PetscBLASInt lda = std::max(a.rows, 1), ldb = std::max(b.rows, 1), ldc = c.rows;
  const double one = 1, zero = 0;
  BLASgemm_(op_a, op_b, &m, &n, &k, &one, a.data.data(), &lda, b.data.data(), &ldb, &zero,
            c.data.data(), &ldc);
  return c;
}

} // namespace

Dense identity(int order) {
  Dense result(order, order);
  for (int i = 0; i < order; ++i) result(i, i) = 1;
  return result;
}

Dense transpose(const Dense& a) {
  Dense t(a.columns, a.rows);
  for (int j = 0; j < a.columns; ++j)
    for (int i = 0; i < a.rows; ++i) t(j, i) = a(i, j);
  return t;
}

Dense multiply(const Dense& a, const Dense& b) { return gemm("N", "N", a, b); }
Dense multiply_transposed(const Dense& a, const Dense& b) { return gemm("T", "N", a, b); }

Dense part_of(const Dense& a, int r0, int rows, int c0, int columns) {
  Dense part(rows, columns);
  for (int j = 0; j < columns; ++j)
    std::copy_n(a.column(c0 + j) + r0, rows, part.column(j));
  return part;
}

void set_part(Dense& a, int r0, int c0, const Dense& part) {
  for (int j = 0; j < part.columns; ++j)
    std::copy_n(part.column(j), part.rows, a.column(c0 + j) + r0);
}

Dense beside(const Dense& a, const Dense& b) {
  if (a.columns == 0) return b;
  if (b.columns == 0) return a;
  Dense both(a.rows, a.columns + b.columns);
  set_part(both, 0, 0, a);
  set_part(both, 0, a.columns, b);
  return both;
}

Dense first_columns(const Dense& a, int count) {
  if (count > a.columns) throw std::logic_error("first_columns: more than there are");
  Dense result(a.rows, count);
  std::copy_n(a.data.begin(), result.data.size(), result.data.begin());
  return result;
}

namespace {

template <class T>
DenseOf<T> chosen(const DenseOf<T>& a, const std::vector<int>& columns) {
  DenseOf<T> part(a.rows, static_cast<int>(columns.size()));
  for (int j = 0; j < part.columns; ++j)
    std::copy_n(a.column(columns[as_size(j)]), a.rows, part.column(j));
  return part;
}

} // namespace

Dense columns_of(const Dense& a, const std::vector<int>& columns) {
  return chosen(a, columns);
}

ComplexDense columns_of(const ComplexDense& a, const std::vector<int>& columns) {
  return chosen(a, columns);
}

Dense columns_of(const Dense& a, const std::vector<int>& columns,
                 const std::vector<double>& divisors) {
  Dense part = chosen(a, columns);
  for (int j = 0; j < part.columns; ++j)
    for (int i = 0; i < part.rows; ++i)
      part(i, j) /= divisors[as_size(columns[as_size(j)])];
  return part;
}

Dense absolute(Dense a) {
  for (double& x : a.data) x = std::abs(x);
  return a;
}

void add_to(Dense& a, const Dense& b, double factor) {
  for (std::size_t i = 0; i < a.data.size(); ++i) a.data[i] += factor * b.data[i];
}

double frobenius_norm(const Dense& a) {
  double sum = 0;
  for (double x : a.data) sum += x * x;
  return std::sqrt(sum);
}

double frobenius_norm(const ComplexDense& a) {
  double sum = 0;
  for (const auto& x : a.data) sum += std::norm(x);
  return std::sqrt(sum);
}

void symmetrise(Dense& a) {
  for (int j = 0; j < a.columns; ++j)
    for (int i = 0; i < j; ++i) a(i, j) = a(j, i) = 0.5 * (a(i, j) + a(j, i));
}

SymmetricEigen symmetric_eigen(Dense a) {
  SymmetricEigen result;
  const int n = a.rows;
  result.values.resize(as_size(n));
  if (n == 0) return result;
  int lwork = -1, liwork = -1, iwork_size = 0, info = 0;
  double work_size = 0;
  dsyevd_("V", "L", &n, a.data.data(), &n, result.values.data(), &work_size, &lwork,
          &iwork_size, &liwork, &info);
  lwork = static_cast<int>(work_size);
  liwork = iwork_size;
  std::vector<double> work(as_size(lwork));
  std::vector<int> iwork(as_size(liwork));
  dsyevd_("V", "L", &n, a.data.data(), &n, result.values.data(), work.data(), &lwork,
          iwork.data(), &liwork, &info);
  if (info) throw Error(text("LAPACK dsyevd returned %d", info));
  result.vectors = std::move(a);
  return result;
}

GramFactor gram_factor(const Dense& a) {
  const SymmetricEigen eigen = symmetric_eigen(a);
  GramFactor factor{transpose(eigen.vectors), eigen.vectors, {}, 0};
  const int k = a.rows;
  if (k > 0) factor.added = 1e-15 * k * std::max(eigen.values.back(), 0.0);
  for (int i = 0; i < k; ++i) {
    const double value = eigen.values[as_size(i)],
                 root = std::sqrt(std::max(value, 0.0) + std::max(factor.added, 1e-300));
    factor.roots.push_back(root);
    for (int j = 0; j < k; ++j) {
      factor.F(i, j) *= root;
      factor.inverse(j, i) /= root;
    }
  }
  return factor;
}

SymmetricEigen symmetric_eigen(Dense a, Dense b) {
  SymmetricEigen result;
  const int n = a.rows, type = 1;
  result.values.resize(as_size(n));
  if (n == 0) return result;
  int lwork = -1, liwork = -1, iwork_size = 0, info = 0;
  double work_size = 0;
  dsygvd_(&type, "V", "L", &n, a.data.data(), &n, b.data.data(), &n, result.values.data(),
          &work_size, &lwork, &iwork_size, &liwork, &info);
  lwork = static_cast<int>(work_size);
  liwork = iwork_size;
  std::vector<double> work(as_size(lwork));
  std::vector<int> iwork(as_size(liwork));
  dsygvd_(&type, "V", "L", &n, a.data.data(), &n, b.data.data(), &n, result.values.data(),
          work.data(), &lwork, iwork.data(), &liwork, &info);
  if (info > n) throw Error("generalised eigenproblem: B is not positive definite");
  if (info) throw Error(text("LAPACK dsygvd returned %d", info));
  result.vectors = std::move(a);
  return result;
}

Dense orthonormal_columns(Dense a) {
  if (a.data.empty()) return a;
  const int lwork = 64 * a.columns;
  std::vector<double> tau(as_size(a.columns)), work(as_size(lwork));
  int info = 0;
  dgeqrf_(&a.rows, &a.columns, a.data.data(), &a.rows, tau.data(), work.data(), &lwork,
          &info);
  if (info == 0)
    dorgqr_(&a.rows, &a.columns, &a.columns, a.data.data(), &a.rows, tau.data(),
            work.data(), &lwork, &info);
  if (info) throw Error(text("LAPACK QR returned %d", info));
  return a;
}

Dense compressed(const Dense& a) {
  if (a.columns <= a.rows) return a;
  Dense t = transpose(a);
  // Blocked whatever the size: LAPACK's geqrf goes column by column below 128 columns.
  const int block = std::clamp(t.columns, 1, 32);
  std::vector<double> factors(as_size(block) * as_size(t.columns)), work(factors.size());
  int info = 0;
  dgeqrt_(&t.rows, &t.columns, &block, t.data.data(), &t.rows, factors.data(), &block,
          work.data(), &info);
  if (info) throw Error(text("LAPACK QR returned %d", info));
  Dense l(a.rows, a.rows);
  for (int j = 0; j < a.rows; ++j)
    for (int i = 0; i <= j; ++i) l(j, i) = t(i, j);
  return l;
}

int cholesky(Dense& a) {
  if (a.rows == 0) return 0;
  const PetscBLASInt n = a.rows;
  PetscBLASInt info = 0;
  LAPACKpotrf_("L", &n, a.data.data(), &n, &info);
  for (int j = 0; j < a.columns; ++j)
    for (int i = 0; i < j; ++i) a(i, j) = 0;
  return info;
}

void solve_right_transposed(const Dense& l, Dense& x) {
  if (x.data.empty()) return;
  const PetscBLASInt m = x.rows, n = x.columns;
  const double one = 1;
  BLAStrsm_("R", "L", "T", "N", &m, &n, &one, l.data.data(), &n, x.data.data(), &m);
}

Dense inverse_transposed(const Dense& l) {
  Dense inverse = identity(l.rows);
  solve_right_transposed(l, inverse);
  return inverse;
}

LeftSvd left_svd(const Dense& a) {
  const int rank = std::min(a.rows, a.columns);
  LeftSvd result{std::vector<double>(as_size(rank)), Dense(a.rows, rank)};
  if (rank == 0) return result;
  Matrix matrix, left_vector_source;
  FG_CALL(MatCreateSeqDense(PETSC_COMM_SELF, a.rows, a.columns,
                            const_cast<double*>(a.data.data()), matrix.out()));
  Handle<SVD> svd;
  FG_CALL(SVDCreate(PETSC_COMM_SELF, svd.out()));
  FG_CALL(SVDSetOperators(svd, matrix, nullptr));
  FG_CALL(SVDSetType(svd, SVDLAPACK));
  FG_CALL(SVDSetDimensions(svd, rank, PETSC_DEFAULT, PETSC_DEFAULT));
  FG_CALL(SVDSolve(svd));
  PetscInt converged = 0;
  FG_CALL(SVDGetConverged(svd, &converged));
  if (converged < rank)
    throw Error(text("singular value decomposition: %d of %d values converged",
                     static_cast<int>(converged), rank));
  for (int j = 0; j < rank; ++j) {
    Handle<Vec> u;
    FG_CALL(VecCreateSeqWithArray(PETSC_COMM_SELF, 1, a.rows, result.vectors.column(j),
                                  u.out()));
    FG_CALL(SVDGetSingularTriplet(svd, j, &result.values[as_size(j)], u, nullptr));
  }
  return result;
}

std::vector<double> hermitian_eigenvalues(ComplexDense a) {
  const int n = a.rows, lwork = std::max(1, 32 * n);
  std::vector<double> values(as_size(n)), rwork(as_size(std::max(1, 3 * n)));
  if (n == 0) return values;
  std::vector<std::complex<double>> work(as_size(lwork));
  int info = 0;
  zheev_("N", "L", &n, a.data.data(), &n, values.data(), work.data(), &lwork,
         rwork.data(), &info);
  if (info) throw Error(text("LAPACK zheev returned %d", info));
  return values;
}

namespace {

ComplexDense as_complex(const Dense& re, const Dense& im) {
  ComplexDense c(re.rows, re.columns);
  for (std::size_t i = 0; i < c.data.size(); ++i) c.data[i] = {re.data[i], im.data[i]};
  return c;
}

/// Real and imaginary parts apart: two real products are cheaper than a complex one.
ComplexDense real_times_complex(const char* op, const Dense& a, const ComplexDense& b) {
  Dense re(b.rows, b.columns), im(b.rows, b.columns);
  for (std::size_t i = 0; i < b.data.size(); ++i) {
    re.data[i] = b.data[i].real();
    im.data[i] = b.data[i].imag();
  }
  return as_complex(gemm(op, "N", a, re), gemm(op, "N", a, im));
}

} // namespace

ComplexDense multiply(const Dense& a, const ComplexDense& b) {
  return real_times_complex("N", a, b);
}
ComplexDense multiply_transposed(const Dense& a, const ComplexDense& b) {
  return real_times_complex("T", a, b);
}

namespace {
ComplexDense zgemm(const char* op, const ComplexDense& a, const ComplexDense& b) {
  const bool as_is = *op == 'N';
  ComplexDense c(as_is ? a.rows : a.columns, b.columns);
  if (c.data.empty() || a.data.empty()) return c;
  const int m = c.rows, k = as_is ? a.columns : a.rows;
  const std::complex<double> one = 1, zero = 0;
  zgemm_(op, "N", &m, &b.columns, &k, &one, a.data.data(), &a.rows, b.data.data(),
         &b.rows, &zero, c.data.data(), &c.rows);
  return c;
}
} // namespace

ComplexDense multiply(const ComplexDense& a, const ComplexDense& b) {
  return zgemm("N", a, b);
}
ComplexDense multiply_transposed(const ComplexDense& a, const ComplexDense& b,
                                 bool conjugate) {
  return zgemm(conjugate ? "C" : "T", a, b);
}

std::vector<std::complex<double>> general_eigenvalues(Dense a) {
  const int n = a.rows, one = 1, lwork = std::max(1, 32 * n);
  std::vector<double> re(as_size(n)), im(re), work(as_size(lwork));
  std::vector<std::complex<double>> values;
  if (n == 0) return values;
  int info = 0;
  dgeev_("N", "N", &n, a.data.data(), &n, re.data(), im.data(), nullptr, &one, nullptr,
         &one, work.data(), &lwork, &info);
  if (info) throw Error(text("LAPACK dgeev returned %d", info));
  for (std::size_t i = 0; i < re.size(); ++i) values.emplace_back(re[i], im[i]);
  return values;
}

ComplexDense solve(ComplexDense a, ComplexDense b) {
  const int n = a.rows, nrhs = b.columns;
  if (n == 0 || nrhs == 0) return b;
  std::vector<int> pivots(as_size(n));
  int info = 0;
  zgesv_(&n, &nrhs, a.data.data(), &n, pivots.data(), b.data.data(), &n, &info);
  if (info > 0) throw ShiftError("the reduced matrix K + iωD − ω²M is singular");
  return b;
}

} // namespace flexgram
