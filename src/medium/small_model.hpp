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
  /// @param negligible  for each view: rounding that does not count beside this is left as it is:
  ///     with many ports that of the terms of both responses, with terms that of doubles.
  std::optional<std::vector<ViewNorms>>
  differences(const TransferSeries& H, Interval interval, int degree,
              const std::vector<double>& negligible) const;
  /// What the medium model shows at a frequency, and what is negligible there.
  struct Sample {
    const TransferSeries* H;
    double omega;
    std::vector<double> negligible;
  };
  /// The same at frequencies, as one number for each view.
  std::vector<std::vector<double>> distances(const std::vector<Sample>& samples) const;

private:
  bool shares_rigid_modes(const DenseSystem& system) const;
  ComplexDense transfer(double omega) const;
  std::vector<double> between(const ComplexDense& H, const ComplexDense& H_r,
                              double omega) const;
  std::optional<MatrixSeries> factors_of_difference(const TransferSeries& H,
                                                    Interval interval, int degree) const;

  const MediumModel& medium_;
  DenseResponse response_;
  std::optional<ModalNumbers> numbers_; ///< for more digits, where they tell
  int apart_ =
      0; ///< first modes of both models that are the same and leave no difference
  std::vector<TermGram> terms_; ///< of the difference, for each view; with many ports
};

} // namespace flexgram
