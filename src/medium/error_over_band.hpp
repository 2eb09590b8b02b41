/// The certified error of small models everywhere in the bands, by branch and bound
/// (docs/proof.md, section 4, "Together"). Called by basis/cut and order_choice, and by
/// growth.cpp for the medium model itself.

#pragma once

#include "medium/model.hpp"

#include <memory>
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
class ErrorOverBand {
public:
  /// @param grid  [rad/s] frequencies of the curve, within the bands.
  ErrorOverBand(const MediumModel& medium, std::vector<Interval> bands,
                std::vector<double> grid, RelativeTo relative_to);
  ~ErrorOverBand();

  struct Errors {
    std::vector<double> relative, bound; ///< of H as a whole, at omega()
    std::vector<double> worst_of;        ///< largest bound of each view
    double worst = 0;                    ///< largest of these
    double at = 0;                       ///< [rad/s] where that is
  };
  /// On the grid only.
  Errors of(const DenseSystem& small) const;

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
  Supremum supremum(const DenseSystem& small, double level, RelativeTo relative_to,
                    int most = 20000);
  /// True if the certified error is at most `tolerance` everywhere in the bands, but for
  /// excluded intervals around undamped resonances.
  bool meets(const DenseSystem& small, double tolerance);

  /// A frequency where the medium model itself, without its rounding, is not proved to be
  /// within the tolerance.
  std::optional<double> weak_spot(double tolerance);

  const std::vector<double>& omega() const { return omega_; }
  /// Rounding, relative, of H as a whole.
  const std::vector<double>& floor() const { return views_.front().floor; }
  double largest_floor() const; ///< of all views
  /// What H would change by, relative, if the stiffness of rigid modes that was taken for
  /// rounding were meant; on the grid, of all views.
  double assumed() const { return assumed_; }
  const std::vector<ComplexDense>& H() const { return H_; }
  /// What no small model can go below: the bound of the medium model itself, on the grid.
  double least() const;

private:
  /// A block of H at every frequency: its norm, the medium model's bound, its rounding.
  struct Seen {
    PortView view;
    double largest = 0; ///< of ‖H‖ − bound over the grid
    std::vector<double> size, bound, floor;
  };
  struct Node;
  struct Look;
  struct Point {
    std::vector<double> certified;
    bool proved = true;
    double worst() const;
  };
  double ratio(std::size_t view, double difference, double size, double bound) const;
  double certified(const Seen& seen, std::size_t l, const ComplexDense& H_r) const;
  Point point(double omega, const DenseResponse* small) const;
  std::optional<MediumModel::Stretch> provable_over(const Interval& interval) const;
  Look look(Node& node, const DenseResponse* small);
  std::optional<double> exceeds(const DenseResponse* small, double tolerance);
  static void settle(const Look& seen, Supremum& result);
  void exclude(std::vector<Node*> zones, const DenseResponse& small, double allowed,
               Supremum& result);
  void split(Node& node) const;
  bool may_be_excluded(const Interval& interval) const;
  bool near_pole(const Interval& interval) const;

  const MediumModel& medium_;
  RelativeTo relative_to_;
  std::vector<double> omega_;
  std::vector<Seen> views_;
  std::vector<ComplexDense> H_;
  std::vector<std::size_t> hard_;  ///< grid points that failed before, the last one first
  std::vector<double> hard_omega_; ///< other frequencies that failed
  /// A resonance with hardly any damping, and the zone in which intervals may be
  /// excluded.
  struct Sharp {
    Interval zone;
    double pole, nearest; ///< [rad/s]; intervals need not be shorter than the latter
    bool holds(const Interval& i) const {
      return i.first >= zone.first && i.last <= zone.last;
    }
  };
  std::vector<Sharp> sharp_;
  std::vector<std::unique_ptr<Node>> roots_;
  std::size_t kept_ = 0; ///< numbers in the nodes
  double assumed_ = 0;
};

} // namespace flexgram
