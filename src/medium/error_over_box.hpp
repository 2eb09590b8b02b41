/// The certified error of small models at all values of a body's parameters that claims are made
/// for; of a body without parameters that of its only one. Called by basis/cut and order_choice.

#pragma once

#include "medium/error_over_band.hpp"

namespace flexgram {

class ErrorOverBox {
public:
  using Measure = ErrorOverBand::Measure;
  using Errors = ErrorOverBand::Errors;
  /// The medium model with certain values of the parameters.
  struct Sight {
    ParameterValues values; ///< empty: the body has no parameters
    std::shared_ptr<MediumOverBand> seen;
  };
  /// @param sights  the first with the values that the body has; one or more.
  ErrorOverBox(std::vector<Sight> sights, RelativeTo relative_to);

  void add(Sight sight);
  /// On the grids; `relative` and `bound` with the values that the body has.
  Errors of(const DenseSystem& small);
  /// True if the error is at most `tolerance` everywhere in the bands with all the values.
  bool meets(const DenseSystem& small, double tolerance, Measure measure);

  struct Supremum : ErrorOverBand::Supremum {
    std::vector<ParameterValues> values_of; ///< of each view those where it is attained
  };
  /// The largest of all. Intervals are excluded if they are with any of the values.
  Supremum supremum(const DenseSystem& small, double level);
  /// Where the tolerance is not met with some of the values.
  ErrorOverBand::Unmet unmet(const DenseSystem& small, double tolerance);

  const std::vector<double>& omega() const { return parts_.front().errors.omega(); }
  std::vector<double> floor() { return parts_.front().errors.floor(); }
  ErrorOverBand::Floor largest_floor();
  double least();

private:
  struct Part {
    ParameterValues values;
    std::shared_ptr<MediumOverBand> seen;
    ErrorOverBand errors;
    std::vector<std::size_t> view; ///< of its own views, among those of the first
  };
  RelativeTo relative_to_;
  std::vector<Part> parts_;
  std::size_t hard_ = 0; ///< where a tolerance was not met the last time
};

} // namespace flexgram
