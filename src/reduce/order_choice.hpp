#pragma once

#include "reduce/candidates.hpp"
#include "reduce/gramian_basis.hpp"

namespace flexgram {

/// The certified error of small models over the band, measured against the medium model:
///   ε ≤ (‖H_medium − H_r‖ + bound) / (‖H_medium‖ − bound),
/// for H as a whole (eq. 17) and for each other view of the medium model.
class ErrorOverBand {
public:
  ErrorOverBand(const MediumModel& medium, std::vector<double> grid);

  struct Errors {
    std::vector<double> relative, bound; ///< of H as a whole, at omega()
    std::vector<double> worst_of;        ///< largest bound of each view
    double worst = 0;                    ///< largest of these
  };
  Errors of(const DenseSystem& small) const;
  /// True if the bound is at most `tolerance` over the grid; looks first where the last
  /// model failed.
  bool meets(const DenseSystem& small, double tolerance);

  const std::vector<double>& omega() const { return omega_; }
  /// Rounding, relative, of H as a whole.
  const std::vector<double>& floor() const { return views_.front().floor; }
  double largest_floor() const; ///< of all views
  const std::vector<ComplexDense>& H() const { return H_; }
  /// What no small model can go below: the bound of the medium model itself.
  double least() const;

private:
  /// A block of H at every frequency: its norm, the medium model's bound, its rounding.
  struct Seen {
    PortView view;
    std::vector<double> size, bound, floor;
    double certified(std::size_t l, double difference) const;
    double difference(const ComplexDense& a, const ComplexDense& b) const;
  };
  double tau_;
  std::vector<double> omega_;
  std::vector<Seen> views_;
  std::vector<ComplexDense> H_;
  std::size_t worst_ = 0;
};

/// Smallest order whose certified error meets the tolerance; 0 if none does.
/// For nested bases every order is tried, so m − 1 misses; others are halved and then
/// stepped down.
int smallest_order(const Candidate& candidate, const MediumModel& medium,
                   ErrorOverBand& errors, double tolerance, int most);

/// Which second stage at which order, and in words why.
struct OrderChoice {
  std::vector<Candidate> candidates;
  std::size_t best = 0;
  int order = 0;
  std::string chosen_by, tried;
};

/// By the tolerance: the smallest order that any of the named second stages needs; by a
/// given order: the stage with the smallest certified error; else by the paper's rule.
/// @throws Error with the reason if the tolerance or the order cannot be had.
OrderChoice choose_order(const std::vector<std::string>& names, const SecondStage& stage,
                         ErrorOverBand& errors, const GramianOptions& gramian);

} // namespace flexgram
