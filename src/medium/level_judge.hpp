/// How good a level of a growing medium model is. Used by growth.cpp and level_certifier.cpp.

#pragma once

#include "medium/error_over_band.hpp"
#include "medium/over_band.hpp"

namespace flexgram {

/// Looks at a level by all ports, at the frequencies of a grid, which gains those where the level
/// was found to be weak, and between them; at all values of the parameters that are asked for.
class LevelJudge {
public:
  /// @param grid  [rad/s] kept by reference.
  LevelJudge(const SecondOrderModel& fom, const Medium& medium,
             std::vector<double>& grid);

  /// Takes a level with its certificate and writes into it how good it is: the largest bound
  /// on the grid. Collective.
  void judge(std::size_t number, MediumLevel& level);
  /// The same level at more frequencies. @param thorough  with all values of the parameters, also
  /// where those that come first show that it is not good enough.
  void judge_again(MediumLevel& level, bool thorough = false);

  /// The level that was taken last, with the values of the parameters at which its bound is
  /// largest.
  const MediumModel& model() { return seen(worst_values_).model(); }
  /// Those; empty: the body has no parameters.
  ParameterValues worst_values() const;
  double worst_omega() const { return worst_omega_; } ///< [rad/s] its largest bound
  /// Its largest relative rounding where it was looked at, which the bound leaves out.
  double floor() const { return floor_; }
  /// What rounding may change beside what a level is good to. It is far less where sums with
  /// twice the digits take no time worth naming.
  double allowed_rounding(const MediumLevel& level) const;

  /// A frequency of the bands where the bound of the level does not meet the target, if there is
  /// one. Collective.
  std::optional<double> weak_spot(const ErrorOverBand::Tell& tell);
  /// Frequencies of the bands where its rounding is more than what is allowed. Collective.
  std::vector<double> rounding_spots(double allowed);
  /// Rounding is looked at there too, the error is not.
  void look_at_rounding(const std::vector<double>& spots);
  void forget_rounding_spots() { spots_.clear(); }
  /// All frequencies where rounding is looked at [rad/s].
  std::vector<double> rounding_grid();

private:
  /// What was seen at one frequency.
  struct Sight {
    MediumModel::Stretch value;
    double omega = 0;
    bool is_on_grid = true; ///< else only rounding is looked at
  };
  MediumOverBand& seen(std::size_t values);
  std::vector<double> grid_of(std::size_t values);
  std::vector<double> beside_grid(const MediumModel& model) const;
  std::vector<Sight> sights(std::size_t values, double hopeless);

  const SecondOrderModel& fom_;
  const Medium& medium_;
  std::vector<double>& grid_;
  std::vector<double> spots_; ///< [rad/s] where rounding was found to be large
  /// For each of the spec's values, made when it is asked for.
  std::vector<std::unique_ptr<MediumOverBand>> seen_;
  std::size_t level_ = 0; ///< its number
  std::size_t worst_values_ = 0;
  std::size_t shared_ = 0; ///< frequencies of the grid that were its own at first
  double worst_omega_ = 0, floor_ = 0;
};

} // namespace flexgram
