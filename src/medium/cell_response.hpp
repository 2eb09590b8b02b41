/// Responses, their residuals and norms over a cell of (ω, p), by series to second order and what
/// these leave (docs/proof.md, section 5). Used by cell_bound.cpp.

#pragma once

#include "medium/cell_series.hpp"

#include <algorithm>
#include <optional>

namespace flexgram {

/// Rounding of projected matrices, an estimate, relative to what they add up from: of LᵀAR that is
/// √(tr LᵀAL tr RᵀAR).
inline constexpr double cell_rounding = 1e-13;

/// x = (RᵀAR)⁻¹RᵀP over a cell, scaled: R x is `scale` times.
struct CellResponse {
  bool known = false;
  std::vector<double> by_variable; ///< what A moves by along each, relative
  std::size_t longest() const {
    return as_size(std::max_element(by_variable.begin(), by_variable.end()) -
                   by_variable.begin());
  }
  std::vector<double> scale;
  CellSeries x;
  std::vector<double> sizes;    ///< of each column of x, at most
  std::vector<double> tails;    ///< what the series leaves of each
  double inverse = 0;           ///< ‖(RᵀAR)⁻¹‖ at most, scaled
  ComplexDense at_centre;       ///< (RᵀAR)⁻¹ there, scaled
  double moved = 0;             ///< it differs from that by no more
  CellSeries G;                 ///< (RᵀAR)⁻¹ at the centre times RᵀAR beyond that
  double of_rest = 0, of_G = 0; ///< the same of what the series leave; norms together
};

/// @param matrices  K, M and terms between the columns of R. @param ports  RᵀP
CellResponse cell_response(const Cell& cell, const CellFactors& factors,
                           const Matrices& matrices, const Dense& ports);

/// ports − A R x over the cell.
struct CellResidual {
  CellSeries y;
  std::vector<double> tails; ///< of each column
  double norm = 0;           ///< ‖A R scale‖ at most
  ComplexDense at_centre;    ///< A R scale there
  double moved = 0;          ///< it differs from that by no more
};

/// @param matrices  K, M and terms between some space and R.
/// @param sizes     what each of these adds up from, columns of R times `scale`.
CellResidual cell_residual(const CellResponse& of, const CellFactors& factors,
                           const Matrices& matrices, const Dense& ports,
                           const std::vector<double>& sizes);

/// What a product yᵀz of two series is at most.
struct CellProduct {
  CellSeries yz;
  std::vector<double> y_size, y_tail, z_size, z_error; ///< of each column

  /// ‖·‖_F of a block, at most.
  double of(const std::vector<int>& rows, const std::vector<int>& columns) const;
};

/// Another model of the same space: its response, and K, M and terms between R and it.
struct CellModel {
  const CellResponse& response;
  const Matrices& matrices;
};
/// yᵀ(RᵀAR)⁻¹ of residuals: of inputs with A, and y of outputs with Aᵀ.
/// @param inputs, outputs  the other model with A and with Aᵀ. @param ports  RᵀP.
/// @param sizes  what the matrices add up from, scaled on both sides.
CellProduct cell_product(const CellResponse& of, const CellModel& inputs,
                         const CellModel& outputs, const CellFactors& factors,
                         const Dense& ports, const std::vector<double>& sizes);

/// Of each matrix √(Σ_i s_i² |A_ii|), or √‖s A s‖_F where that is more: A may have no sign.
/// @param scale  none: 1
std::vector<double> diagonal_sizes(const Matrices& matrices,
                                   const std::vector<double>& scale = {});

/// (Σσ⁴)^¼ of some columns over the cell, at most: a norm, so the linear part is largest at a
/// corner.
class FourNorms {
public:
  FourNorms(const CellSeries& series, std::vector<double> tails);
  double of(const std::vector<int>& columns) const;

private:
  std::vector<ComplexDense> corners_, others_; ///< Gram matrices
  std::vector<double> tails_;
};

/// Of each column the sum of the norms of its coefficients.
std::vector<double> column_sums(const CellSeries& series, int columns);
/// Of some of these numbers.
double root_of_squares(const std::vector<double>& of, const std::vector<int>& chosen);

} // namespace flexgram
