/// The response of a dense system over an interval as a polynomial with a bound of its
/// tail (docs/proof.md, section 4, "Series"). Called by MediumModel and ErrorOverBand.

#pragma once

#include "model/dense_system.hpp"
#include "model/spec.hpp"

#include <optional>
#include <vector>

namespace flexgram {

/// A matrix function of ω on an interval: F(ω) = Σ_k F_k t^k + rest, ω = centre + half t,
/// |t| <= 1, and every entry of the rest at most that of `tail`, rounding included.
struct MatrixSeries {
  int columns = 0;
  Dense coefficients; ///< rows × 2·columns·(degree + 1): Re F_0, Im F_0, Re F_1, …
  Dense tail;         ///< rows × columns

  int rows() const { return coefficients.rows; }
  int degree() const { return coefficients.columns / (2 * columns) - 1; }
  const double* real(int k) const { return coefficients.column(2 * columns * k); }
  const double* imaginary(int k) const {
    return coefficients.column(2 * columns * k + columns);
  }
  ComplexDense centre() const;                ///< F_0
  void set(int k, const ComplexDense& value); ///< F_k
};

/// F with zeros in the rows before `first`.
MatrixSeries from_row(MatrixSeries F, int first);
/// AᵀF. @param sizes  |A|.
MatrixSeries multiply_transposed(const Dense& A, const Dense& sizes,
                                 const MatrixSeries& F);
MatrixSeries multiply_transposed(const Dense& A, const MatrixSeries& F);
/// (Σ f_k t^k + rest) F, of the same degree as F: what is above goes into the tail.
/// @param rest  a function of t, at most.
MatrixSeries times(const std::vector<std::complex<double>>& f, const MatrixSeries& F,
                   double rest = 0);

/// The response X = A⁻¹B of a dense system, in modal coordinates, over an interval.
struct ResponseSeries {
  Interval interval;
  MatrixSeries x; ///< N × p
  Dense envelope; ///< N × p: |x_ij| at most, anywhere in the interval
  Dense rounding; ///< N × p: the part of x.tail that more digits would lower
  std::vector<double> largest; ///< of a diagonal system: |1/a_i| at most

  /// N × p.
  static ResponseSeries zero(Interval interval, int N, int p, int degree);
};

/// Series that converge more slowly than this are not worth their products.
inline constexpr double slowest = 0.7;

/// Taylor series of the response about the centre of the interval.
///
/// Diagonal systems: 1/(d_0 + d_1 t + d_2 t²) for each mode, with the majorant
/// 1/(|d_0| − |d_1| − |d_2|) for the tail. Others: X_k = −A⁻¹(A_1 X_(k−1) + A_2 X_(k−2) + …) of
/// A = A + A_1 t + …; the tail is what the truncated series leaves of the equation, solved by
/// Neumann's series.
/// @param degree  of the polynomial; an interval without length has degree 0.
/// @param B  loads in modal coordinates, N × p; default: all inputs of the system.
/// @return nothing if a pole is too near for an interval of this length.
std::optional<ResponseSeries> response_series(const DenseResponse& response,
                                              Interval interval, int degree);
std::optional<ResponseSeries> response_series(const DenseResponse& response,
                                              Interval interval, int degree,
                                              const Dense& B);

/// The factors 1/a_i of a diagonal system, one column: what response_series multiplies
/// with the rows of UᵀB.
std::optional<ResponseSeries> modal_factors(const DenseResponse& response,
                                            Interval interval, int degree);

} // namespace flexgram
