/// What a certified medium model says of itself. See medium.hpp; it is made by certify.cpp.

#include "medium/medium.hpp"

#include "base/index.hpp"
#include "base/text.hpp"

#include <algorithm>
#include <cmath>

namespace flexgram {

std::vector<Resonance> poles_below(const DenseResponse& response, double cutoff) {
  const bool lossless = response.system().is_lossless();
  std::vector<Resonance> found;
  for (const auto& pole : poles(response))
    if (pole.real() > 0 && pole.real() < cutoff && pole.imag() < pole.real())
      found.push_back({pole.real(), lossless ? 0.0 : std::max(pole.imag(), 0.0)});
  return found;
}

std::string Medium::claim() const {
  const MediumLevel* last = levels.empty() ? nullptr : &levels.back();
  if (shortfall.empty() && last && last->proved)
    return text("certified to %.0e%s", spec.target,
                has_sharp_resonances() ? " but beside undamped resonances" : "");
  const double worst = last ? last->worst : HUGE_VAL;
  return text("%.1e at the frequencies it grew by, target %.0e not reached: %s", worst,
              spec.target, shortfall.empty() ? "not proved" : shortfall.c_str());
}

bool Medium::has_sharp_resonances() const {
  const auto peaks = resonances(levels.back());
  return std::any_of(peaks.begin(), peaks.end(),
                     [](const Resonance& r) { return r.sharp(); });
}

std::vector<Resonance> Medium::resonances(const MediumLevel& level) const {
  const DenseResponse& of_K = *level.response;
  std::vector<Resonance> result;
  // Parameters move modes far: those of the body with their values.
  std::optional<DenseResponse> stiff;
  if (!parameters_of(of_K.system().terms).empty()) stiff.emplace(of_K.stiffened());
  const DenseResponse& response = stiff ? *stiff : of_K;
  if (!is_symmetric(response.system().terms)) return poles_below(response, cutoff);

  for (int j = rigid; j < rigid + modes; ++j) {
    const double l = std::max(response.lambda()[as_size(j)], 0.0);
    double omega = std::sqrt(l), stiffer = l;
    for (std::size_t t = 0; t < response.modal_terms().size(); ++t)
      stiffer += response.modal_terms()[t](j, j) / response.mu()[as_size(j)] *
                 response.system().terms[t].law.at(omega).real();
    omega = std::sqrt(std::max(stiffer, 0.0));
    double d = body.damping.alpha + body.damping.beta * l + body.damping.eta * omega;
    for (std::size_t t = 0; t < response.modal_terms().size(); ++t)
      d += response.modal_terms()[t](j, j) / response.mu()[as_size(j)] *
           response.system().terms[t].law.as_damper(omega);
    result.push_back({omega, 0.5 * d});
  }
  return result;
}

NaturalFrequencies natural_frequencies(const Medium& medium) {
  const MediumLevel& level = medium.levels.back();
  const Certificate::Modes modes = level.certificate->modes();
  NaturalFrequencies result;
  for (int k = medium.rigid; k < medium.rigid + medium.modes; ++k) {
    const auto at = as_size(k);
    const double lambda = std::max(level.response->lambda()[at], 0.0),
                 least = std::max(1 / modes.largest_mu[at] - medium.tau, 0.0),
                 rounding = level.certificate->rounding_of_mode(at) *
                            (lambda + medium.tau) / std::max(lambda, 1e-300);
    result.omega.push_back(std::sqrt(lambda));
    result.error.push_back(1 - std::sqrt(least / std::max(lambda, 1e-300)) +
                           0.5 * rounding + 1e-15);
  }
  return result;
}

double negligible_rounding(double target) {
  if (!(1e-3 * target > DenseSystem::finest)) return DenseSystem::finest;
  return std::pow(10, std::floor(std::log10(1e-3 * target) + 1e-9));
}

RelativeTo resolved(RelativeTo asked, const Medium& medium) {
  const bool has_elastic_part =
      medium.rigid > 0 && medium.levels.back().response->is_diagonal();
  return asked == RelativeTo::both && !has_elastic_part ? RelativeTo::pointwise : asked;
}

void refuse_statics_of_a_free_body(double first) {
  if (first == 0)
    throw Error(
        "the band starts at 0 Hz, where a free body has no finite response: "
        "{band_hz} must start above (slow loads on a body in joints: {statics} yes "
        "and {tol_relative_to} elastic)");
}

} // namespace flexgram
