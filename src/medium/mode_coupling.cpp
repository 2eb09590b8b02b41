#include "medium/mode_coupling.hpp"

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

constexpr double little = 0.1; // 1/(1 − δ) hardly changes

/// Of P >= 0 the part outside Φ is at least LPᵀ_ZΦ + P_ZΦLᵀ − LP_ΦΦLᵀ, with any L. It is most with
/// L = P_ZΦ P_ΦΦ⁻¹.
struct Given {
  Dense value;         ///< Z × Z; empty if P_ΦΦ is not positive
  double L = 0;        ///< ‖L‖_F
  double rounding = 0; ///< of the value
};

/// What C = J A⁻¹ Jᵀ takes from the Hermitian part of S₀ − C, which is 1 without it: the
/// largest eigenvalue of the Hermitian part of C, which is Re C of a symmetric C, or ‖C‖_F, which
/// is more and cheaper. @param given  what S₀ has beyond 1, at least, of a symmetric C; empty: not
/// known.
double taken_by(const ComplexDense& C, bool is_symmetric, const Given& given = {}) {
  const double norm = frobenius_norm(C);
  if (!(norm > little) || !std::isfinite(norm)) return norm;
  if (!is_symmetric) {
    ComplexDense hermitian(C.rows, C.columns);
    for (int j = 0; j < C.columns; ++j)
      for (int i = 0; i < C.rows; ++i)
        hermitian(i, j) = 0.5 * (C(i, j) + std::conj(C(j, i)));
    const double largest = hermitian_eigenvalues(std::move(hermitian)).back();
    return std::min(norm, std::max(largest + 1e-14 * C.rows * norm, 0.0));
  }
  Dense real(C.rows, C.columns);
  for (int j = 0; j < C.columns; ++j)
    for (int i = 0; i < C.rows; ++i) {
      real(i, j) = 0.5 * (C(i, j).real() + C(j, i).real());
      if (given.value.rows > 0) real(i, j) -= given.value(i, j);
    }
  const double rounding = 1e-14 * C.rows * norm + given.rounding;
  const double largest = symmetric_eigen(std::move(real)).values.back() + rounding;
  return std::min(norm, std::max(largest, 0.0));
}

/// @param J  whose real part is P_ZΦ. @param A  A_Φ = E_Φ + P_ΦΦ + i(…). @param energies  E_Φ.
Given given_by(const ComplexDense& J, const ComplexDense& A,
               const std::vector<double>& energies) {
  const int count = J.columns;
  Dense P(count, count), beside(J.rows, count);
  double most = 0;
  for (int j = 0; j < count; ++j) {
    for (int i = 0; i < count; ++i) P(i, j) = 0.5 * (A(i, j).real() + A(j, i).real());
    P(j, j) -= energies[as_size(j)];
    most = std::max(most, P(j, j));
    for (int i = 0; i < J.rows; ++i) beside(i, j) = J(i, j).real();
  }
  Dense factor = P, L = beside;
  for (int j = 0; j < count; ++j) factor(j, j) += 1e-9 * most; // L stays of a size
  if (!(most > 0) || cholesky(factor) != 0) return {};
  solve_right_transposed(factor, L);                      // L F⁻ᵀ
  L = multiply(L, transpose(inverse_transposed(factor))); // F⁻¹
  double largest = frobenius_norm(A);                     // what P is a difference of
  for (double e : energies) largest = std::hypot(largest, e);
  Given given{multiply(L, transpose(beside)), frobenius_norm(L)};
  given.rounding = 1e-14 * (J.rows + count) * given.L *
                   (2 * frobenius_norm(beside) + given.L * largest);
  const Dense taken = multiply(multiply(L, P), transpose(L));
  Dense& value = given.value;
  for (int j = 0; j < value.columns; ++j)
    for (int i = 0; i <= j; ++i)
      value(i, j) = value(j, i) =
          value(i, j) + value(j, i) - 0.5 * (taken(i, j) + taken(j, i));
  return given;
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

ModeCoupling::ModeCoupling(const DenseResponse& response, const OutsideParts& residual,
                           int count, double sigma)
    : mu_(response.mu().begin(), response.mu().begin() + count), tau_(response.tau()),
      sigma_(sigma) {
  const int N = response.system().order(), inside = N - count, span = residual.K.rows;
  const double kappa = residual.kappa;
  const auto energy = [&](int i) { return response.energy(i, sigma_); };
  G_ = Dense(inside + span, count);
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
    rounding_T_.push_back(0);
  }
  compress();
}

