/// Complex modes of a dense system whose terms are stiffness with losses, or of rates: with them a
/// frequency costs a product, not a solve. Made by DenseResponse, asked by medium/pencil_series.

#pragma once

#include "model/dense_system.hpp"

#include <limits>

namespace flexgram {

/// A(ω) in the coordinates of a DenseResponse is a(ω)E + f(ω)M, or a larger matrix is, of whose inverse
/// A⁻¹ is a block. With MX = EX diag(ν) and d = a + fν
///   (aE + fM)X = EX diag(d),
/// but for rounding, which is kept: the response is X diag(1/d) (EX)⁻¹ B.
///
/// Where the terms are stiffness with losses, A = a P + m M, P complex symmetric, M = diag(μ),
/// a = 1 + i(η + ωβ), or 1 with η in P, and m = iωα − ω²: E = P + τM and f = m − τa.
///
/// Where some are of rates, A = P + sC + s²M with s = iω. With y = s √M x it is the block of x in
///   L(s) = [P + sC, s√M; s√M, −1],
/// which is linear in s: E = L(√τ), a = 1 and f = s − √τ. First coordinates that are free stay alone.
/// Relative rounding of a complex product of so many terms, beside that of their sizes: each part is a
/// sum of twice as many, 2n units u = ε/2 of rounding; both together √2 of it.
inline double product_rounding(int terms) {
  return 1.5 * std::numeric_limits<double>::epsilon() * (terms + 4);
}

class PencilModes {
public:
  using Complex = std::complex<double>;
  /// Nothing if a term is neither.
  static std::optional<PencilModes> of(const DenseResponse& response);

  int count() const { return static_cast<int>(modes_.size()); }
  /// d_0 + d_1 t + d_2 t² of a mode over an interval, ω = centre + half t, and how far d_0 may be
  /// off by rounding.
  struct Diagonal {
    Complex d0, d1, d2;
    double rounding;
  };
  Diagonal diagonal(Interval interval, int mode) const;
  /// |f| at most, anywhere in an interval: what `lost_of_modes` is multiplied by.
  double largest_shift(Interval interval) const;

  /// Loads in the coordinates of the modes.
  struct Loads {
    ComplexDense c; ///< (EX)⁻¹B, count × p
    Dense sizes;    ///< |c|
    Dense lost;     ///< how far c may be off
  };
  Loads loads(const Dense& B) const;
  const Loads& own_loads() const { return own_loads_; } ///< of the response's inputs

  const ComplexDense& X() const { return X_; }             ///< N × count
  const ComplexDense& inverse() const { return inverse_; } ///< (EX)⁻¹, count × N
  const Dense& sizes() const { return sizes_; }            ///< |X|
  /// Of the system: relative rounding of responses that does not count.
  double negligible() const { return negligible_; }
  /// (EX)⁻¹(MX − EX diag(ν)) at most, entry by entry.
  const Dense& lost_of_modes() const { return lost_of_modes_; }
  const std::vector<double>& sums_of_lost_modes() const { return sums_; } ///< of its rows

private:
  /// d(ω) = constant + linear ω + square ω²; what the constant adds up from.
  struct Mode {
    Complex constant, linear, square;
    double size;
  };
  static std::optional<PencilModes> of_stiffness(const DenseResponse& response);
  static std::optional<PencilModes> of_rates(const DenseResponse& response);

  /// f, as d of a mode.
  Complex shift_constant_, shift_linear_, shift_square_;
  double negligible_ = 0;
  std::vector<Mode> modes_;
  ComplexDense X_, inverse_;
  /// (EX)⁻¹ of what B − EX (EX)⁻¹B leaves is the second times |B| at most, entry by entry.
  Dense sizes_, lost_of_loads_, lost_of_modes_;
  std::vector<double> sums_;
  Loads own_loads_;
};

} // namespace flexgram
