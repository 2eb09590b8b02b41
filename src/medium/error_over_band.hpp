/// The certified error of small models everywhere in the bands, by branch and bound
/// (docs/proof.md, section 4, "Together"); error_supremum.cpp finds it. Called by basis/cut and
/// order_choice, and by
/// level_judge.cpp for the medium model itself.

#pragma once

#include "medium/over_band.hpp"
#include "medium/small_model.hpp"

#include <algorithm>
#include <functional>
#include <limits>
#include <optional>

namespace flexgram {

/// The certified error of small models, measured against the medium model,
///   ε <= (‖H_medium − H_r‖ + bound) / (‖H_medium‖ − bound),
/// for H as a whole (eq. 17) and for each other view of the medium model: at frequencies,
/// and everywhere between them.
///
/// The supremum is found by branch and bound over intervals of ω. On an interval both
/// responses are polynomials with a bound of their tails (response_series); between
/// equally spaced nodes a polynomial G is no farther than w²/8 max‖G″‖ from its chord, so
/// its norm is at most the larger of its ends and that, at least the chord's distance
/// from the origin without that (docs/proof.md, section 4).
///
/// Tolerances and levels are the smallest of all kinds, and errors are compared with them
/// after division by what their kind may err (PortView::allowed); those that are returned
/// are the errors themselves, but for Errors::worst.
class ErrorOverBand {
public:
  /// @param medium  which outlives this.
  ErrorOverBand(MediumOverBand& medium, RelativeTo relative_to);

  /// Takes the share that is done of a long work.
  using Tell = std::function<void(double)>;

  /// What is compared with a tolerance.
  enum class Measure {
    claim, ///< the certified error
    /// The model's own error, without rounding; nothing where the small model is as close to
    /// the medium model as that is known to be to the body.
    model_error,
    rounding ///< its part that is rounding; of the medium model alone
  };

  struct Errors {
    std::vector<double> relative, bound; ///< of H as a whole, at omega()
    double worst = 0;                    ///< largest bound of all views
  };
  /// On the grid only.
  Errors of(const DenseSystem& small);

  struct Supremum {
    std::vector<double>
        worst_of;     ///< of each view, certified everywhere outside `excluded`
    double worst = 0; ///< largest of these
    /// The certified error of each view at one frequency: a lower bound of worst_of.
    std::vector<double> attained_of;
    std::vector<double> at_of; ///< [rad/s] that frequency
    bool proved = true;
    /// Around resonances without damping worth the name, where nothing can be proved.
    std::vector<Interval> excluded;
    int intervals = 0; ///< that were looked at
  };
  /// @param level  errors up to this need no exclusion [0: up to what is found
  /// elsewhere].
  /// @param most   about so many intervals; fewer make `worst` larger, never wrong.
  Supremum supremum(const DenseSystem& small, double level, int most = 20000);
  /// True if the error is at most `tolerance` everywhere in the bands, but for excluded
  /// intervals around undamped resonances.
  bool meets(const DenseSystem& small, double tolerance, Measure measure);

  /// Where the certified error is not known to be within the tolerance, outside excluded
  /// intervals around undamped resonances.
  struct Unmet {
    std::vector<Interval> intervals; ///< [rad/s] ascending
    double share = 0;                ///< of the bands
  };
  /// @param share  of the work that this may take: the less, the coarser are the intervals.
  Unmet unmet(const DenseSystem& small, double tolerance, double share = 1);

  /// A frequency where the medium model itself, without its rounding, is not proved to be
  /// within the tolerance. @param tell  is told which share of the bands was looked at.
  std::optional<double> weak_spot(double tolerance, const Tell& tell = {});
  /// Frequencies where it is not with its rounding, in intervals that lie apart: of each about
  /// the worst.
  std::vector<double> rounding_spots(double tolerance);

  const std::vector<double>& omega() const { return medium_.omega(); }
  /// Rounding, relative, of H as a whole, at omega().
  std::vector<double> floor();
  struct Floor {
    double worst = 0;
    std::string of; ///< the kind of ports, or H
    double omega = 0;
  };
  Floor largest_floor(); ///< of all views, at the frequencies of the grid
  /// What no small model can go below: the bound of the medium model itself, on the grid.
  double least();

private:
  using Node = MediumOverBand::Node;
  /// What is compared with the medium model; null: the medium model itself, without
  /// rounding.
  using Small = const SmallModel*;
  /// What a small model's error may be on an interval.
  struct Look {
    std::vector<double> upper; ///< of each view
    double worst = std::numeric_limits<double>::infinity();
    double omega = 0;   ///< where the error seems largest
    bool known = false; ///< no pole is too near for a bound
    bool proved = true;
  };
  /// The certified errors at one frequency.
  struct Point {
    std::vector<double> certified; ///< of each view
    bool proved = true;
    double worst() const { return *std::max_element(certified.begin(), certified.end()); }
  };
  double reference(std::size_t view, double here);
  double allowed(std::size_t view) const;
  std::vector<double> negligible(const std::vector<double>& sizes, double level);
  double ratio(std::size_t view, double difference, double size, double bound);
  double measured(Measure measure, std::size_t view, double difference, double size,
                  double error, double floor);
  std::vector<std::vector<double>> distances(const std::vector<std::size_t>& at,
                                             const SmallModel& small, double level);
  std::pair<std::size_t, double> worst_of(const std::vector<std::size_t>& at,
                                          const SmallModel& small, double level,
                                          Measure measure);
  Point point(double omega, Small small, double level, Measure measure = Measure::claim);
  Look look(Node& node, Small small, double level, Measure measure = Measure::claim);
  template <class Visit>
  void where_it_fails(Small small, double tolerance, Measure measure, const Visit& visit,
                      const Tell& tell = {});
  /// A frequency where the error is not proved to be within the tolerance.
  std::optional<double> exceeds(Small small, double tolerance, Measure measure,
                                const Tell& tell = {});
  double worst_between(Interval interval, double tolerance, Measure measure);
  static void settle(const Look& seen, Supremum& result);
  void visit(double omega, const SmallModel& small, double level, Supremum& result);
  void exclude(std::vector<Node*> zones, const SmallModel& small, double allowed,
               Supremum& result);

  MediumOverBand& medium_;
  RelativeTo relative_to_;
  std::vector<std::size_t> hard_;  ///< grid points that failed before, the last one first
  std::vector<double> hard_omega_; ///< other frequencies that failed
};

} // namespace flexgram