/// Only products of G and F matter: a triangle of as many rows as these have columns holds them.
void ModeCoupling::compress() {
  Dense all = G_;
  for (const Dense& F : F_) all = beside(all, F);
  all = transpose(compressed(transpose(all)));
  G_ = part_of(all, 0, all.rows, 0, count());
  for (std::size_t t = 0; t < F_.size(); ++t)
    F_[t] = part_of(all, 0, all.rows, count() * (static_cast<int>(t) + 1), count());
  std::vector<const Dense*> X{&G_};
  for (const Dense& F : F_) X.push_back(&F);
  for (std::size_t a = 0; a < X.size(); ++a)
    for (std::size_t b = a; b < X.size(); ++b)
      grams_.push_back(multiply_transposed(*X[a], *X[b]));
}

ComplexDense ModeCoupling::gram(const std::vector<Complex>& x,
                                const std::vector<double>& unit) const {
  const int n = count();
  ComplexDense N(n, n);
  std::size_t next = 0;
  for (std::size_t a = 0; a < x.size(); ++a)
    for (std::size_t b = a; b < x.size(); ++b) {
      const Dense& S = grams_[next++];
      const Complex by = std::conj(x[a]) * x[b];
      if (by == 0.0) continue;
      for (int j = 0; j < n; ++j)
        for (int i = 0; i < n; ++i)
          N(i, j) += a == b ? by * S(i, j) : by * S(i, j) + std::conj(by) * S(j, i);
    }
  for (int j = 0; j < n; ++j)
    for (int i = 0; i < n; ++i) N(i, j) *= unit[as_size(i)] * unit[as_size(j)];
  return N;
}

ModeCoupling::Norms ModeCoupling::norms_of(const std::vector<Complex>& x,
                                           const std::vector<Complex>& turned,
                                           const ComplexDense& inverse,
                                           const std::vector<double>& unit) const {
  const auto inner_product = [](const ComplexDense& a, const ComplexDense& b) {
    double sum = 0;
    for (std::size_t i = 0; i < a.data.size(); ++i)
      sum += a.data[i].real() * b.data[i].real() + a.data[i].imag() * b.data[i].imag();
    return sum;
  };
  const bool same = x == turned;
  const ComplexDense N = gram(x, unit), product = multiply(N, inverse);
  ComplexDense of_turned = same ? N : gram(turned, unit);
  for (Complex& value : of_turned.data) value = std::conj(value);
  const ComplexDense other = multiply(inverse, of_turned);
  const double f = frobenius_norm(inverse), J = size(x, unit),
               J_turned = same ? J : size(turned, unit),
               epsilon = 4 * std::numeric_limits<double>::epsilon() * (G_.rows + 16);
  const auto root = [epsilon](double square, double largest) {
    return std::sqrt(std::max(square, 0.0) + epsilon * largest * largest);
  };
  return {root(inner_product(product, other), J * J_turned * f),
          root(inner_product(inverse, product), J * f),
          root(inner_product(inverse, other), J_turned * f)};
}

double ModeCoupling::size(const std::vector<Complex>& x,
                          const std::vector<double>& unit) const {
  double sum = 0;
  std::size_t own = 0; // of X with itself
  for (std::size_t a = 0; a < x.size(); own += x.size() - a, ++a) {
    double square = 0;
    for (int j = 0; j < count(); ++j)
      square += grams_[own](j, j) * unit[as_size(j)] * unit[as_size(j)];
    sum += std::abs(x[a]) * std::sqrt(square);
  }
  return sum;
}

