/// Complex modes of a dense system whose terms are stiffness with losses: with them a frequency
/// costs a product, not a solve. Made by DenseResponse, asked by medium/pencil_series.

#pragma once

#include "model/dense_system.hpp"

namespace flexgram {

/// A(ω) = a P + m M in the coordinates of a DenseResponse, P complex symmetric, M = diag(μ),
/// a = 1 + i(η + ωβ), or 1 with η in P, and m = iωα − ω². With E = P + τM and MX = EX diag(ν)
///   A X = E X diag(a + (m − τa)ν),
/// but for rounding, which is kept: the response is X diag(1/(a + (m − τa)ν)) (EX)⁻¹ B.
class PencilModes {
public:
  using Complex = std::complex<double>;
  /// Nothing if a term is no such stiffness.
  static std::optional<PencilModes> of(const DenseResponse& response);

  /// d_0 + d_1 t + d_2 t² of a mode over an interval, ω = centre + half t, and how far d_0 may be
  /// off by rounding.
  struct Diagonal {
    Complex d0, d1, d2;
    double rounding;
  };
  Diagonal diagonal(Interval interval, int mode) const;
  /// |m − τa| at most, anywhere in an interval.
  double largest_shift(Interval interval) const;

  const ComplexDense& X() const { return X_; }
  const ComplexDense& inverse() const { return inverse_; } ///< (EX)⁻¹
  const Dense& sizes() const { return sizes_; }            ///< |X|
  /// (EX)⁻¹ of what B − EX (EX)⁻¹B leaves is this times |B| at most, entry by entry.
  const Dense& lost_of_loads() const { return lost_of_loads_; }
  /// (EX)⁻¹(MX − EX diag(ν)) at most, entry by entry.
  const Dense& lost_of_modes() const { return lost_of_modes_; }

private:
  Damping damping_;
  double tau_ = 0;
  bool takes_beta_ = false; ///< a = 1 + i(η + ωβ), else 1
  std::vector<Complex> nu_;
  ComplexDense X_, inverse_;
  Dense sizes_, lost_of_loads_, lost_of_modes_;
};

} // namespace flexgram
