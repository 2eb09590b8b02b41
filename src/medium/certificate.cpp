#include "medium/certificate.hpp"

#include "base/index.hpp"
#include "linalg/decompositions.hpp"

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>

namespace flexgram {
namespace {

constexpr double infinity = std::numeric_limits<double>::infinity();

} // namespace

Certificate::Certificate(const MediumSpace& space, const DenseResponse& response,
                         const ResidualBasis& basis, const ResidualNorm& norm,
                         ProjectionRounding rounding, int modes, bool inertia_is_safe,
                         double cutoff, const Softening& softening,
                         std::vector<double> scale)
    : rounding_(std::move(rounding)), softening_(softening),
      data_rounding_(space.data_rounding()), provable_(basis.complete && inertia_is_safe),
      whole_(space.columns() >= space.fom().n),
      scale_(std::move(scale)), shifts_{space.tau(), cutoff * cutoff, space.kappa()} {
  // Coordinates in which the Gram matrix is the identity.
  const GramFactor factor = gram_factor(norm.gram);
  for (double root : factor.roots) gram_.each.push_back(1 / root);
  gram_.added = norm.added + factor.added;
  const auto turned = [&](const Dense& a) {
    return a.rows == 0 ? Dense(0, a.columns) : multiply(factor.F, a);
  };
  parts_.ports = turned(basis.ports);
  const Dense K = turned(basis.K);
  parts_.K = transpose(K);
  for (const Dense& T : basis.terms) parts_.terms.push_back(transpose(turned(T)));
  const auto in_norm = [&](std::vector<double> lost) {
    for (double& x : lost) x *= norm.of_rounding;
    return lost;
  };
  parts_.dropped_ports = in_norm(basis.dropped_ports);
  parts_.dropped_K = in_norm(basis.dropped_K);
  for (const auto& dropped : basis.dropped_terms)
    parts_.dropped_terms.push_back(in_norm(dropped));

  const Dense& U = response.U();
  for (int j = 0; j < modes; ++j) {
    const auto at = as_size(j);
    double square = 0;
    for (int i = 0; i < K.rows; ++i) square += K(i, j) * K(i, j);
    const double mu = response.mu()[at], e = response.energy(j, shifts_.sigma);
    ritz_.mu.push_back(mu);
    ritz_.G_norm.push_back(std::abs(residual_factor(mu, shifts_.tau, shifts_.kappa) / e) *
                           (std::sqrt(square) + parts_.dropped_K[at]));
    provable_ = provable_ && e < 0;
  }
  for (int i = modes; i < U.columns; ++i)
    provable_ = provable_ && response.energy(i, shifts_.sigma) > 0;
  enclose_modes();
  // With parameters, other vectors couple with each of their values: `at` finds them.
  if (!basis.terms.empty() && provable_ &&
      parameters_of(response.system().terms).empty()) {
    std::vector<Dense> outside;
    for (const Dense& T : basis.terms_outside) outside.push_back(turned(T));
    couple_terms(response, K, outside);
  }

  if (space.rigid() > 0) {
    rigid_.rows = transpose(part_of(U, 0, space.rigid(), 0, U.columns));
    rigid_.stiffness = transpose(multiply(space.rigid_stiffness(), U));
    for (Dense* a : {&rigid_.rows, &rigid_.stiffness})
      for (double& x : a->data) x = std::abs(x);
  }
  const auto& weights = space.rounding_weights();
  for (int j = 0; j < U.columns; ++j) {
    double square = 0;
    for (int i = space.rigid(); i < U.rows; ++i)
      square += std::pow(U(i, j) * weights[as_size(i)], 2);
    rounding_weights_.push_back(std::sqrt(square));
  }
}

/// What Φ leaves of its own equation in the norm of (K + τM)⁻¹, in which frequencies are
/// enclosed, and μ₊. On the complement of Φ, by Schur, K + τM >= (1 − θ)(K − ω_c²M) with
/// θ = (ω_c² + τ)² Σ‖G_j‖², so ‖r‖² in the one norm is ‖r‖²/(1 − θ) in the other at most.
void Certificate::enclose_modes() {
  double theta = 0;
  for (double g : ritz_.G_norm) theta += std::pow((shifts_.sigma + shifts_.tau) * g, 2);
  shifts_.enlarged = theta < 1 ? 1 / std::sqrt(1 - theta) : infinity;
  const double mu_c = 1 / (shifts_.sigma + shifts_.tau);
  shifts_.mu_plus = mu_c;
  for (std::size_t j = 0; j < ritz_.mu.size(); ++j) {
    const double mu = ritz_.mu[j],
                 g = ritz_.G_norm[j] * std::abs(1 - (shifts_.sigma + shifts_.tau) * mu);
    ritz_.residual.push_back(g > 0 ? g * shifts_.enlarged : 0.0);
    shifts_.mu_plus += mu > mu_c
                           ? ritz_.residual.back() * ritz_.residual.back() / (mu - mu_c)
                           : infinity;
  }
}

bool Certificate::fits(int order, int ports, int modes, int rigid,
                       std::size_t terms) const {
  const auto is = [](const Dense& a, int rows, int columns) {
    return a.rows == rows && a.columns == columns;
  };
  const auto holds = [](const std::vector<double>& v, int count) {
    return v.size() == as_size(count);
  };
  const int span = parts_.ports.rows;
  const auto of_terms = [&] {
    if (parts_.terms.size() != terms || parts_.dropped_terms.size() != terms)
      return false;
    for (std::size_t t = 0; t < terms; ++t)
      if (!is(parts_.terms[t], order, span) || !holds(parts_.dropped_terms[t], order))
        return false;
    return true;
  };
  return holds(scale_, ports) && holds(rounding_weights_, order) &&
         rounding_.fits(order, ports, terms) && is(parts_.ports, span, ports) &&
         is(parts_.K, order, span) && of_terms() && holds(gram_.each, span) &&
         holds(parts_.dropped_ports, ports) && holds(parts_.dropped_K, order) &&
         holds(ritz_.mu, modes) && holds(ritz_.residual, modes) &&
         holds(ritz_.G_norm, modes) &&
         (rigid == 0 ||
          (is(rigid_.rows, order, rigid) && is(rigid_.stiffness, order, rigid)));
}

Certificate Certificate::at(const DenseResponse& response) const {
  Certificate other = *this;
  if (!provable_ || whole_) return other;
  const double sigma = shifts_.sigma;
  const Dense K = transpose(parts_.K);
  std::vector<Dense> outside; // what T U has beyond E V
  for (std::size_t t = 0; t < parts_.terms.size(); ++t) {
    Dense inside = response.modal_terms()[t];
    for (int j = 0; j < inside.columns; ++j)
      for (int i = 0; i < inside.rows; ++i)
        inside(i, j) *= -(1 + shifts_.kappa * sigma) / response.energy(i, sigma);
    outside.push_back(transpose(parts_.terms[t]));
    add_to(outside.back(), multiply(K, inside));
  }
  other.couple_terms(response, K, outside);
  return other;
}

void Certificate::couple_terms(const DenseResponse& response, const Dense& K,
                               const std::vector<Dense>& outside) {
  by_terms_ = TermCoupling(
      response, {K, outside, parts_.dropped_K, parts_.dropped_terms, shifts_.kappa},
      static_cast<int>(ritz_.mu.size()), shifts_.sigma);
}

double Certificate::worst_angle() const {
  double worst = 0;
  for (std::size_t j = 0; j < ritz_.mu.size(); ++j)
    worst = std::max(worst,
                     ritz_.residual[j] / std::max(ritz_.mu[j] - shifts_.mu_plus, 1e-300));
  return worst;
}

/// For x > μ₊ the eigenvalues of T above x are, by Haynsworth's formula, at most as many
/// as the positive ones of diag(μ_j − x) + GᵀG/(x − μ₊), and GᵀG <= N diag(‖G_j‖²).
Certificate::Modes Certificate::modes() const {
  Modes modes{ritz_.mu, {}, ritz_.residual, shifts_.mu_plus};
  const auto count = static_cast<double>(ritz_.mu.size());
  for (std::size_t j = 0; j < ritz_.mu.size(); ++j)
    modes.largest_mu.push_back(
        std::max(shifts_.mu_plus,
                 ritz_.mu[j] + count * ritz_.residual[j] * ritz_.residual[j] /
                                   std::max(ritz_.mu[j] - shifts_.mu_plus, 1e-300)));
  std::sort(modes.largest_mu.begin(), modes.largest_mu.end(), std::greater<>());
  return modes;
}

std::vector<double> Certificate::outside(const DenseResponse& response) const {
  const double factor = 1 - shifts_.kappa * shifts_.tau; // a_k = 1, a_m = τ
  const Dense& x = response.modal_inputs();
  const Dense held = multiply_transposed(parts_.K, x);
  std::vector<double> norms;
  for (int j = 0; j < x.columns; ++j) {
    const auto at = as_size(j);
    double square = 0, lost = parts_.dropped_ports[at];
    for (int i = 0; i < parts_.ports.rows; ++i)
      square += std::pow(parts_.ports(i, j) - factor * held(i, j), 2);
    for (int l = 0; l < x.rows; ++l)
      lost += factor * std::abs(x(l, j)) * parts_.dropped_K[as_size(l)];
    const double norm = std::sqrt(square) + lost;
    norms.push_back(norm > 0 ? shifts_.enlarged * norm / scale_[at] : 0.0);
  }
  return norms;
}

} // namespace flexgram
