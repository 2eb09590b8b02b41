/// The error of the whole field of displacements in the norm of the strain energy,
/// certified everywhere in the bands (docs/proof.md, section 4, "The field"). Called by
/// basis/cut.

#pragma once

#include "medium/over_band.hpp"

#include <vector>

namespace flexgram {

/// ‖X − V x_r‖_K of the responses X to some inputs, relative to ‖X‖_K, ‖Y‖_K² = tr YᴴKY.
struct FieldSupremum {
  double worst = 0;    ///< everywhere in the bands outside the excluded intervals
  double attained = 0; ///< the bound at one frequency
  double at = 0;       ///< [rad/s] that frequency
  bool proved = true;
};

class FieldError {
public:
  /// @param Q      the small model's basis in the columns of the level.
  /// @param small  the small model.
  FieldError(MediumOverBand& medium, const Dense& Q, const DenseSystem& small);

  /// @param inputs    among the model's.
  /// @param excluded  intervals that the claim of H leaves out.
  FieldSupremum supremum(const std::vector<int>& inputs,
                         const std::vector<Interval>& excluded) const;

private:
  struct Look {
    double upper, at_centre;
    bool proved;
  };
  Look look(Interval interval, const std::vector<int>& inputs,
            const MediumModel::FieldLoads& loads) const;

  MediumOverBand& medium_;
  DenseResponse small_;
  Dense lifted_; ///< transposed: the small model's modes in the coordinates of the field
};

} // namespace flexgram
