#include "reduce/order_choice.hpp"

#include "base/text.hpp"

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
  for (const PortView& view : medium.views) views_.push_back({view, {}, {}, {}});
  for (double omega : omega_) {
    MediumModel::Value value = medium.at(omega);
    for (std::size_t v = 0; v < views_.size(); ++v) {
      Seen& seen = views_[v];
      const Certificate::Bound& bound = value.bounds[v];
      const double size = frobenius_norm(seen.view.of(value.H)),
                   floor = bound.floor + solve_floor * size;
      seen.size.push_back(size);
      seen.bound.push_back(bound.error + floor);
      seen.floor.push_back(floor / size);
    }
    H_.push_back(std::move(value.H));
  }
}

double ErrorOverBand::Seen::certified(std::size_t l, double difference) const {
  const double known = size[l] - bound[l];
  return known > 0 ? (difference + bound[l]) / known
                   : std::numeric_limits<double>::infinity();
}

double ErrorOverBand::Seen::difference(const ComplexDense& a,
                                       const ComplexDense& b) const {
  double sum = 0;
  for (int j : view.columns)
    for (int i : view.rows) sum += std::norm(a(i, j) - b(i, j));
  return std::sqrt(sum);
}

double ErrorOverBand::least() const {
  double least = 0;
  for (const Seen& seen : views_)
    for (std::size_t l = 0; l < omega_.size(); ++l)
      least = std::max(least, seen.certified(l, 0));
  return least;
}

double ErrorOverBand::largest_floor() const {
  double largest = 0;
  for (const Seen& seen : views_)
    for (double floor : seen.floor) largest = std::max(largest, floor);
  return largest;
}

ErrorOverBand::Errors ErrorOverBand::of(const DenseSystem& small) const {
  const DenseResponse response(small, tau_);
  Errors errors;
  errors.worst_of.assign(views_.size(), 0.0);
  for (std::size_t l = 0; l < omega_.size(); ++l) {
    const ComplexDense H_r = response.transfer(omega_[l]);
    for (std::size_t v = 0; v < views_.size(); ++v) {
      const double difference = views_[v].difference(H_[l], H_r),
                   bound = views_[v].certified(l, difference);
      errors.worst_of[v] = std::max(errors.worst_of[v], bound);
      errors.worst = std::max(errors.worst, bound);
      if (v > 0) continue;
      errors.relative.push_back(difference / views_[v].size[l]);
      errors.bound.push_back(bound);
    }
  }
  return errors;
}

bool ErrorOverBand::meets(const DenseSystem& small, double tolerance) {
  const DenseResponse response(small, tau_);
  const auto fails = [&](std::size_t l) {
    const ComplexDense H_r = response.transfer(omega_[l]);
    return std::any_of(views_.begin(), views_.end(), [&](const Seen& seen) {
      return !(seen.certified(l, seen.difference(H_[l], H_r)) <= tolerance);
    });
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

namespace {

/// The order without a tolerance: the paper's rule where there is a Gramian, else what
/// the name says.
int ruled_order(const Candidate& candidate, const SecondStage& stage, double last) {
  if (candidate.name == "modal") {
    int count = stage.medium.rigid;
    for (double l : stage.medium.lambda) count += l <= last * last;
    return std::max(count, 1);
  }
  if (candidate.name == "craig_bampton" || candidate.name == "krylov" ||
      candidate.name == "medium")
    return candidate.most;
  const Candidate by =
      candidate.sigma.empty() ? make_candidate("gramian", stage) : candidate;
  return std::clamp(order_by_rule(by.sigma), candidate.least, candidate.most);
}

void refuse_tolerance(double tolerance, const SecondStage& stage,
                      const ErrorOverBand& errors) {
  const double floor = errors.largest_floor();
  throw Error(
      floor > 0.5 * tolerance
          ? text("-mor_tol %g cannot be proved: rounding of K alone changes H by up to "
                 "%.1e of it, at a sharp resonance or because the outputs hardly answer "
                 "the inputs; a larger -mor_tol can",
                 tolerance, floor)
          : text(
                "-mor_tol %g cannot be proved: the medium model of order %d is certified "
                "to %.1e only (see -mor_medium_order, -mor_cutoff)",
                tolerance, stage.medium.system.order(), errors.least()));
}

void choose_by_tolerance(OrderChoice& choice, double tolerance, const SecondStage& stage,
                         ErrorOverBand& errors) {
  if (errors.least() > tolerance) refuse_tolerance(tolerance, stage, errors);
  for (std::size_t c = 0; c < choice.candidates.size(); ++c) {
    const Candidate& candidate = choice.candidates[c];
    // A later candidate must be smaller to win.
    const int order =
        smallest_order(candidate, stage.medium, errors, tolerance,
                       choice.order > 0 ? choice.order - 1 : candidate.most);
    if (order > 0) {
      choice.best = c;
      choice.order = order;
    }
    choice.tried += text("%s%s %s", c == 0 ? "" : ", ", candidate.name.c_str(),
                         order > 0 ? std::to_string(order).c_str() : "no smaller");
  }
  if (choice.order == 0) {
    const Candidate& first = choice.candidates.front();
    const double reached =
        errors.of(stage.medium.system.project(first.basis(first.most))).worst;
    throw Error(
        text("-mor_tol %g is not met by %s up to order %d, which reaches %.1e; take "
             "another -mor_method or -mor_second_stage, or more -mor_moments or "
             "-mor_cutoff",
             tolerance, first.name.c_str(), first.most, reached));
  }
  choice.chosen_by = text("-mor_tol %g", tolerance);
}

void choose_by_order(OrderChoice& choice, int order, const SecondStage& stage,
                     const ErrorOverBand& errors) {
  double least = std::numeric_limits<double>::infinity();
  for (std::size_t c = 0; c < choice.candidates.size(); ++c) {
    const Candidate& candidate = choice.candidates[c];
    if (order < candidate.least || order > candidate.most) continue;
    const double worst =
        errors.of(stage.medium.system.project(candidate.basis(order))).worst;
    if (worst < least) {
      least = worst;
      choice.best = c;
      choice.order = order;
    }
    choice.tried += text("%s%s %.1e", choice.tried.empty() ? "" : ", ",
                         candidate.name.c_str(), worst);
  }
  if (choice.order == 0)
    throw Error(text("-mor_order %d: %s has orders from %d to %d here", order,
                     choice.candidates.front().name.c_str(),
                     choice.candidates.front().least, choice.candidates.front().most));
  choice.chosen_by = "-mor_order";
}

} // namespace

OrderChoice choose_order(const std::vector<std::string>& names, const SecondStage& stage,
                         ErrorOverBand& errors, const GramianOptions& gramian) {
  OrderChoice choice;
  for (const auto& name : names) choice.candidates.push_back(make_candidate(name, stage));
  if (gramian.tolerance) {
    choose_by_tolerance(choice, *gramian.tolerance, stage, errors);
  } else if (gramian.order > 0) {
    choose_by_order(choice, gramian.order, stage, errors);
  } else {
    const Candidate& first = choice.candidates.front();
    choice.order = ruled_order(first, stage, gramian.bands().back().second);
    choice.chosen_by = first.sigma.empty() ? "what the method gives without -mor_order"
                                           : "the rule sigma_(m+1)/sigma_1 < 1.5e-8";
  }
  if (names.size() == 1) choice.tried.clear();
  return choice;
}

} // namespace flexgram
