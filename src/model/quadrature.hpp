#pragma once

#include <vector>

namespace flexgram {

enum class QuadratureRule {
  midpoint,       ///< the paper's, with its weight h/(s−1) corrected to h/s
  gauss,          ///< Legendre
  clenshaw_curtis ///< nested in its doubling, with both ends
};

/// "midpoint", "gauss", "clenshaw_curtis".
const char* word_of(QuadratureRule rule);

/// Nodes and weights with ∫ f dω ≈ Σ w_l f(ω_l) over [first, last].
struct Quadrature {
  std::vector<double> omega;  ///< [rad/s], ascending
  std::vector<double> weight; ///< [rad/s], positive
};

/// @param logarithmic  the rule in ln ω, weights times ω.
/// @param count    number of nodes s ≥ 1; a band of one frequency gets one node of
/// weight 1.
/// @throws Error for a logarithmic band that starts at zero.
Quadrature band_quadrature(double first, double last, int count,
                           QuadratureRule rule = QuadratureRule::gauss,
                           bool logarithmic = false);

} // namespace flexgram