/// What J holds inside V is LXᵀ with X = (c M + Σ g T)Y and LᵀL = E⁻¹ − Y(YᵀEY)⁻¹Yᵀ, the inverse of
/// E on what is E-orthogonal to Y.
std::optional<ModeCoupling> ModeCoupling::of(const DenseResponse& response,
                                             const OutsideParts& residual,
                                             const VectorsOfV& vectors, int modes,
                                             double sigma) {
  constexpr double singular = 1e-10;
  const Dense& Y = vectors.Y;
  const int N = Y.rows, count = Y.columns, inside = N - count, span = residual.K.rows;
  const double tau = response.tau(), kappa = residual.kappa;
  const auto energy = [&](int i) { return response.energy(i, sigma); };
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
  if (negative != modes || !(least > singular * most)) return std::nullopt;
  constexpr double epsilon = std::numeric_limits<double>::epsilon(),
                   no_rounding = 1e-6; // of the inverse below, beside 1
  for (int i = 0; i < N; ++i)
    if (!(epsilon * N <= no_rounding * std::abs(energy(i)))) return std::nullopt;
  if (!(epsilon * N * most <= no_rounding * least * least)) return std::nullopt;
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
    return residual_factor(response.mu()[as_size(j)], tau, kappa) / energy(j);
  };
  ModeCoupling result;
  result.tau_ = tau;
  result.sigma_ = sigma;
  result.G_ = fill(scaled([&](int i) { return response.mu()[as_size(i)]; }),
                   multiply(residual.K, scaled([&](int j) { return -factor(j); })));
  result.mu_ = vectors.mu;
  for (int j = 0; j < count; ++j) {
    double lost = 0;
    for (int i = 0; i < N; ++i)
      lost += std::abs(Y(i, j) * factor(i)) * residual.dropped_K[as_size(i)];
    result.dropped_G_ = std::hypot(result.dropped_G_, lost);
  }
  const double of_product = epsilon * std::sqrt(N), // relative
      size_of_L = std::sqrt(std::max(inverse.values.back(), 0.0));
  result.dropped_G_ += of_product * size_of_L * std::sqrt(count) *
                       *std::max_element(response.mu().begin(), response.mu().end());
  for (std::size_t t = 0; t < residual.terms.size(); ++t) {
    const Dense& T = response.modal_terms()[t];
    const Dense TY = multiply(T, Y);
    result.F_.push_back(fill(TY, multiply(residual.terms[t], Y)));
    result.T_.push_back(multiply_transposed(Y, TY));
    std::vector<double> lost; // of each column of U
    for (int j = 0; j < N; ++j) {
      lost.push_back(residual.dropped_terms[t][as_size(j)]);
      for (int i = 0; i < N; ++i)
        lost.back() += (1 + kappa * sigma) * residual.dropped_K[as_size(i)] *
                       std::abs(T(i, j) / energy(i));
    }
    double dropped = 0;
    for (int j = 0; j < count; ++j) {
      double of_column = 0;
      for (int i = 0; i < N; ++i) of_column += std::abs(Y(i, j)) * lost[as_size(i)];
      dropped = std::hypot(dropped, of_column);
    }
    const double size = frobenius_norm(T);
    result.dropped_F_.push_back(dropped + of_product * size_of_L * size);
    result.rounding_T_.push_back(of_product * size);
  }
  result.compress();
  return result;
}

ComplexDense ModeCoupling::A(const ShiftCoefficients& c) const {
  ComplexDense A(count(), count());
  add_terms(A, c.terms, T_);
  for (int j = 0; j < A.columns; ++j) {
    const double mu = mu_[as_size(j)];
    A(j, j) += c.k * (1 - tau_ * mu) + c.m * mu;
  }
  return A;
}

ComplexDense ModeCoupling::J(Complex c, const std::vector<Complex>& g) const {
  ComplexDense J(G_.rows, G_.columns);
  for (std::size_t i = 0; i < J.data.size(); ++i) J.data[i] = c * G_.data[i];
  add_terms(J, g, F_);
  return J;
}

/// YᵀEY.
std::vector<double> ModeCoupling::energies() const {
  std::vector<double> E;
  for (double mu : mu_) E.push_back(1 - (tau_ + sigma_) * mu);
  return E;
}

double ModeCoupling::at(const DenseSystem& system, double omega, bool with_given) const {
  const ShiftCoefficients c = system.coefficients(omega);
  const Complex outer = c.m + sigma_ * c.k;
  const ComplexDense j = J(outer, c.terms), a = A(c);
  const bool symmetric = is_symmetric(system.terms);
  try {
    const ComplexDense C = multiply(
        j, solved(a, symmetric ? j : J(outer, transposed(c.terms, system.terms)), false));
    const double taken = taken_by(C, symmetric);
    if (!with_given || !(taken > little) || !symmetric || !are_semidefinite(system.terms))
      return taken;
    return std::min(taken, taken_by(C, symmetric, given_by(j, a, energies())));
  } catch (const ShiftError&) {
    return infinity;
  }
}

