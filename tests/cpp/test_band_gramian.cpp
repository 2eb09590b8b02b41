#include "base/index.hpp"
#include "basis/band_gramian.hpp"
#include "examples.hpp"

#include <cmath>
#include <numbers>

using namespace flexgram;
using namespace flexgram::examples;

namespace {

DenseSystem dense_rod(PetscInt order, Damping damping) {
  const SecondOrderModel fom = rod(order, damping);
  DenseSystem system;
  system.M = whole(fom.M);
  system.K = whole(fom.K);
  system.B = whole(fom.B);
  system.C = system.B;
  system.damping = damping;
  return system;
}

} // namespace

TEST(BandGramian, EqualsTheClosedFormOfAModalSystem) {
  // P_jk = b_j b_kᵀ (1/π) ∫ Re(1/(a_j ā_k)) dω in modal coordinates; each entry by its
  // poles: the antiderivative of a rational function, here by a very fine rule (Simpson,
  // 400,000 points).
  const Damping damping{0.05, 2e-3, 0};
  const DenseResponse response(dense_rod(12, damping), 1.0);
  const Dense F = gramian_factor(response, {BandWeight::flat(0.5, 6)}, false);
  const Dense P = multiply(F, transpose(F));
  const int steps = 400000;
  Dense exact(12, 12);
  const Dense& B = response.modal_inputs();
  for (int l = 0; l <= steps; ++l) {
    const double omega = 0.5 + 5.5 * l / steps;
    const double weight = (l == 0 || l == steps ? 1 : l % 2 ? 4 : 2) * 5.5 / steps / 3;
    const auto a = response.diagonal(omega);
    for (int j = 0; j < 12; ++j)
      for (int k = 0; k < 12; ++k) {
        double loads = 0;
        for (int p = 0; p < B.columns; ++p) loads += B(j, p) * B(k, p);
        exact(j, k) += weight / std::numbers::pi * loads *
                       (1.0 / (a[as_size(j)] * std::conj(a[as_size(k)]))).real();
      }
  }
  exact = multiply(multiply(response.U(), exact), transpose(response.U()));
  for (std::size_t i = 0; i < P.data.size(); ++i)
    EXPECT_NEAR(P.data[i], exact.data[i], 1e-10 * frobenius_norm(exact));
}

/// By complex modes, against solves at the nodes of a fine rule: gyroscopic forces, and a loss factor
/// of a part; by solves with a Prony term. Ports of different sizes, all of the same weight.
TEST(BandGramian, OfSystemsWithTermsIsThatOfTheirResponse) {
  constexpr int N = 9, steps = 60000;
  const LawNumbers relaxing{{"g", {0.3}}, {"tau", {0.5}}};
  for (const Law& kind : {Law(Law::Kind::gyroscopic), Law(Law::Kind::structural),
                          Law("rubber", "prony", relaxing)}) {
    DenseSystem system = dense_rod(N, {0.02, 1e-4, 0});
    Dense T(N, N);
    for (int i = 1; i < N; ++i) {
      const bool is_skew = kind.is_skew();
      T(i, i - 1) = is_skew ? 0.4 : -0.01;
      T(i - 1, i) = is_skew ? -0.4 : -0.01;
      if (!is_skew) T(i, i) += 0.03;
    }
    system.terms.push_back({kind, T});
    const DenseResponse response(system, 1.0);
    const Dense F = gramian_factor(response, {BandWeight::flat(0.5, 3)}, true);
    const Dense P = multiply(F, transpose(F));
    std::vector<Dense> each(as_size(system.B.columns), Dense(N, N));
    for (int l = 0; l <= steps; ++l) {
      const double omega = 0.5 + 2.5 * l / steps, weight = (l == 0 || l == steps ? 1
                                                            : l % 2              ? 4
                                                                                 : 2) *
                                                           2.5 / steps / 3 /
                                                           std::numbers::pi;
      const ComplexDense x = response.modal_response(omega);
      for (int p = 0; p < x.columns; ++p)
        for (int j = 0; j < N; ++j)
          for (int i = 0; i < N; ++i)
            each[as_size(p)](i, j) += weight * (x(i, p) * std::conj(x(j, p))).real();
    }
    Dense exact(N, N);
    for (const Dense& of_port : each) {
      double energy = 0;
      for (int i = 0; i < N; ++i) energy += response.mu()[as_size(i)] * of_port(i, i);
      add_to(exact, of_port, 1 / energy);
    }
    exact = multiply(multiply(response.U(), exact), transpose(response.U()));
    for (std::size_t i = 0; i < P.data.size(); ++i)
      EXPECT_NEAR(P.data[i], exact.data[i], 1e-9 * frobenius_norm(exact));
  }
}

TEST(BandGramian, OverTheWholeAxisSolvesTheLyapunovEquation) {
  // First-order form x' = A x + B u, A X + X Aᵀ + B Bᵀ = 0; P is its position block (eq.
  // 5).
  const Damping damping{0.3, 1e-2, 0};
  constexpr int m = 6;
  const DenseSystem system = dense_rod(m, damping);
  const Dense F = whole_axis_factor(DenseResponse(system, 1.0), false);
  const Dense P = multiply(F, transpose(F));
  // By modes: x'' + d_j x' + λ_j x = b_j; the Lyapunov equation of two modes has a closed
  // solution.
  const DenseResponse modes(system, 1.0);
  Dense exact(m, m);
  const Dense& B = modes.modal_inputs();
  for (int j = 0; j < m; ++j)
    for (int k = 0; k < m; ++k) {
      const double l_j = modes.lambda()[as_size(j)], l_k = modes.lambda()[as_size(k)],
                   d_j = damping.alpha + damping.beta * l_j,
                   d_k = damping.alpha + damping.beta * l_k,
                   mu = std::sqrt(modes.mu()[as_size(j)] * modes.mu()[as_size(k)]);
      double loads = 0;
      for (int p = 0; p < B.columns; ++p) loads += B(j, p) * B(k, p) / mu;
      // ∫_0^∞ h_j h_k dt of two impulse responses.
      const double s = d_j + d_k, g = l_j - l_k;
      exact(j, k) = loads * s / (g * g + s * (d_j * l_k + d_k * l_j)) / mu * mu;
    }
  // U is normalised in K + τM: modal coordinates in M are U/√μ.
  Dense phi = modes.U();
  for (int j = 0; j < m; ++j)
    for (int i = 0; i < m; ++i) phi(i, j) /= std::sqrt(modes.mu()[as_size(j)]);
  exact = multiply(multiply(phi, exact), transpose(phi));
  for (std::size_t i = 0; i < P.data.size(); ++i)
    EXPECT_NEAR(P.data[i], exact.data[i], 1e-9 * frobenius_norm(exact));
}
