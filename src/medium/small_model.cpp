#include "medium/small_model.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

namespace flexgram {
namespace {

/// Whether rounding does not count, beside a norm or what is negligible.
bool is_small(double rounding, double norm, double negligible) {
  return rounding <= 0.2 * norm || rounding <= negligible;
}
bool is_clear(const TermNorms& difference, double negligible) {
  const auto& at = difference.norms.at;
  return is_small(difference.rounding, *std::max_element(at.begin(), at.end()),
                  negligible);
}

} // namespace

SmallModel::SmallModel(const DenseSystem& system, const MediumModel& medium)
    : medium_(medium), response_(system, medium.tau), numbers_(ModalNumbers::of(system)),
      apart_(shares_rigid_modes(system) ? medium.apart() : 0) {
  for (std::size_t v = 0; medium.has_many_ports() && v < medium.views.size(); ++v)
    terms_.push_back(medium.terms_of_difference(v, response_));
}

/// Whether the rigid modes come first in both, exactly alike.
bool SmallModel::shares_rigid_modes(const DenseSystem& system) const {
  const int rigid = medium_.apart();
  if (response_.free() < rigid) return false;
  const auto same = [&](const Dense& a, const Dense& b) {
    return part_of(a, 0, rigid, 0, a.columns).data ==
           part_of(b, 0, rigid, 0, b.columns).data;
  };
  return same(system.B, medium_.system.B) &&
         (system.outputs_are_inputs || same(system.C, medium_.system.C));
}

/// H_r of what is not the same in both.
ComplexDense SmallModel::transfer(double omega) const {
  ComplexDense x = response_.modal_response(omega);
  for (int j = 0; j < x.columns; ++j) std::fill_n(x.column(j), apart_, 0.0);
  return response_.transfer(x);
}

/// Of the terms of H − H_r. Nothing where a pole of the small model is too near.
std::optional<MatrixSeries> SmallModel::factors_of_difference(const TransferSeries& H,
                                                              Interval interval,
                                                              int degree) const {
  auto factors = modal_factors(response_, interval, degree);
  if (!factors) return std::nullopt;
  for (double& x : factors->x.coefficients.data) x = -x;
  if (apart_ == medium_.apart())
    return stacked(H.factors, from_row(std::move(factors->x), apart_));
  const auto all = medium_.factors(interval, degree);
  if (!all) return std::nullopt;
  return stacked(*all, factors->x);
}

std::optional<std::vector<ViewNorms>>
SmallModel::differences(const TransferSeries& H, Interval interval, int degree,
                        const std::vector<double>& negligible) const {
  std::vector<ViewNorms> result;
  if (H.has_many_ports()) {
    const auto factors = factors_of_difference(H, interval, degree);
    if (!factors) return std::nullopt;
    bool clear = true;
    for (std::size_t v = 0; v < terms_.size(); ++v) {
      const TermNorms difference = term_norms(terms_[v], *factors);
      clear = clear && is_clear(difference, negligible[v]);
      result.push_back(difference.norms);
    }
    if (clear) return result;
    result.clear();
  }
  const auto series = response_series(response_, interval, degree);
  if (!series) return std::nullopt;
  const auto away = [&](const MatrixSeries& of_medium, const ModalNumbers* numbers) {
    const MatrixSeries H_r =
        transfer_series(response_.modal_outputs(), *series, apart_, numbers, H.size);
    return scale_outputs(medium_.outputs(), interval, difference_of(of_medium, H_r));
  };
  const bool known = !H.has_many_ports() && apart_ == medium_.apart();
  const auto again = [&] { return medium_.entries(interval, degree, apart_).value(); };
  const ModalNumbers* numbers = numbers_ ? &*numbers_ : nullptr;
  MatrixSeries difference;
  if (medium_.system.terms.empty()) {
    difference = away(known ? H.entries : again(), numbers);
  } else { // more digits are dense solves in long double, for both
    difference = away(H.entries, nullptr);
    bool clear = true;
    for (std::size_t v = 0; v < medium_.views.size(); ++v) {
      const PortView& view = medium_.views[v];
      clear = clear && is_small(tail_of(difference, view), size_of(difference, view),
                                negligible[v]);
    }
    if (!clear) difference = away(again(), numbers);
  }
  for (const PortView& view : medium_.views)
    result.push_back(view_norms(difference, view));
  return result;
}

/// ‖H − H_r‖ of each view, from CᵀX of both.
std::vector<double> SmallModel::between(const ComplexDense& H, const ComplexDense& H_r,
                                        double omega) const {
  ComplexDense difference = H;
  for (std::size_t k = 0; k < H.data.size(); ++k) difference.data[k] -= H_r.data[k];
  medium_.outputs().scale(difference, omega);
  std::vector<double> result;
  for (const PortView& view : medium_.views) {
    double sum = 0;
    for (int j : view.columns)
      for (int i : view.rows) sum += std::norm(difference(i, j));
    result.push_back(std::sqrt(sum));
  }
  return result;
}

std::vector<std::vector<double>>
SmallModel::distances(const std::vector<Sample>& samples) const {
  std::vector<std::vector<double>> result;
  if (terms_.empty()) {
    for (const Sample& sample : samples)
      result.push_back(between(apart_ == medium_.apart()
                                   ? sample.H->entries.centre()
                                   : medium_.transfer(sample.omega, apart_),
                               transfer(sample.omega), sample.omega));
    return result;
  }
  const double none = std::numeric_limits<double>::infinity();
  result.assign(samples.size(), std::vector<double>(terms_.size(), none));
  std::vector<std::size_t> which; // those that are no resonance
  std::vector<MatrixSeries> factors;
  for (std::size_t s = 0; s < samples.size(); ++s)
    if (auto all = factors_of_difference(*samples[s].H,
                                         {samples[s].omega, samples[s].omega}, 0)) {
      which.push_back(s);
      factors.push_back(std::move(*all));
    }
  std::vector<char> clear(which.size(), 1);
  for (std::size_t v = 0; v < terms_.size(); ++v) {
    const std::vector<TermNorms> norms = term_norms(terms_[v], factors);
    for (std::size_t k = 0; k < which.size(); ++k) {
      const std::size_t s = which[k];
      result[s][v] = norms[k].norms.above[0];
      if (!is_clear(norms[k], samples[s].negligible[v])) clear[k] = 0;
    }
  }
  for (std::size_t k = 0; k < which.size(); ++k)
    if (!clear[k]) {
      const double omega = samples[which[k]].omega;
      result[which[k]] = between(medium_.transfer(omega, apart_), transfer(omega), omega);
    }
  return result;
}

} // namespace flexgram
