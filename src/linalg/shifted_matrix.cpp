#include "linalg/shifted_matrix.hpp"

#include "base/index.hpp"
#include "base/text.hpp"
#include "linalg/sparse_product.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

namespace flexgram {

namespace {

double infinity_norm(Mat a) {
  PetscReal norm = 0;
  if (a) FG_CALL(MatNorm(a, NORM_INFINITY, &norm));
  return norm;
}

} // namespace

ShiftedMatrix::ShiftedMatrix(Mat stiffness, Mat mass, std::vector<Mat> of_terms)
    : comm(PetscObjectComm(reinterpret_cast<PetscObject>(stiffness))), K(stiffness),
      M(mass), terms(std::move(of_terms)), norm_K_(infinity_norm(K)),
      norm_M_(infinity_norm(M)) {
  for (Mat term : terms) norms_of_terms_.push_back(infinity_norm(term));
  FG_CALL(MatGetOwnershipRange(K, &rows.begin, &rows.end));
}

double ShiftedMatrix::norm() const {
  double norm = std::abs(coefficients.k) * norm_K_ + std::abs(coefficients.m) * norm_M_;
  for (std::size_t t = 0; t < coefficients.terms.size(); ++t)
    norm += std::abs(coefficients.terms[t]) * norms_of_terms_[t];
  return norm;
}

double ShiftedMatrix::residual(const Block& b, const Block& x, Block& r) const {
  const PetscInt p = b.columns(), local = rows.size();
  const bool real = coefficients.real();
  r = Block(comm, rows, x.rows(), x.columns());
  Block::Access out(r);
  {
    const Block::Access in(b);
    std::copy_n(in.column(0), local * p, out.column(0));
    if (!real) std::fill_n(out.column(p), local * p, 0.0);
  }
  const auto subtract = [&](Mat matrix, std::complex<double> c) {
    if (!matrix || c == 0.0) return;
    const Block product = multiply(matrix, x);
    const Block::Access y(product);
    for (PetscInt j = 0; j < p; ++j) {
      const double* re = y.column(j);
      const double* im = real ? nullptr : y.column(p + j);
      double* r_re = out.column(j);
      double* r_im = real ? nullptr : out.column(p + j);
      for (PetscInt i = 0; i < local; ++i) {
        r_re[i] -= c.real() * re[i] - (real ? 0.0 : c.imag() * im[i]);
        if (!real) r_im[i] -= c.real() * im[i] + c.imag() * re[i];
      }
    }
  };
  subtract(K, coefficients.k);
  subtract(M, coefficients.m);
  for (std::size_t t = 0; t < coefficients.terms.size(); ++t)
    subtract(terms[t], coefficients.terms[t]);

  const double norm_A = norm();
  const auto r_max = column_maxima(r), x_max = column_maxima(x), b_max = column_maxima(b);
  double worst = 0;
  for (std::size_t j = 0; j < b_max.size(); ++j) {
    const auto both = [&](const std::vector<double>& maxima) {
      return real ? maxima[j] : std::hypot(maxima[j], maxima[j + b_max.size()]);
    };
    const double scale = norm_A * both(x_max) + b_max[j];
    const double error = scale > 0 ? both(r_max) / scale : 0.0;
    worst = std::isfinite(error) ? std::max(worst, error)
                                 : std::numeric_limits<double>::infinity();
  }
  return worst;
}

void ShiftedMatrix::require_regular(const Block& b, const Block& x) const {
  const auto p = as_size(b.columns());
  std::vector<double> sums(4 * p, 0.0); // Re xᴴb, Im xᴴb, xᴴx, bᴴb by column
  {
    const Block::Access rhs(b), solution(x);
    for (std::size_t j = 0; j < p; ++j)
      for (std::size_t part = 0; part < as_size(x.columns()) / p; ++part) {
        const double* b_j = rhs.column(static_cast<PetscInt>(j));
        const double* x_j = solution.column(static_cast<PetscInt>(j + part * p));
        for (PetscInt i = 0; i < rows.size(); ++i) {
          sums[4 * j + part] += x_j[i] * b_j[i];
          sums[4 * j + 2] += x_j[i] * x_j[i];
          if (part == 0) sums[4 * j + 3] += b_j[i] * b_j[i];
        }
      }
  }
  MPI_Allreduce(MPI_IN_PLACE, sums.data(), static_cast<int>(sums.size()), MPI_DOUBLE,
                MPI_SUM, comm);
  const double rounding = std::numeric_limits<double>::epsilon() * norm();
  for (std::size_t j = 0; j < p; ++j) {
    if (sums[4 * j + 2] == 0) continue;
    const double quotient = std::hypot(sums[4 * j], sums[4 * j + 1]) / sums[4 * j + 2];
    // xᴴb vanishes at an antiresonance of a drive point, too; ‖b‖/‖x‖ bounds σ_min from
    // above.
    const double bound = std::sqrt(sums[4 * j + 3] / sums[4 * j + 2]);
    const double root_n = std::sqrt(static_cast<double>(x.rows()));
    if (!(quotient > rounding) && !(bound > root_n * rounding))
      throw ShiftError(
          text("the shifted matrix is singular to working accuracy (an eigenvalue "
               "near %.1e beside a norm of %.1e): the frequency is a resonance of "
               "an undamped body, or too close to zero for a free one",
               quotient, norm()));
  }
}

} // namespace flexgram
