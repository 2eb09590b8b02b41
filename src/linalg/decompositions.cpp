#include "linalg/decompositions.hpp"

#include "base/handle.hpp"
#include "base/index.hpp"
#include "base/text.hpp"

#include <petscblaslapack.h>

#include <algorithm>
#include <cmath>

extern "C" {
void zgesv_(const int* n, const int* nrhs, std::complex<double>* a, const int* lda,
            int* ipiv, std::complex<double>* b, const int* ldb, int* info);
void dgeqrt_(const int* m, const int* n, const int* block, double* a, const int* lda,
             double* t, const int* ldt, double* work, int* info);
void dorgqr_(const int* m, const int* n, const int* k, double* a, const int* lda,
             const double* tau, double* work, const int* lwork, int* info);
void zpotrf_(const char* uplo, const int* n, std::complex<double>* a, const int* lda,
             int* info);
void zheev_(const char* job, const char* uplo, const int* n, std::complex<double>* a,
            const int* lda, double* w, std::complex<double>* work, const int* lwork,
            double* rwork, int* info);
void dgeev_(const char* left, const char* right, const int* n, double* a, const int* lda,
            double* re, double* im, double* vl, const int* ldvl, double* vr,
            const int* ldvr, double* work, const int* lwork, int* info);
void zgeev_(const char* left, const char* right, const int* n, std::complex<double>* a,
            const int* lda, std::complex<double>* w, std::complex<double>* vl,
            const int* ldvl, std::complex<double>* vr, const int* ldvr,
            std::complex<double>* work, const int* lwork, double* rwork, int* info);
void dsyevd_(const char* job, const char* uplo, const int* n, double* a, const int* lda,
             double* w, double* work, const int* lwork, int* iwork, const int* liwork,
             int* info);
void dsygvd_(const int* type, const char* job, const char* uplo, const int* n, double* a,
             const int* lda, double* b, const int* ldb, double* w, double* work,
             const int* lwork, int* iwork, const int* liwork, int* info);
}

namespace flexgram {

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
  if (info > n)
    throw IndefiniteError("generalised eigenproblem: B is not positive definite");
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

bool is_positive_definite(ComplexDense a) {
  int info = 0;
  if (a.rows > 0) zpotrf_("L", &a.rows, a.data.data(), &a.rows, &info);
  if (info < 0) throw Error(text("LAPACK zpotrf returned %d", info));
  return info == 0;
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

ComplexEigen complex_eigen(ComplexDense a) {
  const int n = a.rows, one = 1, lwork = std::max(1, 33 * n);
  ComplexEigen result{std::vector<std::complex<double>>(as_size(n)), ComplexDense(n, n)};
  if (n == 0) return result;
  std::vector<std::complex<double>> work(as_size(lwork));
  std::vector<double> real_work(as_size(2 * n));
  int info = 0;
  zgeev_("N", "V", &n, a.data.data(), &n, result.values.data(), nullptr, &one,
         result.vectors.data.data(), &n, work.data(), &lwork, real_work.data(), &info);
  if (info) throw Error(text("LAPACK zgeev returned %d", info));
  return result;
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
