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
                         double cutoff, std::vector<double> scale)
    : rounding_(std::move(rounding)), tau_(space.tau()), sigma_(cutoff * cutoff),
      kappa_(space.kappa()), data_rounding_(space.data_rounding()),
      provable_(basis.complete && inertia_is_safe), scale_(std::move(scale)) {
  // Coordinates in which the Gram matrix is the identity.
  const GramFactor factor = gram_factor(norm.gram);
  for (double root : factor.roots) coordinates_.push_back(1 / root);
  added_ = norm.added + factor.added;
  const auto turned = [&](const Dense& a) {
    return a.rows == 0 ? Dense(0, a.columns) : multiply(factor.F, a);
  };
  ports_ = turned(basis.ports);
  const Dense K = turned(basis.K);
  K_ = transpose(K);
  if (response.system().has_extra_damping()) D_ = transpose(turned(basis.D));
  const auto in_norm = [&](std::vector<double> lost) {
    for (double& x : lost) x *= norm.of_rounding;
    return lost;
  };
  dropped_ports_ = in_norm(basis.dropped_ports);
  dropped_K_ = in_norm(basis.dropped_K);
  dropped_D_ = in_norm(basis.dropped_D);

  const Dense& U = response.U();
  for (int j = 0; j < modes; ++j) {
    const auto at = as_size(j);
    double square = 0;
    for (int i = 0; i < K.rows; ++i) square += K(i, j) * K(i, j);
    const double mu = response.mu()[at], e = response.energy(j, sigma_);
    mode_mu_.push_back(mu);
    mode_G_norm_.push_back(std::abs(residual_factor(mu, tau_, kappa_) / e) *
                           (std::sqrt(square) + dropped_K_[at]));
    provable_ = provable_ && e < 0;
  }
  for (int i = modes; i < U.columns; ++i)
    provable_ = provable_ && response.energy(i, sigma_) > 0;
  enclose_modes();
  if (response.system().has_extra_damping() && provable_)
    by_damping_ = DampingCoupling(
        response, {K, turned(basis.damped_outside), dropped_K_, dropped_D_}, modes,
        sigma_, kappa_);

  if (space.rigid() > 0) {
    rigid_ = transpose(part_of(U, 0, space.rigid(), 0, U.columns));
    rigid_stiffness_ = transpose(multiply(space.rigid_stiffness(), U));
    for (Dense* a : {&rigid_, &rigid_stiffness_})
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
  for (double g : mode_G_norm_) theta += std::pow((sigma_ + tau_) * g, 2);
  enlarged_ = theta < 1 ? 1 / std::sqrt(1 - theta) : infinity;
  const double mu_c = 1 / (sigma_ + tau_);
  mu_plus_ = mu_c;
  for (std::size_t j = 0; j < mode_mu_.size(); ++j) {
    const double mu = mode_mu_[j],
                 g = mode_G_norm_[j] * std::abs(1 - (sigma_ + tau_) * mu);
    mode_residual_.push_back(g > 0 ? g * enlarged_ : 0.0);
    mu_plus_ += mu > mu_c ? mode_residual_.back() * mode_residual_.back() / (mu - mu_c)
                          : infinity;
  }
}

bool Certificate::fits(int order, int ports, int modes, int rigid, bool damped) const {
  const auto is = [](const Dense& a, int rows, int columns) {
    return a.rows == rows && a.columns == columns;
  };
  const auto holds = [](const std::vector<double>& v, int count) {
    return v.size() == as_size(count);
  };
  const int span = ports_.rows;
  return holds(scale_, ports) && holds(rounding_weights_, order) &&
         rounding_.fits(order, ports) && is(ports_, span, ports) && is(K_, order, span) &&
         (!damped || is(D_, order, span)) && holds(coordinates_, span) &&
         holds(dropped_ports_, ports) && holds(dropped_K_, order) &&
         (!damped || holds(dropped_D_, order)) && holds(mode_mu_, modes) &&
         holds(mode_residual_, modes) && holds(mode_G_norm_, modes) &&
         (!damped || !provable_ ||
          (by_damping_.fits() && modes <= by_damping_.count() &&
           by_damping_.count() <= order)) &&
         (rigid == 0 || (is(rigid_, order, rigid) && is(rigid_stiffness_, order, rigid)));
}

double Certificate::worst_angle() const {
  double worst = 0;
  for (std::size_t j = 0; j < mode_mu_.size(); ++j)
    worst = std::max(worst, mode_residual_[j] / std::max(mode_mu_[j] - mu_plus_, 1e-300));
  return worst;
}

/// For x > μ₊ the eigenvalues of T above x are, by Haynsworth's formula, at most as many
/// as the positive ones of diag(μ_j − x) + GᵀG/(x − μ₊), and GᵀG <= N diag(‖G_j‖²).
Certificate::Modes Certificate::modes() const {
  Modes modes{mode_mu_, {}, mode_residual_, mu_plus_};
  const auto count = static_cast<double>(mode_mu_.size());
  for (std::size_t j = 0; j < mode_mu_.size(); ++j)
    modes.largest_mu.push_back(
        std::max(mu_plus_, mode_mu_[j] + count * mode_residual_[j] * mode_residual_[j] /
                                             std::max(mode_mu_[j] - mu_plus_, 1e-300)));
  std::sort(modes.largest_mu.begin(), modes.largest_mu.end(), std::greater<>());
  return modes;
}

std::vector<double> Certificate::outside(const DenseResponse& response) const {
  const double factor = 1 - kappa_ * tau_; // a_k = 1, a_m = τ
  const Dense& x = response.modal_inputs();
  const Dense held = multiply_transposed(K_, x);
  std::vector<double> norms;
  for (int j = 0; j < x.columns; ++j) {
    const auto at = as_size(j);
    double square = 0, lost = dropped_ports_[at];
    for (int i = 0; i < ports_.rows; ++i)
      square += std::pow(ports_(i, j) - factor * held(i, j), 2);
    for (int l = 0; l < x.rows; ++l)
      lost += factor * std::abs(x(l, j)) * dropped_K_[as_size(l)];
    const double norm = std::sqrt(square) + lost;
    norms.push_back(norm > 0 ? enlarged_ * norm / scale_[at] : 0.0);
  }
  return norms;
}

} // namespace flexgram
