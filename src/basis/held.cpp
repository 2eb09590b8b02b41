#include "basis/held.hpp"

#include "base/index.hpp"
#include "base/text.hpp"
#include "linalg/decompositions.hpp"
#include "model/port_views.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

namespace flexgram {
namespace {

constexpr double infinity = std::numeric_limits<double>::infinity();

struct HeldBody {
  bool moves = false;        ///< some rigid motion is left
  std::vector<double> omega; ///< [rad/s] ascending, up to the last that was asked for
  std::vector<double> compliance; ///< of each port bᵀK⁻¹b; 0 of those that are held
};

/// The undamped body with bᵀq = 0 for some ports b. In the coordinates of U, K + τM is the
/// identity and M is diag(μ): on the complement of the b's, eigenvalues 1/(ω² + τ) of diag(μ).
HeldBody held_body(const DenseResponse& response, const std::vector<int>& ports,
                   double last) {
  constexpr double no_motion = 1e-8; // of a port, beside what its name promises
  const double tau = response.tau();
  const Dense& B = response.modal_inputs();
  const int N = B.rows;
  Dense loads = columns_of(B, ports);
  for (int j = 0; j < loads.columns; ++j) {
    double square = 0;
    for (int i = 0; i < N; ++i) square += loads(i, j) * loads(i, j);
    for (int i = 0; square > 0 && i < N; ++i) loads(i, j) /= std::sqrt(square);
  }
  const LeftSvd svd = left_svd(loads);
  int rank = 0;
  while (rank < static_cast<int>(svd.values.size()) &&
         svd.values[as_size(rank)] > no_motion * svd.values.front())
    ++rank;
  const Dense Q = first_columns(svd.vectors, rank);
  // P diag(μ) P − QQᵀ: the held directions have the eigenvalue −1, all others none below 0.
  Dense a(N, N);
  for (int i = 0; i < N; ++i) a(i, i) = response.mu()[as_size(i)] * tau;
  const Dense MQ = multiply(a, Q), QMQ = multiply_transposed(Q, MQ);
  const Dense Qt = transpose(Q), left = multiply(MQ, Qt),
              both = multiply(Q, multiply(QMQ, Qt)), held = multiply(Q, Qt);
  for (int j = 0; j < N; ++j)
    for (int i = 0; i < N; ++i)
      a(i, j) += both(i, j) - left(i, j) - left(j, i) - held(i, j);
  symmetrise(a);
  const SymmetricEigen eigen = symmetric_eigen(std::move(a));
  HeldBody body;
  const Dense parts = multiply_transposed(eigen.vectors, B);
  body.compliance.assign(as_size(B.columns), 0.0);
  for (int i = N; i-- > 0;) {
    const double mu = eigen.values[as_size(i)]; // τ times
    if (mu < -0.5) break;
    const double stiffness = 1 - mu;
    if (!(stiffness > 1e-9)) {
      body.moves = true;
      return body;
    }
    const double omega = mu > 0 ? std::sqrt(tau * stiffness / mu) : infinity;
    if (omega <= last) body.omega.push_back(omega);
    for (int j = 0; j < B.columns; ++j)
      body.compliance[as_size(j)] += parts(i, j) * parts(i, j) / stiffness;
  }
  for (int j : ports) body.compliance[as_size(j)] = 0;
  return body;
}

} // namespace

std::vector<HeldInterface> held_interfaces(const MediumModel& medium,
                                           const DenseSystem& small, double last) {
  constexpr double affordable = 4e9; // operations
  std::vector<HeldInterface> all;
  if (medium.rigid == 0 || !parameters_of(medium.system.terms).empty()) return all;
  const auto interfaces = interfaces_of(medium.names.inputs);
  const DenseResponse whole(medium.system, medium.tau), part(small, medium.tau);
  const double each = 20 * std::pow(medium.system.order(), 3);
  double spent = 0;
  for (const auto& [name, ports] : interfaces) {
    if (spent > 0 && spent + each > affordable) break;
    spent += each;
    const HeldBody reference = held_body(whole, ports, last);
    if (reference.moves) continue;
    const HeldBody found = held_body(part, ports, 2 * last);
    HeldInterface held{name, {}, std::nullopt, ""};
    for (std::size_t k = 0; k < reference.omega.size(); ++k)
      held.omega.push_back(
          {k < found.omega.size() ? found.omega[k] : infinity, reference.omega[k]});
    for (const auto& [other, of_other] : interfaces)
      for (int j : of_other) {
        const double known = reference.compliance[as_size(j)];
        if (!(known > 0)) continue;
        const double error =
            found.moves ? infinity : std::abs(found.compliance[as_size(j)] / known - 1);
        if (held.compliance && *held.compliance >= error) continue;
        held.compliance = error;
        held.port = medium.names.inputs[as_size(j)];
      }
    all.push_back(std::move(held));
  }
  return all;
}

double HeldInterface::frequency_error() const {
  double worst = 0;
  for (const auto& [here, reference] : omega)
    worst = std::max(worst, std::abs(here / reference - 1));
  return worst;
}

std::string held_words(const std::vector<HeldInterface>& held) {
  constexpr std::size_t most = 3;
  std::string words;
  for (std::size_t k = 0; k < std::min(most, held.size()); ++k) {
    const HeldInterface& h = held[k];
    words += text("%sat %s: ", words.empty() ? "" : "; ", h.interface.c_str());
    if (h.omega.empty()) {
      words += "no frequency in the band";
    } else {
      std::vector<std::string> here, reference;
      for (std::size_t i = 0; i < std::min(most, h.omega.size()); ++i) {
        const auto [own, full] = h.omega[i];
        here.push_back(std::isfinite(own) ? text("%.5g", own * hz) : "none");
        reference.push_back(text("%.5g", full * hz));
      }
      const char* const more = h.omega.size() > most ? ", … Hz" : " Hz";
      words += join(reference, ", ") + more;
      words += h.frequency_error() < 0.05
                   ? text(" (relative error %.1e)", h.frequency_error())
                   : " come out as " + join(here, ", ") + more;
    }
    if (h.compliance)
      words += text(", static compliance to %.1e (%s)", *h.compliance, h.port.c_str());
  }
  if (held.size() > most) words += text("; %zu more in the file", held.size() - most);
  return words;
}

} // namespace flexgram
