/// A medium model's response everywhere in the bands and the bounds of its error: what
/// small models are compared with. Kept in the Medium from one cut to the next. Made by
/// basis/cut and level_judge.cpp, read by ErrorOverBand.

#pragma once

#include "medium/model.hpp"
#include "medium/view_norms.hpp"

#include <list>
#include <memory>
#include <optional>

namespace flexgram {

/// A medium model on a grid of frequencies and on intervals of the bands. Both are
/// evaluated when they are first asked for, an interval's halves when it was too long.
class MediumOverBand {
public:
  /// @param grid  [rad/s] frequencies of the curve, within the bands.
  MediumOverBand(MediumModel model, const std::vector<Interval>& bands,
                 std::vector<double> grid);

  const MediumModel& model() const { return model_; }

  /// A block of H at every frequency of the grid, in its own unit.
  struct View {
    std::vector<double>
        size; ///< ‖H‖, or of its elastic part: what errors are relative to
    std::vector<double> error; ///< bound of the medium model's error
    std::vector<double> floor; ///< rounding, to be added to it
    double largest = 0;        ///< of size − error − floor
  };
  struct Grid {
    std::vector<View> views; ///< those of the model
    /// Change of H relative to all of H if the stiffness of rigid modes in the stored K were
    /// real: the largest of all views and frequencies.
    double rigid_rounding = 0;
    /// Relative change of H by the rounding of K's entries when they were printed, at each
    /// frequency the largest of all views.
    std::vector<double> data_rounding;
  };
  const std::vector<double>& omega() const { return omega_; } ///< [rad/s] of the grid
  const Grid& grid();
  /// H at a frequency of the grid. @pre grid() was called.
  const TransferSeries& at(std::size_t l) const { return grid_H_[l]; }

  /// What the medium model says of an interval; of each view where these are several.
  struct Stretch {
    std::vector<double> error, floor; ///< in the unit of H: bound, rounding beside it
    std::vector<ViewNorms> size;
    bool proved = true;
  };
  struct Node {
    Interval interval;
    std::unique_ptr<Node> low, high;
    bool seen = false; ///< `stretch` is known
    std::shared_ptr<const Stretch> stretch;
    std::shared_ptr<const TransferSeries> H; ///< only as long as there is room
    /// Intervals of this length are not halved any more.
    bool is_shortest() const { return interval.width() <= 1e-10 * interval.last; }
  };
  /// Intervals that make up the bands.
  const std::vector<std::unique_ptr<Node>>& roots() const { return roots_; }
  /// @return null if a pole is too near for an interval of this length.
  std::shared_ptr<const Stretch> over(Node& node);
  /// H over the interval. @pre over(node) is not null.
  std::shared_ptr<const TransferSeries> response(Node& node);
  static void split(Node& node);
  /// The whole of it is beside a sharp resonance.
  bool near_pole(const Interval& interval) const;
  /// It is, and short beside the distance from the pole.
  bool may_be_excluded(const Interval& interval) const;

private:
  std::optional<MediumModel::Stretch> provable_over(const Interval& interval) const;
  void keep(Node& node, std::shared_ptr<const TransferSeries> H);

  MediumModel model_;
  std::vector<double> omega_;
  std::optional<Grid> grid_;
  std::vector<TransferSeries> grid_H_;
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
  /// H of the interval that was looked at last, if there was no room for it.
  std::pair<const Node*, std::shared_ptr<const TransferSeries>> latest_;
};

/// A factorisation of the full body tells H to no more digits than this.
inline constexpr double solve_floor = 1e-11;
/// Degree of the polynomials over an interval.
inline constexpr int series_degree = 12;

/// What earlier cuts of a Medium saw of it.
class SeenLevels {
public:
  /// How a level is looked at.
  struct Sight {
    std::size_t level = 0;
    PortSelection ports;
    KindSpec kinds;
    RelativeTo relative_to = RelativeTo::pointwise; ///< also where it is `band`
    std::vector<Interval> bands;
    std::vector<double> curve;               ///< [rad/s] more frequencies of the grid
    double enough = 0;                       ///< what needs no sharper bound
    ParameterValues values;                  ///< of the body's parameters
    double negligible = DenseSystem::finest; ///< rounding of responses
    bool operator==(const Sight&) const = default;
  };
  /// The one that was made for the same sight, or the one that `make` returns, which may
  /// be collective: so the oldest are dropped by their number, the same on every rank, and
  /// not by what they hold.
  template <class Make>
  std::shared_ptr<MediumOverBand> find_or(const Sight& sight, const Make& make) {
    for (const auto& [known, seen] : seen_)
      if (known == sight) return seen;
    make_room(sight);
    seen_.emplace_back(sight, make());
    return seen_.back().second;
  }

private:
  void make_room(const Sight& next);
  std::list<std::pair<Sight, std::shared_ptr<MediumOverBand>>> seen_;
};

} // namespace flexgram
