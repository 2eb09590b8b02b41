/// Poles of a dense system. Declared in dense_system.hpp.

#include "base/index.hpp"
#include "linalg/decompositions.hpp"
#include "model/dense_system.hpp"

#include <algorithm>
#include <cmath>

namespace flexgram {

Dense DenseResponse::companion() const {
  // (s²μ + sC + k) x = 0 with z = 1/s, y = z x: z² k x = −(μ + z C) x, i.e.
  // z y = −k⁻¹(C y + μ x), z x = y; k = 1 − τμ at least 1e-12: rigid poles are far from
  // the band. Circulatory forces join k.
  const int N = system_.order();
  Dense damping(N, N), circulatory;
  for (std::size_t t = 0; t < terms_.size(); ++t) {
    const Law& law = system_.terms[t].law;
    if (law.is_of_rates()) add_to(damping, terms_[t], law.as_damper(1));
    if (!law.is_circulatory()) continue;
    if (circulatory.data.empty()) circulatory = Dense(N, N);
    add_to(circulatory, terms_[t], law.at(0).real());
  }
  for (int i = 0; i < N; ++i) {
    const double m = mu_[as_size(i)];
    damping(i, i) += system_.damping.alpha * m + system_.damping.beta * (1 - tau_ * m);
  }
  Dense companion(2 * N, 2 * N);
  std::vector<double> stiffness;
  for (int i = 0; i < N; ++i) {
    const double of_K = 1 - tau_ * mu_[as_size(i)];
    stiffness.push_back(std::abs(of_K) > 1e-12 ? of_K : 1e-12);
    companion(N + i, i) = 1;
  }
  if (circulatory.data.empty()) {
    for (int i = 0; i < N; ++i) {
      const double k = stiffness[as_size(i)];
      for (int j = 0; j < N; ++j) companion(i, j) = -damping(i, j) / k;
      companion(i, N + i) = -mu_[as_size(i)] / k;
    }
    return companion;
  }
  Dense right(N, 2 * N);
  set_part(right, 0, 0, damping);
  for (int i = 0; i < N; ++i) {
    right(i, N + i) = mu_[as_size(i)];
    circulatory(i, i) += stiffness[as_size(i)];
  }
  const ComplexDense solved = solve(as_complex(circulatory), as_complex(right));
  for (int j = 0; j < 2 * N; ++j)
    for (int i = 0; i < N; ++i) companion(i, j) = -solved(i, j).real();
  return companion;
}

namespace {

/// By what terms have of the mode alone, at its own frequency.
std::vector<std::complex<double>> pole_of_mode(const DenseResponse& response, int j,
                                               double eta_added) {
  const DenseSystem& system = response.system();
  const double l = response.lambda()[as_size(j)], mu = response.mu()[as_size(j)];
  if (!std::isfinite(l) || !(mu > 0)) return {};
  const std::complex<double> i(0, 1);
  std::vector<std::complex<double>> both;
  double omega = std::sqrt(std::max(l, 0.0));
  for (int turn = 0; turn < 4; ++turn) {
    double d = system.damping.alpha + system.damping.beta * l;
    std::complex<double> stiffness(std::max(l, 0.0),
                                   l * (system.damping.eta + eta_added));
    for (std::size_t t = 0; t < system.terms.size(); ++t) {
      const Law& law = system.terms[t].law;
      const double share = response.modal_terms()[t](j, j) / mu;
      if (law.is_viscous())
        d += share;
      else
        stiffness += share * law.at(omega);
    }
    const std::complex<double> root = std::sqrt(-d * d + 4.0 * stiffness);
    both = {0.5 * (i * d + root), 0.5 * (i * d - root)};
    omega = std::abs(both.front());
  }
  return both;
}

} // namespace

std::vector<std::complex<double>> poles(const DenseResponse& response, double eta_added) {
  const DenseSystem& system = response.system();
  std::vector<std::complex<double>> found;
  const std::complex<double> i(0, 1);
  const double eta = system.damping.eta + eta_added;
  if (response.is_diagonal()) { // λ(1 + iη + iωβ) + iωα − ω² = 0
    for (double l : response.lambda()) {
      if (!std::isfinite(l)) continue;
      const double d = system.damping.alpha + system.damping.beta * l;
      const std::complex<double> lossy(1, eta);
      const std::complex<double> root =
          std::sqrt(-d * d + 4.0 * std::max(l, 0.0) * lossy);
      for (const double sign : {1.0, -1.0}) found.push_back(0.5 * (i * d + sign * root));
    }
    return found;
  }
  const auto is_linear = [](const auto& term) { return term.law.is_linear(); };
  if (!std::all_of(system.terms.begin(), system.terms.end(), is_linear)) {
    for (int j = 0; j < system.order(); ++j)
      for (const std::complex<double>& pole : pole_of_mode(response, j, eta_added))
        found.push_back(pole);
    return found;
  }
  for (const std::complex<double> inverse : general_eigenvalues(response.companion()))
    if (std::abs(inverse) > 0) {
      const std::complex<double> pole = -i / inverse; // ω = s/i
      found.push_back(pole + i * (0.5 * eta * std::abs(pole.real())));
    }
  return found;
}

} // namespace flexgram
