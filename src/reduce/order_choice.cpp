#include "reduce/order_choice.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

namespace flexgram {

namespace {
/// A factorisation of the full body tells H to no more digits than this.
constexpr double solve_floor = 1e-11;
} // namespace

ErrorOverBand::ErrorOverBand(const MediumModel& medium, std::vector<double> grid)
    : tau_(medium.tau), omega_(std::move(grid)) {
  for (double omega : omega_) {
    MediumModel::Value value = medium.at(omega);
    size_.push_back(frobenius_norm(value.H));
    value.bound.floor += solve_floor * size_.back();
    medium_bound_.push_back(value.bound.error + value.bound.floor);
    floor_.push_back(value.bound.floor / size_.back());
    H_.push_back(std::move(value.H));
  }
}

double ErrorOverBand::certified(std::size_t l, double difference) const {
  const double size = size_[l] - medium_bound_[l];
  return size > 0 ? (difference + medium_bound_[l]) / size
                  : std::numeric_limits<double>::infinity();
}

double ErrorOverBand::least() const {
  double least = 0;
  for (std::size_t l = 0; l < omega_.size(); ++l)
    least = std::max(least, certified(l, 0));
  return least;
}

namespace {
double distance(const ComplexDense& a, const ComplexDense& b) {
  double sum = 0;
  for (std::size_t i = 0; i < a.data.size(); ++i) sum += std::norm(a.data[i] - b.data[i]);
  return std::sqrt(sum);
}
} // namespace

ErrorOverBand::Errors ErrorOverBand::of(const DenseSystem& small) const {
  const DenseResponse response(small, tau_);
  Errors errors;
  for (std::size_t l = 0; l < omega_.size(); ++l) {
    const double difference = distance(H_[l], response.transfer(omega_[l]));
    errors.relative.push_back(difference / size_[l]);
    errors.bound.push_back(certified(l, difference));
    errors.worst = std::max(errors.worst, errors.bound.back());
  }
  return errors;
}

bool ErrorOverBand::meets(const DenseSystem& small, double tolerance) {
  const DenseResponse response(small, tau_);
  const auto fails = [&](std::size_t l) {
    return !(certified(l, distance(H_[l], response.transfer(omega_[l]))) <= tolerance);
  };
  if (fails(worst_)) return false;
  // Far apart first: a failure is found early.
  for (std::size_t step = 16, first = 0; step >= 1; step /= 2, first = step)
    for (std::size_t l = first; l < omega_.size(); l += first == 0 ? step : 2 * step)
      if (fails(l)) {
        worst_ = l;
        return false;
      }
  return true;
}

int smallest_order(const Candidate& candidate, const MediumModel& medium,
                   ErrorOverBand& errors, double tolerance, int most) {
  most = std::min(most, candidate.most);
  if (most < candidate.least) return 0;
  if (candidate.nested) {
    const DenseSystem all = medium.system.project(candidate.basis(most));
    for (int m = candidate.least; m <= most; ++m)
      if (errors.meets(all.project(first_columns(identity(most), m)), tolerance))
        return m;
    return 0;
  }
  const auto meets = [&](int m) {
    return errors.meets(medium.system.project(candidate.basis(m)), tolerance);
  };
  int low = candidate.least - 1, high = candidate.least;
  while (!meets(high)) {
    low = high;
    if (high == most) return 0;
    high = std::min(most, high + std::max(2, high / 2));
  }
  while (high - low > 1) {
    const int middle = (low + high) / 2;
    (meets(middle) ? high : low) = middle;
  }
  return high;
}

} // namespace flexgram
