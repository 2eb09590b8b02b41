#include "basis/order_choice.hpp"

#include "base/text.hpp"

#include <algorithm>
#include <limits>
#include <numbers>

namespace flexgram {
namespace {

/// An order above `low` that is good while the one below it is not; 0 if none is found.
int bracketed(int low, int most, const std::function<bool(int)>& is_good) {
  int high = low + 1;
  while (!is_good(high)) {
    low = high;
    if (high == most) return 0;
    high = std::min(most, high + std::max(2, high / 2));
  }
  while (high - low > 1) {
    const int middle = (low + high) / 2;
    (is_good(middle) ? high : low) = middle;
  }
  return high;
}

} // namespace

int smallest_order(const Candidate& candidate, const MediumModel& medium, int most,
                   const std::function<bool(const DenseSystem&)>& good) {
  most = std::min(most, candidate.most);
  if (most < candidate.least) return 0;
  if (candidate.nested) {
    const DenseSystem all = medium.system.project(candidate.basis(most));
    const auto is_good = [&](int m) {
      return good(all.project(first_columns(identity(most), m)));
    };
    // One by one; from orders on where each is costly, by a bracket.
    constexpr int costly = 64;
    for (int m = candidate.least; m <= std::min(most, costly); ++m)
      if (is_good(m)) return m;
    if (most <= costly) return 0;
    return bracketed(std::max(costly, candidate.least - 1), most, is_good);
  }
  const auto is_good = [&](int m) {
    return good(medium.system.project(candidate.basis(m)));
  };
  if (candidate.no_fewer) {
    int m = smallest_order(*candidate.no_fewer, medium, most, good);
    if (m > 0) {
      while (m > candidate.least && is_good(m - 1)) --m;
      return is_good(m) ? m : 0;
    }
  }
  return bracketed(candidate.least - 1, most, is_good);
}

namespace {

/// The order without a tolerance: what the method says, else the paper's rule.
int ruled_order(const Candidate& candidate, const SecondStage& stage) {
  const auto rule = method(candidate.name).rule;
  if (rule) return rule(candidate, stage);
  const Candidate by =
      candidate.sigma.empty() ? make_candidate("gramian", stage) : candidate;
  return std::clamp(order_by_rule(by.sigma), candidate.least, candidate.most);
}

/// Why no small model meets the tolerance.
std::string shortfall(double tolerance, const SecondStage& stage, ErrorOverBox& errors,
                      const Candidate& best) {
  const double least = errors.least();
  if (const auto floor = errors.largest_floor(); floor.worst > 0.5 * tolerance)
    return text(
        "the rounding of doubles may change %s by up to %.1e of it at %.5g Hz, %s",
        floor.of.c_str(), floor.worst, floor.omega / (2 * std::numbers::pi),
        floor.omega > 0
            ? "at a sharp resonance or because these outputs hardly respond to these "
              "inputs"
            : "where these outputs do not respond to these inputs (the force of a "
              "support "
              "under a moment, for one): begin above 0 Hz ({band_hz} 1,…), or leave "
              "them out ({outputs})");
  if (least > tolerance)
    return text("the medium model of order %d is good to %.1e only (see "
                "{medium_order}, {cutoff})",
                stage.medium.system.order(), least);
  return text("%s does not reach it up to order %d; take another {method} or "
              "{second_stage}, or more {moments} or {cutoff}",
              best.name.c_str(), best.most);
}

/// The smallest order of all candidates at which the measure of the error meets the
/// tolerance; 0 if there is none.
int smallest_of_all(OrderChoice& choice, double tolerance, const SecondStage& stage,
                    ErrorOverBox& errors, ErrorOverBand::Measure measure) {
  choice.tried.clear();
  for (std::size_t c = 0; c < choice.candidates.size(); ++c) {
    const Candidate& candidate = choice.candidates[c];
    // A later candidate must be smaller to win.
    const int order = smallest_order(candidate, stage.medium,
                                     choice.order > 0 ? choice.order - 1 : candidate.most,
                                     [&](const DenseSystem& small) {
                                       return errors.meets(small, tolerance, measure);
                                     });
    if (order > 0) {
      choice.best = c;
      choice.order = order;
    }
    choice.tried += text("%s%s %s", c == 0 ? "" : ", ", candidate.name.c_str(),
                         order > 0          ? std::to_string(order).c_str()
                         : choice.order > 0 ? "no smaller"
                                            : "none");
  }
  return choice.order;
}

/// The largest body of the candidate that comes closest.
void choose_closest(OrderChoice& choice, const SecondStage& stage, ErrorOverBox& errors) {
  double reached = std::numeric_limits<double>::infinity();
  for (std::size_t c = 0; c < choice.candidates.size(); ++c) {
    const Candidate& candidate = choice.candidates[c];
    const double worst =
        errors.of(stage.medium.system.project(candidate.basis(candidate.most))).worst;
    if (c > 0 && !(worst < reached)) continue;
    reached = worst;
    choice.best = c;
  }
  choice.order = choice.candidates[choice.best].most;
}

void choose_by_tolerance(OrderChoice& choice, double tolerance, const SecondStage& stage,
                         ErrorOverBox& errors) {
  using Measure = ErrorOverBand::Measure;
  choice.chosen_by = text("{tol} %g", tolerance);
  if (errors.least() <= tolerance &&
      smallest_of_all(choice, tolerance, stage, errors, Measure::claim) > 0)
    return;
  if (smallest_of_all(choice, tolerance, stage, errors, Measure::model_error) > 0)
    choice.chosen_by += " without rounding and the error of the medium model";
  else
    choose_closest(choice, stage, errors);
  choice.shortfall = shortfall(tolerance, stage, errors, choice.candidates[choice.best]);
}

void choose_by_order(OrderChoice& choice, int order, const SecondStage& stage,
                     ErrorOverBox& errors) {
  double least = std::numeric_limits<double>::infinity();
  for (std::size_t c = 0; c < choice.candidates.size(); ++c) {
    const Candidate& candidate = choice.candidates[c];
    if (order < candidate.least || order > candidate.most) continue;
    const double worst =
        errors.of(stage.medium.system.project(candidate.basis(order))).worst;
    if (worst < least || choice.order == 0) {
      least = worst;
      choice.best = c;
      choice.order = order;
    }
    choice.tried += text("%s%s %.1e", choice.tried.empty() ? "" : ", ",
                         candidate.name.c_str(), worst);
  }
  if (choice.order == 0)
    throw Error(text("{order} %d: %s has orders from %d to %d here%s", order,
                     choice.candidates.front().name.c_str(),
                     choice.candidates.front().least, choice.candidates.front().most,
                     stage.medium.rigid > 0
                         ? text(", among them %d rigid modes", stage.medium.rigid).c_str()
                         : ""));
  choice.chosen_by = "{order}";
}

} // namespace

OrderChoice choose_order(const std::vector<std::string>& names, const SecondStage& stage,
                         ErrorOverBox& errors, const OrderSpec& order) {
  OrderChoice choice;
  for (const auto& name : names) choice.candidates.push_back(make_candidate(name, stage));
  if (order.tolerance) {
    choose_by_tolerance(choice, order.smallest(), stage, errors);
  } else if (order.order > 0) {
    choose_by_order(choice, order.order, stage, errors);
  } else {
    const Candidate& first = choice.candidates.front();
    choice.order = ruled_order(first, stage);
    choice.chosen_by = method(first.name).rule ? "what the method gives without {order}"
                                               : "the rule sigma_(m+1)/sigma_1 < 1.5e-8";
  }
  if (names.size() == 1) choice.tried.clear();
  return choice;
}

} // namespace flexgram