/// In coordinates in which A_Φ is of size one: modes far apart in frequency, the rigid ones among
/// them, count alike. Rounding of A_Φ and J counts as if these had moved.
double ModeCoupling::over(const DenseSystem& system, Interval interval) const {
  constexpr int enough = 8;   // terms of the series of g
  if (count() == 0) return 0; // no mode is below the cutoff
  const ShiftCoefficients at_centre = system.coefficients(interval.centre());
  const Coefficients outer(system, -sigma_, interval), inner(system, tau_, interval);
  ComplexDense at = A(at_centre);
  std::vector<double> unit; // of each mode
  for (int i = 0; i < count(); ++i) {
    const double size = pivot_size(at, i);
    if (!(size > 0)) return infinity;
    unit.push_back(1 / std::sqrt(size));
  }
  const double widest = *std::max_element(unit.begin(), unit.end()),
               largest_c = std::abs(outer.c) + outer.moved_c,
               rounding = 1e-15 * std::sqrt(count());
  const auto scale = [&](auto matrix, bool rows) {
    for (int k = 0; k < matrix.columns; ++k)
      for (int i = 0; i < matrix.rows; ++i)
        matrix(i, k) *= unit[as_size(k)] * (rows ? unit[as_size(i)] : 1.0);
    return matrix;
  };
  const auto size_of = [&](std::size_t a) { // of G, or of a term's F
    std::vector<Complex> alone(T_.size() + 1);
    alone[a] = 1;
    return size(alone, unit);
  };
  double moved = 0, farthest = 0,
         moved_J = (outer.moved_c + rounding * largest_c) * size_of(0) +
                   widest * largest_c * dropped_G_;
  for (std::size_t t = 0; t < T_.size(); ++t) {
    const Law& law = system.terms[t].law;
    const double largest = law.largest(interval.last),
                 by = law.series(interval, enough).moved() + rounding * largest;
    moved += by * frobenius_norm(scale(T_[t], true)) +
             widest * widest * largest * rounding_T_[t];
    moved_J += by * size_of(t + 1) + widest * largest * dropped_F_[t];
  }
  for (std::size_t i = 0; i < mu_.size(); ++i) {
    const double own = std::abs(at_centre.k) * (1 + tau_ * mu_[i]) +
                       std::abs(at_centre.m) * mu_[i]; // sum of sizes
    farthest =
        std::max(farthest, (inner.moved_a + inner.moved_c * mu_[i] + rounding * own) *
                               unit[i] * unit[i]);
  }
  moved += farthest;
  at = scale(std::move(at), true);
  const bool symmetric = is_symmetric(system.terms);
  ComplexDense inverse(count(), count());
  for (int i = 0; i < count(); ++i) inverse(i, i) = 1;
  try {
    inverse = solve(at, std::move(inverse));
  } catch (const ShiftError&) {
    return infinity;
  }
  const double of_inverse = norm_bound(inverse), away = of_inverse * moved;
  if (!(away < 1)) return infinity;
  const std::vector<Complex> turned =
      symmetric ? at_centre.terms : transposed(at_centre.terms, system.terms);
  const auto all = [&](const std::vector<Complex>& g) {
    std::vector<Complex> x{outer.c};
    x.insert(x.end(), g.begin(), g.end());
    return x;
  };
  const Norms norms = norms_of(all(at_centre.terms), all(turned), inverse, unit);
  const double more =
      (moved * norms.left * norms.right + moved_J * (norms.left + norms.right) +
       moved_J * moved_J * of_inverse) /
      (1 - away);
  if (!(norms.C > little)) return norms.C + more;
  const ComplexDense j = scale(J(outer.c, at_centre.terms), false);
  const ComplexDense C = multiply(
      j, multiply(inverse, transpose(symmetric ? j : scale(J(outer.c, turned), false))));
  const double taken = taken_by(C, symmetric) + more;
  if (!(taken > little) || !symmetric || !are_semidefinite(system.terms)) return taken;
  std::vector<double> E = energies();
  for (std::size_t i = 0; i < E.size(); ++i) E[i] *= unit[i] * unit[i];
  const Given given = given_by(j, at, E);
  if (given.value.rows == 0) return taken;
  return std::min(taken, taken_by(C, symmetric, given) + more +
                             given.L * (2 * moved_J + given.L * moved));
}

} // namespace flexgram
