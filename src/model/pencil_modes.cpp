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

} // namespace

std::optional<PencilModes> PencilModes::of(const DenseResponse& response) {
  const DenseSystem& system = response.system();
  const int N = system.order();
  PencilModes modes;
  modes.damping_ = system.damping;
  modes.tau_ = response.tau();
  modes.takes_beta_ = system.damping.beta != 0;
  const auto shares = stiffness_of(system, modes.takes_beta_);
  if (!shares || N == 0) return std::nullopt;
  const std::vector<double>& mu = response.mu();
  ComplexDense E(N, N);
  add_terms(E, *shares, response.modal_terms());
  Dense summed(N, N); // of the sizes of what E is the sum of
  for (std::size_t t = 0; t < shares->size(); ++t)
    add_to(summed, absolute(response.modal_terms()[t]), std::abs((*shares)[t]));
  const Complex of_K(1, modes.takes_beta_ ? 0 : system.damping.eta);
  for (int i = 0; i < N; ++i) {
    const auto at = as_size(i);
    const double lambda = response.lambda()[at],
                 k = std::isfinite(lambda) ? mu[at] * lambda : 1.0;
    E(i, i) += of_K * k + modes.tau_ * mu[at];
    summed(i, i) += std::abs(of_K) * k + modes.tau_ * mu[at];
  }
  ComplexDense M(N, N);
  for (int i = 0; i < N; ++i) M(i, i) = mu[as_size(i)];
  ComplexDense unit(N, N);
  for (int i = 0; i < N; ++i) unit(i, i) = 1;
  try {
    ComplexEigen eigen = complex_eigen(solve(E, std::move(M)));
    modes.nu_ = std::move(eigen.values);
    modes.X_ = std::move(eigen.vectors);
    ComplexDense EX = multiply(E, modes.X_);
    // Rounding of products, entry by entry; complex ones lose a little more than real ones.
    const double lost = 4 * epsilon * (N + 4);
    modes.sizes_ = absolute_of(modes.X_);
    const Dense of_EX = multiply(summed, modes.sizes_);
    Dense of_modes(N, N); // MX − EX diag(ν)
    for (int j = 0; j < N; ++j) {
      const Complex nu = modes.nu_[as_size(j)];
      for (int i = 0; i < N; ++i) {
        const double m = mu[as_size(i)];
        of_modes(i, j) = std::abs(m * modes.X_(i, j) - EX(i, j) * nu) +
                         lost * (of_EX(i, j) * std::abs(nu) + m * modes.sizes_(i, j));
      }
    }
    modes.inverse_ = solve(EX, unit);
    const Dense inverse = absolute_of(modes.inverse_);
    ComplexDense left = multiply(EX, modes.inverse_);
    for (int i = 0; i < N; ++i) left(i, i) -= 1;
    Dense of_loads = absolute_of(left);
    add_to(of_loads, multiply(of_EX, inverse), lost);
    const double away = frobenius_norm(of_loads);
    constexpr double most = 1e-3; // modes too near each other
    if (!(away <= most)) return std::nullopt;
    // (EX)⁻¹ itself is that times the series of what it leaves of 1.
    const auto lost_of = [&](const Dense& part) {
      Dense further = multiply(of_loads, part);
      for (double& x : further.data) x /= 1 - away;
      add_to(further, part);
      return multiply(inverse, further);
    };
    modes.lost_of_loads_ = lost_of(of_loads);
    modes.lost_of_modes_ = lost_of(of_modes);
    add_to(modes.lost_of_loads_, inverse, lost); // the product with B
    if (!is_finite(modes.lost_of_loads_) || !is_finite(modes.lost_of_modes_))
      return std::nullopt;
  } catch (const Error&) {
    return std::nullopt;
  }
  return modes;
}

PencilModes::Diagonal PencilModes::diagonal(Interval interval, int mode) const {
  const double c = interval.centre(), h = interval.half();
  const Complex nu = nu_[as_size(mode)], rest = 1.0 - tau_ * nu,
                a0 = takes_beta_ ? Complex(1, damping_.eta + c * damping_.beta) : 1.0,
                a1 = takes_beta_ ? Complex(0, h * damping_.beta) : 0.0,
                m0(-c * c, c * damping_.alpha), m1(-2 * c * h, h * damping_.alpha);
  return {a0 * rest + m0 * nu, a1 * rest + m1 * nu, -h * h * nu,
          8 * epsilon * (std::abs(a0) * (1 + tau_ * std::abs(nu)) + std::abs(m0 * nu))};
}

double PencilModes::largest_shift(Interval interval) const {
  const double c = interval.centre(), h = interval.half();
  const Complex a0 = takes_beta_ ? Complex(1, damping_.eta + c * damping_.beta) : 1.0;
  return std::abs(Complex(-c * c, c * damping_.alpha) - tau_ * a0) +
         std::abs(Complex(-2 * c * h, h * damping_.alpha)) +
         tau_ * (takes_beta_ ? h * damping_.beta : 0.0) + h * h;
}

} // namespace flexgram
