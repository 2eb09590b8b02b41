#include "model/dense_system.hpp"

#include "model/pencil_modes.hpp"

#include "base/index.hpp"
#include "linalg/decompositions.hpp"
#include "linalg/last_turn.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

namespace flexgram {
namespace {

Dense congruence(const Dense& a, const Dense& Q, Symmetry of = Symmetry::symmetric) {
  if (a.data.empty()) return {};
  Dense result = multiply_transposed(Q, multiply(a, Q));
  symmetrise(result, of);
  return result;
}

void negate(Dense& a) {
  for (double& x : a.data) x = -x;
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
  ShiftCoefficients c{1.0 + i * (damping.eta + omega * damping.beta),
                      i * omega * damping.alpha - omega * omega};
  for (const auto& [law, T] : terms) c.terms.push_back(law.at(omega));
  return c;
}

DenseSystem DenseSystem::at(const ParameterValues& values) const {
  DenseSystem other = *this;
  set_parameters(other.terms, values);
  return other;
}

DenseSystem DenseSystem::stiffened() const {
  DenseSystem stiff = *this;
  const auto is_stiffness = [](const auto& term) {
    return term.law.varies() && term.law.kind().is_stiffness();
  };
  std::erase_if(stiff.terms, is_stiffness);
  Dense lost(order(), order());
  for (const auto& term : terms) {
    if (!is_stiffness(term)) continue;
    const double stiffness = term.law.at(0).real();
    add_to(stiff.K, term.matrix, stiffness);
    if (term.law.is_parameter())
      add_to(lost, term.matrix, stiffness * term.law.number("loss"));
  }
  if (frobenius_norm(lost) > 0)
    stiff.terms.push_back({Law::Kind::structural, std::move(lost)});
  return stiff;
}

bool DenseSystem::is_undamped() const {
  return damping.alpha == 0 && damping.beta == 0 && damping.eta == 0 &&
         std::all_of(terms.begin(), terms.end(),
                     [](const auto& term) { return term.law.is_skew(); });
}

bool DenseSystem::is_lossless() const {
  return is_undamped() && std::all_of(terms.begin(), terms.end(), [](const auto& term) {
           return term.law.is_of_rates();
         });
}

DenseSystem DenseSystem::transposed() const {
  DenseSystem other = *this;
  for (auto& [law, T] : other.terms)
    if (law.is_skew()) negate(T);
  return other;
}

DenseSystem DenseSystem::project(const Dense& Q) const {
  DenseSystem part;
  part.M = congruence(M, Q);
  part.K = congruence(K, Q);
  for (const auto& [law, T] : terms)
    part.terms.push_back({law, congruence(T, Q, law.symmetry())});
  part.B = multiply_transposed(Q, B);
  part.C = outputs_are_inputs ? part.B : multiply_transposed(Q, C);
  part.damping = damping;
  part.outputs_are_inputs = outputs_are_inputs;
  part.negligible = negligible;
  return part;
}

SecondOrderModel DenseSystem::model(const SecondOrderModel& names) const {
  SecondOrderModel model;
  model.name = names.name;
  model.comm = PETSC_COMM_SELF;
  model.n = order();
  model.rows = {0, model.n};
  model.K = make_dense(K);
  model.M = make_dense(M);
  const auto viscous = [](const auto& term) { return term.law.is_viscous(); };
  const auto of_rates = [](const auto& term) { return term.law.is_of_rates(); };
  if (!std::all_of(terms.begin(), terms.end(), of_rates) &&
      std::none_of(terms.begin(), terms.end(), viscous)) {
    model.damping = damping;
  } else {
    Dense sum(order(), order());
    for (std::size_t i = 0; i < sum.data.size(); ++i)
      sum.data[i] = damping.alpha * M.data[i] + damping.beta * K.data[i];
    for (const auto& [law, T] : terms)
      if (law.is_viscous()) add_to(sum, T);
    if (frobenius_norm(sum) > 0) model.terms.push_back({Law(), make_dense(sum)});
    model.damping.eta = damping.eta;
  }
  for (const auto& [law, T] : terms)
    if (!law.is_viscous()) model.terms.push_back({law, make_dense(T)});
  model.B = make_block(B);
  model.C = outputs_are_inputs ? model.B.share() : make_block(C);
  model.outputs_are_inputs = outputs_are_inputs;
  model.feedthrough = names.feedthrough;
  model.output_damping = names.output_damping;
  model.inputs = names.inputs;
  model.outputs = names.outputs;
  return model;
}

DenseSystem DenseSystem::from(const SecondOrderModel& dense) {
  DenseSystem system;
  system.M = to_dense(dense.M);
  system.K = to_dense(dense.K);
  for (const auto& [law, matrix] : dense.terms)
    system.terms.push_back({law, to_dense(matrix)});
  system.damping = dense.damping;
  system.B = dense_of(dense.B);
  system.C = dense_of(dense.C);
  system.outputs_are_inputs = dense.outputs_are_inputs;
  return system;
}

namespace {

/// How many first coordinates have no stiffness, no coupling and mass 1.
int free_coordinates(const DenseSystem& system) {
  const auto is_free = [&](int i) {
    for (int j = 0; j < system.order(); ++j) {
      const double mass = i == j ? 1 : 0;
      if (system.K(i, j) != 0 || system.K(j, i) != 0 || system.M(i, j) != mass ||
          system.M(j, i) != mass)
        return false;
      for (const auto& [law, T] : system.terms)
        if (T(i, j) != 0 || T(j, i) != 0) return false;
    }
    return true;
  };
  int count = 0;
  while (count < system.order() && is_free(count)) ++count;
  return count;
}

bool holds_a_diagonal(const Dense& a) {
  for (int j = 0; j < a.columns; ++j)
    for (int i = 0; i < a.rows; ++i)
      if (i != j && a(i, j) != 0) return false;
  return true;
}

/// uᵀAu with the digits of long double.
long double quadratic_form(const Dense& a, const double* u) {
  long double sum = 0;
  for (int j = 0; j < a.columns; ++j) {
    long double column = 0;
    for (int i = 0; i < a.rows; ++i)
      column += static_cast<long double>(a(i, j)) * static_cast<long double>(u[i]);
    sum += column * static_cast<long double>(u[j]);
  }
  return sum;
}

} // namespace

DenseResponse::DenseResponse(DenseSystem system, double tau)
    : system_(std::move(system)), tau_(tau), free_(free_coordinates(system_)) {
  const int N = system_.order(), free = free_, count = N - free;
  const Dense M = part_of(system_.M, free, count, free, count);
  Dense E = part_of(system_.K, free, count, free, count);
  add_to(E, M, tau);
  U_ = Dense(N, N);
  for (int i = 0; i < free; ++i) U_(i, i) = 1 / std::sqrt(tau);
  mu_.assign(as_size(free), 1 / tau);
  lambda_.assign(as_size(free), 0.0);
  if (holds_a_diagonal(M) && holds_a_diagonal(E)) {
    take_diagonals();
  } else if (count > 0) {
    const SymmetricEigen eigen = symmetric_eigen(M, E);
    for (int j = 0; j < count; ++j) { // ascending λ is descending μ
      std::copy_n(eigen.vectors.column(count - 1 - j), count, U_.column(free + j) + free);
      const double mu = std::max(eigen.values[as_size(count - 1 - j)], 0.0);
      mu_.push_back(mu);
      lambda_.push_back(mu > 0 ? 1 / mu - tau : std::numeric_limits<double>::infinity());
    }
    sharpen(free);
  }
  B_ = multiply_transposed(U_, system_.B);
  C_ = system_.outputs_are_inputs ? B_ : multiply_transposed(U_, system_.C);
  for (const auto& [law, T] : system_.terms)
    terms_.push_back(congruence(T, U_, law.symmetry()));
}

DenseResponse DenseResponse::transposed() const {
  DenseResponse other = *this;
  other.pencil_.reset();
  other.system_ = system_.transposed();
  for (std::size_t t = 0; t < terms_.size(); ++t)
    if (system_.terms[t].law.is_skew()) negate(other.terms_[t]);
  return other;
}

DenseResponse DenseResponse::at(const ParameterValues& values) const {
  DenseResponse other = *this;
  other.pencil_.reset();
  set_parameters(other.system_.terms, values);
  return other;
}

DenseResponse DenseResponse::to_rounding(double negligible) const {
  DenseResponse other = *this;
  other.pencil_.reset();
  other.system_.negligible = negligible;
  return other;
}

/// Modes of a system whose K and M are diagonal: exact.
void DenseResponse::take_diagonals() {
  std::vector<std::pair<double, int>> modes;
  for (int j = free_; j < system_.order(); ++j) {
    const double k = system_.K(j, j), m = system_.M(j, j);
    const bool massless = !(tau_ * m > 1e-14 * k);
    modes.emplace_back(massless ? std::numeric_limits<double>::infinity() : k / m, j);
  }
  std::stable_sort(modes.begin(), modes.end(),
                   [](const auto& a, const auto& b) { return a.first < b.first; });
  for (const auto& [lambda, j] : modes) {
    const double m = std::max(system_.M(j, j), 0.0), energy = system_.K(j, j) + tau_ * m;
    U_(j, static_cast<int>(lambda_.size())) = 1 / std::sqrt(energy);
    lambda_.push_back(lambda);
    mu_.push_back(m / energy);
  }
}

/// λ and μ with more digits, where it matters: resonances lie below ω² = 4τ. Terms and ports are
/// of the same u, whose energy is one but for rounding: so is μ, not 1/(λ + τ).
void DenseResponse::sharpen(int first) {
  for (int j = first; j < system_.order(); ++j) {
    const auto at = as_size(j);
    if (!(lambda_[at] < 64 * tau_)) break;
    const long double m = quadratic_form(system_.M, U_.column(j));
    lambda_[at] = static_cast<double>(quadratic_form(system_.K, U_.column(j)) / m);
    mu_[at] = static_cast<double>(m);
  }
}

DenseResponse::DenseResponse(DenseSystem system, double tau, Dense U,
                             std::vector<double> lambda, Dense B,
                             std::vector<Dense> terms)
    : system_(std::move(system)), tau_(tau), free_(free_coordinates(system_)),
      U_(std::move(U)), B_(std::move(B)), C_(B_), terms_(std::move(terms)),
      lambda_(std::move(lambda)) {
  for (double l : lambda_) mu_.push_back(1 / (l + tau_));
  if (terms_.empty())
    for (const auto& [law, T] : system_.terms)
      terms_.push_back(congruence(T, U_, law.symmetry()));
}

namespace {

/// QᵀKQ and QᵀMQ of diagonal K and M, summed in long double; nothing if they are not diagonal, or
/// too large for that.
std::optional<std::pair<Dense, Dense>> beside_the_diagonals(const DenseSystem& system,
                                                            const Dense& Q) {
  constexpr double most = 3e8; // products
  const double work = static_cast<double>(Q.rows) * Q.columns * Q.columns;
  if (work > most || !holds_a_diagonal(system.K) || !holds_a_diagonal(system.M))
    return std::nullopt;
  const int m = Q.columns;
  std::pair<Dense, Dense> left{Dense(m, m), Dense(m, m)};
  for (int j = 0; j < m; ++j)
    for (int i = 0; i <= j; ++i) {
      long double k = 0, mass = 0;
      for (int l = 0; l < Q.rows; ++l) {
        const long double both =
            static_cast<long double>(Q(l, i)) * static_cast<long double>(Q(l, j));
        k += both * static_cast<long double>(system.K(l, l));
        mass += both * static_cast<long double>(system.M(l, l));
      }
      left.first(i, j) = left.first(j, i) = static_cast<double>(k);
      left.second(i, j) = left.second(j, i) = static_cast<double>(mass);
    }
  return left;
}

} // namespace

DenseSystem::Modal DenseSystem::project_to_modes(const Dense& Q, double tau) const {
  const DenseResponse response(project(Q), tau);
  const int m = Q.columns, free = response.free();
  Modal modal{multiply(Q, response.U()), {}};
  Dense stiffness(m, m), mass(m, m);
  for (int j = 0; j < m; ++j) {
    double* q = modal.Q.column(j);
    if (j < free) {
      std::copy_n(Q.column(j), Q.rows, q);
      mass(j, j) = 1;
      continue;
    }
    // Of these numbers as they are: energies in modal coordinates hardly cancel.
    const long double k = quadratic_form(K, q), mu = quadratic_form(M, q);
    const bool massless = !(mu * static_cast<long double>(tau) > 1e-14L);
    const long double unit = massless ? 1 : 1 / std::sqrt(mu);
    for (int i = 0; i < Q.rows; ++i)
      q[i] = static_cast<double>(unit * static_cast<long double>(q[i]));
    stiffness(j, j) = static_cast<double>(massless ? k : k / mu);
    mass(j, j) = massless ? static_cast<double>(mu) : 1.0;
  }
  modal.system = project(modal.Q);
  if (const auto left = beside_the_diagonals(*this, modal.Q)) {
    const Dense Z = last_turn(left->first, left->second).Z;
    for (Dense* ports : {&modal.system.B, &modal.system.C})
      if (!ports->data.empty()) add_to(*ports, multiply_transposed(Z, *ports));
    for (auto& [law, turned] : modal.system.terms) {
      add_to(turned, multiply(turned, Z));
      add_to(turned, multiply_transposed(Z, turned));
    }
  }
  modal.system.K = std::move(stiffness);
  modal.system.M = std::move(mass);
  return modal;
}

std::complex<double> DenseResponse::diagonal(int i, double omega,
                                             double eta_added) const {
  const Damping& d = system_.damping;
  const auto at = as_size(i);
  const bool massless = !std::isfinite(lambda_[at]);
  const double mu = mu_[at], k = massless ? 1.0 : mu * lambda_[at];
  // λ − ω² loses digits at a resonance.
  using Long = long double;
  const auto difference =
      static_cast<double>(static_cast<Long>(lambda_[at]) -
                          static_cast<Long>(omega) * static_cast<Long>(omega));
  return {massless ? 1 - omega * omega * mu : mu * difference,
          k * (d.eta + eta_added) + omega * (k * d.beta + mu * d.alpha)};
}

std::vector<std::complex<double>> DenseResponse::diagonal(double omega,
                                                          double eta_added) const {
  std::vector<std::complex<double>> a;
  for (int i = 0; i < system_.order(); ++i) a.push_back(diagonal(i, omega, eta_added));
  return a;
}

double DenseResponse::rounding_of_difference(int i, double omega) const {
  constexpr double fine = std::numeric_limits<long double>::epsilon();
  const auto at = as_size(i);
  const double k = std::isfinite(lambda_[at]) ? std::abs(mu_[at] * lambda_[at]) : 1.0;
  return 2 * fine * (k + omega * omega * mu_[at]);
}

double DenseResponse::rounding_of_diagonal(int i, double omega) const {
  return 4 * std::numeric_limits<double>::epsilon() * std::abs(diagonal(i, omega)) +
         rounding_of_difference(i, omega);
}

bool DenseResponse::is_resonance(double omega) const {
  if (!is_diagonal()) return false;
  for (int i = 0; i < system_.order(); ++i)
    if (!(std::abs(diagonal(i, omega)) > 2 * rounding_of_diagonal(i, omega))) return true;
  return false;
}

const PencilModes* DenseResponse::pencil() const {
  if (!pencil_)
    pencil_ = std::make_shared<const std::optional<PencilModes>>(PencilModes::of(*this));
  return *pencil_ ? &**pencil_ : nullptr;
}

ComplexDense DenseResponse::modal_response(double omega, double eta_added) const {
  const ShiftCoefficients c = system_.coefficients(omega);
  const int N = system_.order();
  const auto a = diagonal(omega, eta_added);
  ComplexDense x(N, B_.columns);
  for (std::size_t i = 0; i < x.data.size(); ++i) x.data[i] = B_.data[i];
  if (is_diagonal()) {
    for (int i = 0; i < N; ++i) {
      if (a[as_size(i)] == 0.0)
        throw ShiftError("the body is undamped and the frequency is a resonance");
      const auto inverse = 1.0 / a[as_size(i)];
      for (int j = 0; j < x.columns; ++j) x(i, j) *= inverse;
    }
    return x;
  }
  ComplexDense A(N, N);
  add_terms(A, c.terms, terms_);
  for (int i = 0; i < N; ++i) A(i, i) += a[as_size(i)];
  return solve(std::move(A), std::move(x));
}

ComplexDense DenseResponse::transfer(const ComplexDense& modal_response) const {
  return multiply_transposed(C_, modal_response);
}

void add_terms(ComplexDense& A, const std::vector<std::complex<double>>& g,
               const std::vector<Dense>& T) {
  for (std::size_t t = 0; t < T.size(); ++t)
    for (std::size_t i = 0; i < A.data.size(); ++i) A.data[i] += g[t] * T[t].data[i];
}

} // namespace flexgram
