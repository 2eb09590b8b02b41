/// Norms of a response with many ports, Σ_i f_i c_i b_iᵀ over the modes i, at a price that
/// does not depend on the ports (docs/proof.md, section 4, "Many ports"). Called by
/// MediumModel, the certificate and ErrorOverBand.

#pragma once

#include "medium/view_norms.hpp"

namespace flexgram {

/// ⟨c_i b_iᵀ, c_j b_jᵀ⟩_F = (c_iᵀc_j)(b_iᵀb_j) of terms of rank one.
struct TermGram {
  TermGram() = default;
  /// @param C, B  n×p_out and n×p_in: a row for each term.
  TermGram(const Dense& C, const Dense& B);
  /// Terms of two kinds: [a, m; mᵀ, b].
  TermGram(const TermGram& a, const Dense& mixed, const TermGram& b);

  int order() const { return Q.rows; }

  Dense Q;                  ///< n×n
  std::vector<double> size; ///< ‖c_i‖‖b_i‖
  double summed = 0;        ///< ports that an entry is a sum over
};

struct TermNorms {
  ViewNorms norms;
  double rounding = 0; ///< what of `above` is the rounding of Q and its products
};

/// Norms over an interval of Σ_i f_i(t) c_i b_iᵀ.
/// @param f  a column: the terms' factors, with their tails.
TermNorms term_norms(const TermGram& gram, const MatrixSeries& f);
/// The same of several factors: the Gram matrix is read once.
std::vector<TermNorms> term_norms(const TermGram& gram,
                                  const std::vector<MatrixSeries>& all);

/// a above b: the factors of a followed by those of b.
MatrixSeries stacked(const MatrixSeries& a, const MatrixSeries& b);

} // namespace flexgram
