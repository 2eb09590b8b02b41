/// A small model beside the medium model: how far their responses are from each other.
/// Called by ErrorOverBand.

#pragma once

#include "medium/model.hpp"

#include <optional>
#include <vector>

namespace flexgram {

class SmallModel {
public:
  /// @param medium  which outlives this.
  SmallModel(const DenseSystem& system, const MediumModel& medium);

  /// ‖H_medium − H_r‖ of each view over an interval; nothing where a pole of the small
  /// model is too near.
  /// @param H           of the medium model there, of this degree.
  /// @param negligible  for each view: with many ports the norms come from the terms of
  ///     both responses where the rounding of that does not count beside this.
  std::optional<std::vector<ViewNorms>>
  differences(const TransferSeries& H, Interval interval, int degree,
              const std::vector<double>& negligible) const;
  /// The same at a frequency, as one number each.
  std::vector<double> distances(const TransferSeries& H, double omega,
                                const std::vector<double>& negligible) const;

private:
  const MediumModel& medium_;
  DenseResponse response_;
  std::vector<TermGram> terms_; ///< of the difference, for each view; with many ports
};

} // namespace flexgram
