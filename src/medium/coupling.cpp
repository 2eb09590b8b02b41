#include "medium/coupling.hpp"

#include "base/index.hpp"
#include "linalg/decompositions.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

namespace flexgram {
namespace {

constexpr double infinity = std::numeric_limits<double>::infinity();

/// An orthonormal basis of their span on which UᵀMU is diagonal.
VectorsOfV vectors_of(const DenseResponse& response, const Dense& all) {
  constexpr double nothing_new = 1e-8;
  const int N = response.system().order();
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

/// The first columns of U and, for each term, E⁻¹T of them as far as V holds it.
VectorsOfV with_coupled(const DenseResponse& response, int count, double sigma) {
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
  return vectors_of(response, all);
}

/// Σ Re g T in the coordinates U.
Dense stiffening(const DenseResponse& response, double omega) {
  const int N = response.system().order();
  Dense sum(N, N);
  const auto g = response.system().coefficients(omega).terms;
  for (std::size_t t = 0; t < g.size(); ++t)
    if (g[t].real() != 0) add_to(sum, response.modal_terms()[t], g[t].real());
  symmetrise(sum);
  return sum;
}

/// Frequencies of the modes of V below the cutoff with the stiffness that terms add.
std::vector<double> stiffened_resonances(const DenseResponse& response, double sigma) {
  const int N = response.system().order();
  Dense mass(N, N), both = stiffening(response, 0.7 * std::sqrt(sigma));
  for (int i = 0; i < N; ++i) {
    mass(i, i) = response.mu()[as_size(i)];
    both(i, i) += 1;
  }
  std::vector<double> found;
  try {
    for (double mu : symmetric_eigen(std::move(mass), std::move(both)).values) {
      const double lambda = mu > 0 ? 1 / mu - response.tau() : infinity;
      if (lambda > 0 && lambda < sigma) found.push_back(std::sqrt(lambda));
    }
  } catch (const IndefiniteError&) { // by rounding: terms are too large
  }
  std::sort(found.begin(), found.end());
  return found;
}

/// The vectors with vᵀEv < 0 of E v = e P v, P = (ω_c² − ω²)M + Σ Re g T. With W = E + θP =
/// K + τM + θ Σ Re g T for θ = (ω_c² + τ)/(ω_c² − ω²) they are those of P v = π W v with the
/// largest π.
std::optional<VectorsOfV> softest_at(const DenseResponse& response, int modes,
                                     double sigma, double omega) {
  const double above = sigma - omega * omega, theta = (sigma + response.tau()) / above;
  if (!(above > 1e-3 * sigma)) return std::nullopt;
  Dense P = stiffening(response, omega), W = P;
  for (double& x : W.data) x *= theta;
  for (int i = 0; i < P.rows; ++i) {
    W(i, i) += 1;
    P(i, i) += above * response.mu()[as_size(i)];
  }
  try {
    const Dense all = symmetric_eigen(std::move(P), std::move(W)).vectors;
    return vectors_of(response, part_of(all, 0, all.rows, all.columns - modes, modes));
  } catch (const IndefiniteError&) { // by rounding: terms are too large
    return std::nullopt;
  }
}

} // namespace

TermCoupling::TermCoupling(const DenseResponse& response, const OutsideParts& outside,
                           int modes, double sigma) {
  const DenseSystem& system = response.system();
  const int N = system.order();
  constexpr int steps = 8;
  constexpr double hardly_any = 0.02, much = 0.1; // of what 1/(1 − δ) gains
  double least = infinity;
  const auto judge = [&](ModeCoupling coupling) {
    double largest = 0;
    for (double part : {0.2, 0.5, 0.8}) {
      const double delta = coupling.at(system, part * std::sqrt(sigma), false);
      largest = std::isfinite(delta) ? std::max(largest, delta) : infinity;
      if (largest == infinity) break;
    }
    if (!everywhere_.empty() && !(largest < 0.9 * least)) return;
    everywhere_.assign(1, std::move(coupling));
    least = largest;
  };
  const auto adapted = [&](double omega) -> std::optional<ModeCoupling> {
    const auto vectors = softest_at(response, modes, sigma, omega);
    if (!vectors) return std::nullopt;
    return ModeCoupling::of(response, outside, *vectors, modes, sigma);
  };
  if (modes > 0 && frobenius_norm(stiffening(response, 0.5 * std::sqrt(sigma))) > 0)
    if (auto coupling = adapted(0.5 * std::sqrt(sigma))) judge(std::move(*coupling));
  for (int step = 0; step <= steps; ++step)
    judge({response, outside, modes + (N - modes) * step / steps, sigma});
  if (modes == 0) return;

  if (least > hardly_any)
    for (int count : {modes, modes + (N - modes) / steps})
      if (auto coupling = ModeCoupling::of(
              response, outside, with_coupled(response, count, sigma), modes, sigma))
        judge(std::move(*coupling));

  constexpr std::size_t most = 32;
  for (double omega : stiffened_resonances(response, sigma)) {
    if (at_.size() >= most) break;
    if (!(everywhere_.front().at(system, omega, true) > much) ||
        (!at_.empty() && !(at_.back().coupling.at(system, omega, true) > much)))
      continue;
    if (auto coupling = adapted(omega)) at_.push_back({omega, std::move(*coupling)});
  }
}

double TermCoupling::over(const DenseSystem& system, Interval interval) const {
  constexpr double enough = 0.1; // 1/(1 − δ) hardly changes
  if (everywhere_.empty()) return infinity;
  double least = everywhere_.front().over(system, interval);
  const auto next =
      std::lower_bound(at_.begin(), at_.end(), interval.centre(),
                       [](const At& known, double omega) { return known.omega < omega; });
  for (int side : {0, -1}) {
    if (!(least > enough)) break;
    if (side < 0 ? next == at_.begin() : next == at_.end()) continue;
    least = std::min(least, (next + side)->coupling.over(system, interval));
  }
  return least;
}

} // namespace flexgram
