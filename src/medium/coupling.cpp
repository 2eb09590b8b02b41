#include "medium/coupling.hpp"

#include "base/index.hpp"
#include "linalg/decompositions.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

namespace flexgram {
namespace {

using Complex = std::complex<double>;
constexpr double infinity = std::numeric_limits<double>::infinity();

/// A⁻¹Jᵀ, and A⁻¹ if it is asked for.
/// @throws ShiftError if A is singular.
ComplexDense solved(ComplexDense A, const ComplexDense& J, bool with_inverse) {
  const int count = J.columns;
  ComplexDense right(count, J.rows + (with_inverse ? count : 0));
  for (int i = 0; i < count; ++i) {
    for (int j = 0; j < J.rows; ++j) right(i, j) = J(j, i);
    if (with_inverse) right(i, J.rows + i) = 1;
  }
  return solve(std::move(A), std::move(right));
}

/// What C = J A⁻¹ Jᵀ takes from the Hermitian part of S₀ − C, which is 1 without it: the
/// largest eigenvalue of Re C, the Hermitian part of a symmetric C, or ‖C‖_F, which is more
/// and cheaper.
double taken_by(const ComplexDense& C) {
  constexpr double little = 0.1; // 1/(1 − δ) hardly changes
  const double norm = frobenius_norm(C);
  if (!(norm > little) || !std::isfinite(norm)) return norm;
  Dense real(C.rows, C.columns);
  for (int j = 0; j < C.columns; ++j)
    for (int i = 0; i < C.rows; ++i) real(i, j) = 0.5 * (C(i, j).real() + C(j, i).real());
  const double rounding = 1e-14 * C.rows * norm;
  const double largest = symmetric_eigen(std::move(real)).values.back() + rounding;
  return std::min(norm, std::max(largest, 0.0));
}

} // namespace

Coefficients::Coefficients(const DenseSystem& system, double s, Interval interval) {
  const double omega = interval.centre(), h = interval.half();
  const Damping& d = system.damping;
  const ShiftCoefficients at = system.coefficients(omega);
  a = at.k;
  c = at.m - s * at.k;
  moved_a = h * d.beta;
  moved_c = h * (d.alpha + 2 * omega + h + std::abs(s) * d.beta);
}

DampingCoupling::DampingCoupling(const DenseResponse& response, const Residual& residual,
                                 int modes, double sigma, double kappa)
    : tau_(response.tau()), sigma_(sigma) {
  const int N = response.system().order();
  constexpr int steps = 8;
  double least = infinity;
  DampingCoupling best;
  bool is_first = true;
  const auto judge = [&] {
    const double largest = largest_at_some(response.system());
    if (!is_first && !(largest < 0.9 * least)) return;
    is_first = false;
    least = largest;
    best = *this;
  };
  for (int step = 0; step <= steps; ++step) {
    couple(response, residual, modes + (N - modes) * step / steps, kappa);
    judge();
  }
  constexpr double hardly_any = 0.02; // 1/(1 − δ) gains nothing
  if (least > hardly_any && modes > 0)
    for (int count : {modes, modes + (N - modes) / steps})
      if (couple(response, residual, with_coupled(response, count, sigma), modes, kappa))
        judge();
  *this = std::move(best);
  // Only products of G and F matter: a triangle of as many rows as these have columns holds them.
  Dense all = G_;
  for (const Dense& F : F_) all = beside(all, F);
  all = transpose(compressed(transpose(all)));
  G_ = part_of(all, 0, all.rows, 0, count());
  for (std::size_t t = 0; t < F_.size(); ++t)
    F_[t] = part_of(all, 0, all.rows, count() * (static_cast<int>(t) + 1), count());
}

double DampingCoupling::largest_at_some(const DenseSystem& system) const {
  double largest = 0;
  for (double part : {0.2, 0.5, 0.8})
    largest = std::max(largest, at(system, part * std::sqrt(sigma_)));
  return largest;
}

/// The first columns of U and, for each term, E⁻¹T of them as far as V holds it.
DampingCoupling::Vectors DampingCoupling::with_coupled(const DenseResponse& response,
                                                       int count, double sigma) {
  constexpr double nothing_new = 1e-8;
  const int N = response.system().order();
  Dense all = first_columns(identity(N), count);
  for (const Dense& T : response.modal_terms()) {
    Dense coupled = first_columns(T, count);
    for (int j = 0; j < count; ++j) {
      double size = 0;
      for (int i = 0; i < N; ++i) {
        coupled(i, j) /= response.energy(i, sigma);
        size = std::hypot(size, coupled(i, j));
      }
      for (int i = 0; i < N && size > 0; ++i) coupled(i, j) /= size;
    }
    all = beside(all, coupled);
  }
  const LeftSvd svd = left_svd(compressed(all));
  int rank = 0;
  while (rank < static_cast<int>(svd.values.size()) &&
         svd.values[as_size(rank)] > nothing_new * svd.values.front())
    ++rank;
  const Dense Q = first_columns(svd.vectors, rank);
  Dense moved = Q;
  for (int j = 0; j < rank; ++j)
    for (int i = 0; i < N; ++i) moved(i, j) *= response.mu()[as_size(i)];
  Dense mass = multiply_transposed(Q, moved);
  symmetrise(mass);
  SymmetricEigen eigen = symmetric_eigen(std::move(mass));
  return {multiply(Q, eigen.vectors), std::move(eigen.values)};
}

/// The fields for the first `count` columns of U.
void DampingCoupling::couple(const DenseResponse& response, const Residual& residual,
                             int count, double kappa) {
  const int N = response.system().order(), inside = N - count, span = residual.K.rows;
  const auto energy = [&](int i) { return response.energy(i, sigma_); };
  G_ = Dense(inside + span, count);
  F_.clear();
  T_.clear();
  mu_.assign(response.mu().begin(), response.mu().begin() + count);
  dropped_G_ = 0;
  dropped_F_.clear();
  for (int j = 0; j < count; ++j) {
    const auto at = as_size(j);
    const double factor = residual_factor(mu_[at], tau_, kappa) / energy(j);
    for (int i = 0; i < span; ++i) G_(inside + i, j) = -factor * residual.K(i, j);
    dropped_G_ = std::hypot(dropped_G_, factor * residual.dropped_K[at]);
  }
  for (std::size_t t = 0; t < residual.terms.size(); ++t) {
    const Dense& T = response.modal_terms()[t];
    Dense F(inside + span, count);
    double dropped = 0;
    for (int j = 0; j < count; ++j) {
      for (int i = 0; i < inside; ++i)
        F(i, j) = T(count + i, j) / std::sqrt(energy(count + i));
      for (int i = 0; i < span; ++i) F(inside + i, j) = residual.terms[t](i, j);
      double lost = residual.dropped_terms[t][as_size(j)];
      for (int i = 0; i < N; ++i)
        lost += (1 + kappa * sigma_) * residual.dropped_K[as_size(i)] *
                std::abs(T(i, j) / energy(i));
      dropped = std::hypot(dropped, lost);
    }
    F_.push_back(std::move(F));
    T_.push_back(part_of(T, 0, count, 0, count));
    dropped_F_.push_back(dropped);
  }
}

/// The fields for these vectors Y. What J holds inside V is LXᵀ with X = (c M + Σ g T)Y and
/// LᵀL = E⁻¹ − Y(YᵀEY)⁻¹Yᵀ, the inverse of E on what is E-orthogonal to Y.
/// @return false if E has other numbers of negative eigenvalues on them.
bool DampingCoupling::couple(const DenseResponse& response, const Residual& residual,
                             const Vectors& vectors, int modes, double kappa) {
  constexpr double singular = 1e-10;
  const Dense& Y = vectors.Y;
  const int N = Y.rows, count = Y.columns, inside = N - count, span = residual.K.rows;
  const auto energy = [&](int i) { return response.energy(i, sigma_); };
  const auto scaled = [&](const auto& factor) {
    Dense result = Y;
    for (int j = 0; j < count; ++j)
      for (int i = 0; i < N; ++i) result(i, j) *= factor(i);
    return result;
  };
  Dense of_Y = multiply_transposed(Y, scaled(energy));
  symmetrise(of_Y);
  const SymmetricEigen E = symmetric_eigen(std::move(of_Y));
  int negative = 0;
  double least = infinity, most = 0;
  for (double e : E.values) {
    negative += e < 0;
    least = std::min(least, std::abs(e));
    most = std::max(most, std::abs(e));
  }
  if (negative != modes || !(least > singular * most)) return false;
  constexpr double no_rounding = 1e-6; // of the inverse below, beside 1
  for (int i = 0; i < N; ++i)
    if (!(std::numeric_limits<double>::epsilon() * N <=
          no_rounding * std::abs(energy(i))))
      return false;
  Dense turned = multiply(Y, E.vectors), weighted = turned;
  for (int j = 0; j < count; ++j)
    for (int i = 0; i < N; ++i) weighted(i, j) /= E.values[as_size(j)];
  Dense rest = multiply(weighted, transpose(turned));
  for (double& x : rest.data) x = -x;
  for (int i = 0; i < N; ++i) rest(i, i) += 1 / energy(i);
  symmetrise(rest);
  const SymmetricEigen inverse = symmetric_eigen(std::move(rest));
  Dense L(inside, N); // the others are rounding
  for (int i = 0; i < inside; ++i)
    for (int j = 0; j < N; ++j)
      L(i, j) = std::sqrt(std::max(inverse.values[as_size(count + i)], 0.0)) *
                inverse.vectors(j, count + i);
  const auto fill = [&](const Dense& X, const Dense& outside) {
    Dense all(inside + span, count);
    set_part(all, 0, 0, multiply(L, X));
    if (span > 0) set_part(all, inside, 0, outside);
    return all;
  };
  const auto factor = [&](int j) {
    return residual_factor(response.mu()[as_size(j)], tau_, kappa) / energy(j);
  };
  G_ = fill(scaled([&](int i) { return response.mu()[as_size(i)]; }),
            multiply(residual.K, scaled([&](int j) { return -factor(j); })));
  mu_ = vectors.mu;
  dropped_G_ = 0;
  for (int j = 0; j < count; ++j) {
    double lost = 0;
    for (int i = 0; i < N; ++i)
      lost += std::abs(Y(i, j) * factor(i)) * residual.dropped_K[as_size(i)];
    dropped_G_ = std::hypot(dropped_G_, lost);
  }
  F_.clear();
  T_.clear();
  dropped_F_.clear();
  for (std::size_t t = 0; t < residual.terms.size(); ++t) {
    const Dense& T = response.modal_terms()[t];
    const Dense TY = multiply(T, Y);
    F_.push_back(fill(TY, multiply(residual.terms[t], Y)));
    T_.push_back(multiply_transposed(Y, TY));
    std::vector<double> lost; // of each column of U
    for (int j = 0; j < N; ++j) {
      lost.push_back(residual.dropped_terms[t][as_size(j)]);
      for (int i = 0; i < N; ++i)
        lost.back() += (1 + kappa * sigma_) * residual.dropped_K[as_size(i)] *
                       std::abs(T(i, j) / energy(i));
    }
    double dropped = 0;
    for (int j = 0; j < count; ++j) {
      double of_column = 0;
      for (int i = 0; i < N; ++i) of_column += std::abs(Y(i, j)) * lost[as_size(i)];
      dropped = std::hypot(dropped, of_column);
    }
    dropped_F_.push_back(dropped);
  }
  return true;
}

ComplexDense DampingCoupling::A(const ShiftCoefficients& c) const {
  ComplexDense A(count(), count());
  add_terms(A, c.terms, T_);
  for (int j = 0; j < A.columns; ++j) {
    const double mu = mu_[as_size(j)];
    A(j, j) += c.k * (1 - tau_ * mu) + c.m * mu;
  }
  return A;
}

ComplexDense DampingCoupling::J(Complex c, const std::vector<Complex>& g) const {
  ComplexDense J(G_.rows, G_.columns);
  for (std::size_t i = 0; i < J.data.size(); ++i) J.data[i] = c * G_.data[i];
  add_terms(J, g, F_);
  return J;
}

/// δ at a frequency, without what was dropped.
double DampingCoupling::at(const DenseSystem& system, double omega) const {
  const ShiftCoefficients c = system.coefficients(omega);
  const ComplexDense j = J(c.m + sigma_ * c.k, c.terms);
  try {
    return taken_by(multiply(j, solved(A(c), j, false)));
  } catch (const ShiftError&) {
    return infinity;
  }
}

/// In coordinates in which the diagonal of A_Φ is of size one: modes far apart in frequency, the
/// rigid ones among them, count alike.
double DampingCoupling::over(const DenseSystem& system, Interval interval) const {
  constexpr int enough = 8;   // terms of the series of g
  if (count() == 0) return 0; // no mode is below the cutoff
  const ShiftCoefficients at_centre = system.coefficients(interval.centre());
  const Coefficients outer(system, -sigma_, interval), inner(system, tau_, interval);
  ComplexDense at = A(at_centre), j = J(outer.c, at_centre.terms);
  std::vector<double> unit; // of each mode
  for (int i = 0; i < count(); ++i) {
    const double size = std::sqrt(std::abs(at(i, i)));
    if (!(size > 0)) return infinity;
    unit.push_back(1 / size);
  }
  const auto scale = [&](auto matrix, bool rows) {
    for (int k = 0; k < matrix.columns; ++k)
      for (int i = 0; i < matrix.rows; ++i)
        matrix(i, k) *= unit[as_size(k)] * (rows ? unit[as_size(i)] : 1.0);
    return matrix;
  };
  double moved = 0, farthest = 0, moved_F = 0, outside_F = 0; // of A_Φ, of J
  for (std::size_t t = 0; t < T_.size(); ++t) {
    const Law& law = system.terms[t].law;
    const double by = law.series(interval, enough).moved();
    if (by != 0) {
      moved += by * frobenius_norm(scale(T_[t], true));
      moved_F += by * frobenius_norm(scale(F_[t], false));
    }
    outside_F += law.largest(interval.last) * dropped_F_[t];
  }
  for (std::size_t i = 0; i < mu_.size(); ++i)
    farthest =
        std::max(farthest, (inner.moved_a + inner.moved_c * mu_[i]) * unit[i] * unit[i]);
  moved += farthest;
  j = scale(std::move(j), false);
  ComplexDense Y;
  try {
    Y = solved(scale(std::move(at), true), j, true);
  } catch (const ShiftError&) {
    return infinity;
  }
  const auto columns = as_size(j.rows);
  ComplexDense product(count(), j.rows), inverse(count(), count());
  const auto split = static_cast<std::ptrdiff_t>(columns * as_size(count()));
  std::copy(Y.data.begin(), Y.data.begin() + split, product.data.begin());
  std::copy(Y.data.begin() + split, Y.data.end(), inverse.data.begin());
  const double size = norm_bound(inverse), away = size * moved;
  if (!(away < 1)) return infinity;
  const double largest_c = std::abs(outer.c) + outer.moved_c,
               widest = *std::max_element(unit.begin(), unit.end());
  const double y = frobenius_norm(product), farther = 1 / (1 - away),
               moved_J = outer.moved_c * frobenius_norm(scale(G_, false)) + moved_F +
                         widest * (largest_c * dropped_G_ + outside_F);
  return taken_by(multiply(j, product)) +
         farther * (moved * y * y + 2 * moved_J * y + moved_J * moved_J * size);
}

bool DampingCoupling::fits(std::size_t terms) const {
  const auto is = [](const Dense& a, int rows, int columns) {
    return a.rows == rows && a.columns == columns;
  };
  bool fit = G_.columns == count() && T_.size() == terms && F_.size() == terms &&
             dropped_F_.size() == terms;
  for (const Dense& F : F_) fit = fit && is(F, G_.rows, count());
  for (const Dense& T : T_) fit = fit && is(T, count(), count());
  return fit;
}

} // namespace flexgram
