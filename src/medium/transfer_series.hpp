/// H over an interval from the response in modal coordinates; where it nearly vanishes, with the
/// digits of long double (docs/proof.md, section 4, "Zeros of H").

#pragma once

#include "medium/response_series.hpp"

namespace flexgram {

/// A system whose K and M are diagonal, as the numbers that it is made of.
struct ModalNumbers {
  std::vector<long double> k, m;
  std::vector<Term<Dense>> terms;
  Damping damping;
  Dense B, C; ///< N × inputs, N × outputs

  int order() const { return static_cast<int>(k.size()); }
  /// The system as it is stored. Nothing if K or M is not diagonal.
  static std::optional<ModalNumbers> of(const DenseSystem& system);
  /// A response with ports of its own.
  static ModalNumbers of(const DenseResponse& response, Dense B, Dense C);
};

/// CᵀX, of the coordinates from `first` on.
/// @param numbers  what X is the response of; null: doubles must do.
/// @param size  of the numbers beside which rounding is to be small; 0: of CᵀX.
MatrixSeries transfer_series(const Dense& C, const ResponseSeries& x, int first,
                             const ModalNumbers* numbers, double size = 0);

/// Rows of CᵀX, or of differences of it, times the factors of their outputs.
MatrixSeries scale_outputs(const OutputForm& form, Interval interval, MatrixSeries H);
/// H from CᵀX: factors of outputs, and what inputs add to them at once.
MatrixSeries complete_outputs(const OutputForm& form, Interval interval, MatrixSeries H);

/// The largest entry at the centre of the interval, real or imaginary part.
double size_at_centre(const MatrixSeries& H);

} // namespace flexgram
