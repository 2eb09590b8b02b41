#include "model/dense_system.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

namespace flexgram {
namespace {

Dense congruence(const Dense& a, const Dense& Q) {
  if (a.data.empty()) return {};
  Dense result = multiply_transposed(Q, multiply(a, Q));
  symmetrise(result);
  return result;
}

Dense dense_of(const Block& block) {
  Dense a(static_cast<int>(block.rows()), static_cast<int>(block.columns()));
  const Block::Access access(block);
  std::copy_n(access.column(0), a.data.size(), a.data.begin());
  return a;
}

} // namespace

ShiftCoefficients DenseSystem::coefficients(double omega) const {
  const std::complex<double> i(0, 1);
  return {1.0 + i * (damping.eta + omega * damping.beta),
          i * omega * damping.alpha - omega * omega, i * omega};
}

DenseSystem DenseSystem::project(const Dense& Q) const {
  DenseSystem part;
  part.M = congruence(M, Q);
  part.K = congruence(K, Q);
  part.D = congruence(D, Q);
  part.B = multiply_transposed(Q, B);
  part.C = outputs_are_inputs ? part.B : multiply_transposed(Q, C);
  part.damping = damping;
  part.outputs_are_inputs = outputs_are_inputs;
  return part;
}

SecondOrderModel DenseSystem::model(const SecondOrderModel& names) const {
  SecondOrderModel model;
  model.name = names.name;
  model.comm = PETSC_COMM_SELF;
  model.n = order();
  model.rows = {0, model.n};
  Dense sum(order(), order());
  for (std::size_t i = 0; i < sum.data.size(); ++i)
    sum.data[i] = damping.alpha * M.data[i] + damping.beta * K.data[i] +
                  (has_extra_damping() ? D.data[i] : 0.0);
  model.K = make_dense(K);
  model.M = make_dense(M);
  if (frobenius_norm(sum) > 0) model.D = make_dense(sum);
  model.damping.eta = damping.eta;
  model.B = make_block(B);
  model.C = outputs_are_inputs ? model.B.share() : make_block(C);
  model.outputs_are_inputs = outputs_are_inputs;
  model.feedthrough = names.feedthrough;
  model.inputs = names.inputs;
  model.outputs = names.outputs;
  return model;
}

DenseSystem DenseSystem::from(const SecondOrderModel& dense) {
  DenseSystem system;
  system.M = to_dense(dense.M);
  system.K = to_dense(dense.K);
  if (dense.D) system.D = to_dense(dense.D);
  system.damping = dense.damping;
  system.B = dense_of(dense.B);
  system.C = dense_of(dense.C);
  system.outputs_are_inputs = dense.outputs_are_inputs;
  return system;
}

DenseResponse::DenseResponse(DenseSystem system, double tau)
    : system_(std::move(system)), tau_(tau) {
  Dense E = system_.K;
  for (std::size_t i = 0; i < E.data.size(); ++i) E.data[i] += tau * system_.M.data[i];
  const SymmetricEigen eigen = symmetric_eigen(system_.M, E);
  const int N = system_.order();
  U_ = Dense(N, N);
  for (int j = 0; j < N; ++j) { // ascending λ is descending μ
    std::copy_n(eigen.vectors.column(N - 1 - j), N, U_.column(j));
    mu_.push_back(std::max(eigen.values[static_cast<std::size_t>(N - 1 - j)], 0.0));
  }
  take_coordinates();
}

DenseResponse::DenseResponse(DenseSystem system, double tau, Dense U,
                             std::vector<double> mu)
    : system_(std::move(system)), tau_(tau), U_(std::move(U)), mu_(std::move(mu)) {
  take_coordinates();
}

void DenseResponse::take_coordinates() {
  for (double mu : mu_)
    lambda_.push_back(mu > 0 ? 1 / mu - tau_ : std::numeric_limits<double>::infinity());
  B_ = multiply_transposed(U_, system_.B);
  C_ = system_.outputs_are_inputs ? B_ : multiply_transposed(U_, system_.C);
  D_ = congruence(system_.D, U_);
}

std::vector<std::complex<double>> DenseResponse::diagonal(double omega,
                                                          double eta_added) const {
  ShiftCoefficients c = system_.coefficients(omega);
  c.k += std::complex<double>(0, eta_added);
  std::vector<std::complex<double>> a; // a_k K + a_m M = a_k (K + τM) + (a_m − τ a_k) M
  for (double m : mu_) a.push_back(c.k + (c.m - tau_ * c.k) * m);
  return a;
}

Dense DenseResponse::companion() const {
  // (s²μ + sC + k) x = 0 with z = 1/s, y = z x: z² k x = −(μ + z C) x, i.e.
  // z y = −k⁻¹(C y + μ x), z x = y; k = 1 − τμ at least 1e-12: rigid poles are far from
  // the band.
  const int N = system_.order();
  Dense damping = D_;
  if (damping.data.empty()) damping = Dense(N, N);
  for (int i = 0; i < N; ++i) {
    const double m = mu_[static_cast<std::size_t>(i)];
    damping(i, i) += system_.damping.alpha * m + system_.damping.beta * (1 - tau_ * m);
  }
  Dense companion(2 * N, 2 * N);
  for (int i = 0; i < N; ++i) {
    const double m = mu_[static_cast<std::size_t>(i)], k = std::max(1 - tau_ * m, 1e-12);
    for (int j = 0; j < N; ++j) companion(i, j) = -damping(i, j) / k;
    companion(i, N + i) = -m / k;
    companion(N + i, i) = 1;
  }
  return companion;
}

ComplexDense DenseResponse::modal_response(double omega) const {
  const ShiftCoefficients c = system_.coefficients(omega);
  const int N = system_.order();
  const auto a = diagonal(omega);
  ComplexDense x(N, B_.columns);
  for (std::size_t i = 0; i < x.data.size(); ++i) x.data[i] = B_.data[i];
  if (is_diagonal()) {
    for (int i = 0; i < N; ++i) {
      if (a[static_cast<std::size_t>(i)] == 0.0)
        throw ShiftError("the body is undamped and the frequency is a resonance");
      const auto inverse = 1.0 / a[static_cast<std::size_t>(i)];
      for (int j = 0; j < x.columns; ++j) x(i, j) *= inverse;
    }
    return x;
  }
  ComplexDense A(N, N);
  for (std::size_t i = 0; i < A.data.size(); ++i) A.data[i] = c.d * D_.data[i];
  for (int i = 0; i < N; ++i) A(i, i) += a[static_cast<std::size_t>(i)];
  return solve(std::move(A), std::move(x));
}

ComplexDense DenseResponse::transfer(const ComplexDense& modal_response) const {
  return multiply_transposed(C_, modal_response);
}

std::vector<std::complex<double>> poles(const DenseResponse& response, double eta_added) {
  const DenseSystem& system = response.system();
  std::vector<std::complex<double>> found;
  const std::complex<double> i(0, 1);
  if (response.is_diagonal()) { // λ(1 + iη + iωβ) + iωα − ω² = 0
    for (double l : response.lambda()) {
      if (!std::isfinite(l)) continue;
      const double d = system.damping.alpha + system.damping.beta * l;
      const std::complex<double> eta(1, system.damping.eta + eta_added);
      const std::complex<double> root = std::sqrt(-d * d + 4.0 * std::max(l, 0.0) * eta);
      for (const double sign : {1.0, -1.0}) found.push_back(0.5 * (i * d + sign * root));
    }
    return found;
  }
  for (const std::complex<double> inverse : general_eigenvalues(response.companion()))
    if (std::abs(inverse) > 0) found.push_back(-i / inverse); // ω = s/i
  return found;
}

} // namespace flexgram
