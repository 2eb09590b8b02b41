/// Norms of such polynomials over an interval, above and below (docs/proof.md, section 4,
/// "Norms"). Called by ErrorOverBand.

#pragma once

#include "medium/response_series.hpp"
#include "model/port_views.hpp"

#include <array>

namespace flexgram {

/// Equal pieces of an interval, on which norms are bounded one by one.
inline constexpr int pieces = 8;
using Nodes = std::array<double, pieces + 1>;

/// Norms of a view of a matrix polynomial: at the nodes, above and below between them.
struct ViewNorms {
  Nodes at{};
  std::array<double, pieces> above{}, below{};
};

/// Norms of the entries (rows, columns) of a view. Between two nodes a polynomial is no
/// farther from its chord than w²/8 max‖F″‖, so its norm is at most the larger of its ends
/// and that, at least the chord's distance from the origin without that; its tail is added
/// and taken off (docs/proof.md, section 4).
ViewNorms view_norms(const MatrixSeries& series, const PortView& view);

/// ‖·‖_F of a view's tails, and of its entries at the centre.
double tail_of(const MatrixSeries& series, const PortView& view);
double size_of(const MatrixSeries& series, const PortView& view);

/// Bounds of the smaller of two norms.
ViewNorms smaller_of(const ViewNorms& a, const ViewNorms& b);

/// A − B, tails added.
MatrixSeries difference_of(const MatrixSeries& a, MatrixSeries b);

} // namespace flexgram
