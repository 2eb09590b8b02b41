#include "medium/small_model.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

namespace flexgram {

SmallModel::SmallModel(const DenseSystem& system, const MediumModel& medium)
    : medium_(medium), response_(system, medium.tau) {
  for (std::size_t v = 0; medium.has_many_ports() && v < medium.views.size(); ++v)
    terms_.push_back(medium.terms_of_difference(v, response_));
}

std::optional<std::vector<ViewNorms>>
SmallModel::differences(const TransferSeries& H, Interval interval, int degree,
                        const std::vector<double>& negligible) const {
  std::vector<ViewNorms> result;
  if (H.has_many_ports()) {
    auto factors = modal_factors(response_, interval, degree);
    if (!factors) return std::nullopt;
    for (double& x : factors->x.coefficients.data) x = -x;
    const MatrixSeries all = stacked(H.factors, factors->x);
    bool clear = true;
    for (std::size_t v = 0; v < terms_.size(); ++v) {
      const TermNorms difference = term_norms(terms_[v], all);
      const auto& at = difference.norms.at;
      clear = clear &&
              (difference.rounding <= 0.2 * *std::max_element(at.begin(), at.end()) ||
               difference.rounding <= negligible[v]);
      result.push_back(difference.norms);
    }
    if (clear) return result;
    result.clear();
  }
  const auto series = response_series(response_, interval, degree);
  if (!series) return std::nullopt;
  const MatrixSeries H_r = multiply_transposed(response_.modal_outputs(), series->x);
  const MatrixSeries difference = difference_of(
      H.has_many_ports() ? medium_.entries(interval, degree).value() : H.entries, H_r);
  for (const PortView& view : medium_.views)
    result.push_back(view_norms(difference, view));
  return result;
}

std::vector<double> SmallModel::distances(const TransferSeries& H, double omega,
                                          const std::vector<double>& negligible) const {
  std::vector<double> result;
  if (H.has_many_ports()) {
    const auto norms = differences(H, {omega, omega}, 0, negligible);
    for (std::size_t v = 0; v < medium_.views.size(); ++v)
      result.push_back(norms ? (*norms)[v].above[0]
                             : std::numeric_limits<double>::infinity());
    return result;
  }
  const ComplexDense H_r = response_.transfer(omega);
  const double *re = H.entries.real(0), *im = H.entries.imaginary(0);
  for (const PortView& view : medium_.views) {
    double sum = 0;
    for (int j : view.columns)
      for (int i : view.rows) {
        const auto at = static_cast<std::size_t>(i) +
                        static_cast<std::size_t>(j) * static_cast<std::size_t>(H_r.rows);
        sum += std::norm(std::complex<double>(re[at], im[at]) - H_r.data[at]);
      }
    result.push_back(std::sqrt(sum));
  }
  return result;
}

} // namespace flexgram
