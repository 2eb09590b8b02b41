#include "model/pencil_modes.hpp"

#include "linalg/decompositions.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

namespace flexgram {
namespace {

using Complex = std::complex<double>;
constexpr double epsilon = std::numeric_limits<double>::epsilon();

Dense absolute_of(const ComplexDense& a) {
  Dense sizes(a.rows, a.columns);
  for (std::size_t i = 0; i < a.data.size(); ++i) sizes.data[i] = std::abs(a.data[i]);
  return sizes;
}

bool is_finite(const Dense& a) {
  return std::all_of(a.data.begin(), a.data.end(),
                     [](double x) { return std::isfinite(x); });
}

/// A matrix, and what each entry adds up from.
struct Summed {
  explicit Summed(int n) : matrix(n, n), sizes(n, n) {}
  void add(int i, int j, Complex value, double size) {
    matrix(i, j) += value;
    sizes(i, j) += size;
  }
  void add(int i, int j, Complex value) { add(i, j, value, std::abs(value)); }

  ComplexDense matrix;
  Dense sizes;
};

/// MX = EX diag(ν), and what rounding leaves of it.
struct Eigen {
  std::vector<Complex> nu;
  ComplexDense X, inverse;
  Dense lost_of_loads, lost_of_modes;
};

/// Nothing if modes are too near each other. @throws Error if the eigenvalues are not found.
std::optional<Eigen> eigen_of(const Summed& E, const Summed& M) {
  const int N = E.matrix.rows;
  Eigen of;
  ComplexEigen eigen = complex_eigen(solve(E.matrix, M.matrix));
  of.nu = std::move(eigen.values);
  of.X = std::move(eigen.vectors);
  ComplexDense unit(N, N);
  for (int i = 0; i < N; ++i) unit(i, i) = 1;
  const ComplexDense EX = multiply(E.matrix, of.X), MX = multiply(M.matrix, of.X);
  // Rounding of products, entry by entry; complex ones lose a little more than real ones.
  const double lost = product_rounding(N);
  const Dense sizes = absolute_of(of.X), of_EX = multiply(E.sizes, sizes),
              of_MX = multiply(M.sizes, sizes);
  Dense of_modes(N, N); // MX − EX diag(ν)
  for (int j = 0; j < N; ++j) {
    const Complex nu = of.nu[as_size(j)];
    for (int i = 0; i < N; ++i)
      of_modes(i, j) = std::abs(MX(i, j) - EX(i, j) * nu) +
                       lost * (of_EX(i, j) * std::abs(nu) + of_MX(i, j));
  }
  of.inverse = solve(EX, std::move(unit));
  const Dense inverse = absolute_of(of.inverse);
  ComplexDense left = multiply(EX, of.inverse);
  for (int i = 0; i < N; ++i) left(i, i) -= 1;
  Dense of_loads = absolute_of(left);
  add_to(of_loads, multiply(of_EX, inverse), 2 * lost); // of EX, and of this product
  const double away = frobenius_norm(of_loads);
  constexpr double most = 1e-3;
  if (!(away <= most)) return std::nullopt;
  // (EX)⁻¹ itself is that times the series of what it leaves of 1, R: 1 + R + R² + …, the last by
  // norms.
  const auto lost_of = [&](const Dense& part) {
    Dense further = multiply(of_loads, part);
    for (int j = 0; j < N; ++j) {
      double square = 0;
      for (int i = 0; i < N; ++i) square += part(i, j) * part(i, j);
      const double rest = away * away / (1 - away) * std::sqrt(square);
      for (int i = 0; i < N; ++i) further(i, j) += part(i, j) + rest;
    }
    return multiply(inverse, further);
  };
  of.lost_of_loads = lost_of(of_loads);
  of.lost_of_modes = lost_of(of_modes);
  add_to(of.lost_of_loads, inverse, lost); // the product with B
  if (!is_finite(of.lost_of_loads) || !is_finite(of.lost_of_modes)) return std::nullopt;
  return of;
}

/// γ of each term with g = γ a; nothing if one is another function of ω.
std::optional<std::vector<Complex>> stiffness_of(const DenseSystem& system,
                                                 bool takes_beta) {
  std::vector<Complex> shares;
  const Interval any{0, 2}; // both are linear
  const Complex a0 = takes_beta ? Complex(1, system.damping.eta + system.damping.beta)
                                : 1.0,
                a1 = takes_beta ? Complex(0, system.damping.beta) : 0.0;
  for (const auto& [law, T] : system.terms) {
    if (!law.kind().is_stiffness()) return std::nullopt;
    const auto g = law.series(any, 1).coefficients;
    const Complex share = g[0] / a0;
    if (!(std::abs(g[1] - share * a1) <= 4 * epsilon * std::abs(g[1])))
      return std::nullopt;
    shares.push_back(share);
  }
  return shares;
}

/// g = stiffness + s rate, s = iω, of each term; nothing if one is another function of ω.
struct OfRates {
  Complex stiffness, rate;
};
std::optional<std::vector<OfRates>> rates_of(const DenseSystem& system) {
  std::vector<OfRates> shares;
  const Interval any{0, 2}; // ω = 1 + t
  for (const auto& [law, T] : system.terms) {
    if (!law.kind().is_stiffness() && !law.is_of_rates()) return std::nullopt;
    const auto g = law.series(any, 1).coefficients;
    shares.push_back({g[0] - g[1], Complex(0, -1) * g[1]});
  }
  return shares;
}

} // namespace

std::optional<PencilModes> PencilModes::of(const DenseResponse& response) {
  if (response.system().order() == 0) return std::nullopt;
  try {
    auto modes = of_stiffness(response);
    if (!modes) modes = of_rates(response);
    if (!modes) return modes;
    modes->negligible_ = response.system().negligible;
    modes->own_loads_ = modes->loads(response.modal_inputs());
    const Dense& lost = modes->lost_of_modes_;
    modes->sums_.assign(as_size(lost.rows), 0.0);
    for (int k = 0; k < lost.columns; ++k)
      for (int i = 0; i < lost.rows; ++i) modes->sums_[as_size(i)] += lost(i, k);
    return modes;
  } catch (const Error&) {
    return std::nullopt;
  }
}

std::optional<PencilModes> PencilModes::of_stiffness(const DenseResponse& response) {
  const DenseSystem& system = response.system();
  const Damping& damping = system.damping;
  const int N = system.order();
  const double tau = response.tau();
  const bool takes_beta = damping.beta != 0;
  const auto shares = stiffness_of(system, takes_beta);
  if (!shares) return std::nullopt;
  Summed E(N), M(N);
  add_terms(E.matrix, *shares, response.modal_terms());
  for (std::size_t t = 0; t < shares->size(); ++t)
    add_to(E.sizes, absolute(response.modal_terms()[t]), std::abs((*shares)[t]));
  const Complex of_K(1, takes_beta ? 0 : damping.eta);
  for (int i = 0; i < N; ++i) {
    const auto at = as_size(i);
    const double lambda = response.lambda()[at], mu = response.mu()[at],
                 k = std::isfinite(lambda) ? mu * lambda : 1.0;
    E.add(i, i, of_K * k + tau * mu, std::abs(of_K * k) + tau * mu);
    M.add(i, i, mu);
  }
  auto eigen = eigen_of(E, M);
  if (!eigen) return std::nullopt;
  PencilModes modes;
  const Complex a0 = takes_beta ? Complex(1, damping.eta) : 1.0,
                a1 = takes_beta ? Complex(0, damping.beta) : 0.0;
  for (const Complex& nu : eigen->nu) {
    const Complex rest = 1.0 - tau * nu;
    modes.modes_.push_back({a0 * rest, a1 * rest + Complex(0, damping.alpha) * nu, -nu,
                            std::abs(a0) * (1 + tau * std::abs(nu))});
  }
  modes.shift_constant_ = -tau * a0;
  modes.shift_linear_ = Complex(0, damping.alpha) - tau * a1;
  modes.shift_square_ = -1;
  modes.sizes_ = absolute_of(eigen->X);
  modes.X_ = std::move(eigen->X);
  modes.inverse_ = std::move(eigen->inverse);
  modes.lost_of_loads_ = std::move(eigen->lost_of_loads);
  modes.lost_of_modes_ = std::move(eigen->lost_of_modes);
  return modes;
}

std::optional<PencilModes> PencilModes::of_rates(const DenseResponse& response) {
  const DenseSystem& system = response.system();
  const Damping& damping = system.damping;
  const int N = system.order(), free = response.free(), n = N - free;
  const double s0 = std::sqrt(response.tau());
  const auto shares = rates_of(system);
  if (!shares) return std::nullopt;
  const std::vector<double>& mu = response.mu();
  int heavy = 0; // coordinates with mass
  for (int i = free; i < N; ++i) heavy += mu[as_size(i)] > 0;
  Summed E(n + heavy), M(n + heavy);
  for (std::size_t t = 0; t < shares->size(); ++t) {
    const Dense& T = response.modal_terms()[t];
    const auto& [stiffness, rate] = (*shares)[t];
    const double size = std::abs(stiffness) + s0 * std::abs(rate);
    for (int j = 0; j < n; ++j)
      for (int i = 0; i < n; ++i) {
        const double entry = T(free + i, free + j);
        E.add(i, j, (stiffness + s0 * rate) * entry, size * std::abs(entry));
        M.add(i, j, rate * entry);
      }
  }
  int y = n;
  for (int i = 0; i < n; ++i) {
    const auto at = as_size(free + i);
    const double lambda = response.lambda()[at],
                 k = std::isfinite(lambda) ? mu[at] * lambda : 1.0,
                 rate = damping.alpha * mu[at] + damping.beta * k,
                 root = std::sqrt(mu[at]);
    E.add(i, i, Complex(k + s0 * rate, damping.eta * k),
          std::abs(k) * (1 + damping.eta) + s0 * std::abs(rate));
    M.add(i, i, rate);
    if (!(mu[at] > 0)) continue;
    E.add(i, y, s0 * root);
    E.add(y, i, s0 * root);
    E.add(y, y, -1);
    M.add(i, y, root);
    M.add(y, i, root);
    ++y;
  }
  auto eigen = eigen_of(E, M);
  if (!eigen) return std::nullopt;
  const int count = free + n + heavy;
  PencilModes modes;
  modes.X_ = ComplexDense(N, count);
  modes.inverse_ = ComplexDense(count, N);
  modes.lost_of_loads_ = Dense(count, N);
  modes.lost_of_modes_ = Dense(count, count);
  for (int i = 0; i < free; ++i) { // s²μ + sαμ
    const double m = mu[as_size(i)];
    modes.modes_.push_back({0, Complex(0, damping.alpha * m), -m, 0});
    modes.X_(i, i) = modes.inverse_(i, i) = 1;
  }
  for (int j = 0; j < n + heavy; ++j) {
    const Complex nu = eigen->nu[as_size(j)];
    modes.modes_.push_back({1.0 - s0 * nu, Complex(0, 1) * nu, 0, 1 + s0 * std::abs(nu)});
    for (int i = 0; i < n; ++i) {
      modes.X_(free + i, free + j) = eigen->X(i, j);
      modes.inverse_(free + j, free + i) = eigen->inverse(j, i);
      modes.lost_of_loads_(free + j, free + i) = eigen->lost_of_loads(j, i);
    }
    for (int i = 0; i < n + heavy; ++i)
      modes.lost_of_modes_(free + i, free + j) = eigen->lost_of_modes(i, j);
  }
  modes.sizes_ = absolute_of(modes.X_);
  modes.shift_constant_ = -s0;
  modes.shift_linear_ = Complex(0, 1);
  return modes;
}

PencilModes::Loads PencilModes::loads(const Dense& B) const {
  Loads of{multiply(inverse_, as_complex(B)), {}, multiply(lost_of_loads_, absolute(B))};
  of.sizes = absolute_of(of.c);
  return of;
}

PencilModes::Diagonal PencilModes::diagonal(Interval interval, int mode) const {
  const double c = interval.centre(), h = interval.half();
  const auto& [constant, linear, square, size] = modes_[as_size(mode)];
  return {constant + c * (linear + c * square), h * (linear + 2 * c * square),
          h * h * square,
          8 * epsilon * (size + c * std::abs(linear) + c * c * std::abs(square))};
}

double PencilModes::largest_shift(Interval interval) const {
  const double c = interval.centre(), h = interval.half();
  return std::abs(shift_constant_ + c * (shift_linear_ + c * shift_square_)) +
         h * std::abs(shift_linear_ + 2 * c * shift_square_) +
         h * h * std::abs(shift_square_);
}

} // namespace flexgram
