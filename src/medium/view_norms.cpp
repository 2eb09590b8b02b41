#include "medium/view_norms.hpp"

#include "base/index.hpp"

#include <algorithm>
#include <cmath>

namespace flexgram {

ViewNorms view_norms(const MatrixSeries& series, const PortView& view) {
  const int degree_here = series.degree(), rows = series.rows();
  ViewNorms norms;
  double bend = 0;           // Σ k(k − 1)‖F_k‖ >= max‖F″‖
  std::vector<double> parts; // the view's entries, coefficient after coefficient
  for (int k = 0; k <= degree_here; ++k) {
    const double *re = series.real(k), *im = series.imaginary(k);
    double square = 0;
    for (int j : view.columns)
      for (int i : view.rows) {
        const auto at = as_size(i) + as_size(j) * as_size(rows);
        parts.push_back(re[at]);
        parts.push_back(im[at]);
        square += re[at] * re[at] + im[at] * im[at];
      }
    bend += k * (k - 1) * std::sqrt(square);
  }
  const std::size_t count = 2 * view.rows.size() * view.columns.size();
  const double width = 2.0 / pieces,
               away = bend * width * width / 8 + tail_of(series, view);

  std::vector<double> last(count), next(count);
  for (int node = 0; node <= pieces; ++node) {
    const double t = -1 + node * width;
    std::fill(next.begin(), next.end(), 0.0);
    for (int k = degree_here; k >= 0; --k) {
      const double* part = parts.data() + as_size(k) * count;
      for (std::size_t i = 0; i < count; ++i) next[i] = next[i] * t + part[i];
    }
    double square = 0, along = 0, across = 0; // of the chord from `last` to `next`
    for (std::size_t i = 0; i < count; ++i) {
      square += next[i] * next[i];
      const double step = next[i] - last[i];
      along -= last[i] * step;
      across += step * step;
    }
    const auto at = as_size(node);
    norms.at[at] = std::sqrt(square);
    if (node > 0) {
      const double a = norms.at[at - 1], b = norms.at[at];
      double least = std::min(a, b);
      if (along > 0 && along < across) // the foot of the perpendicular is on the chord
        least = std::sqrt(std::max(a * a - along * along / across - 1e-14 * a * a, 0.0));
      norms.above[at - 1] = std::max(a, b) + away;
      norms.below[at - 1] = std::max(least - away, 0.0);
    }
    std::swap(last, next);
  }
  return norms;
}

double tail_of(const MatrixSeries& series, const PortView& view) {
  double square = 0;
  for (int j : view.columns)
    for (int i : view.rows) square += series.tail(i, j) * series.tail(i, j);
  return std::sqrt(square);
}

double size_of(const MatrixSeries& series, const PortView& view) {
  double square = 0;
  for (int j : view.columns)
    for (int i : view.rows) {
      const auto at = as_size(i) + as_size(j) * as_size(series.rows());
      square += series.real(0)[at] * series.real(0)[at] +
                series.imaginary(0)[at] * series.imaginary(0)[at];
    }
  return std::sqrt(square);
}

ViewNorms smaller_of(const ViewNorms& a, const ViewNorms& b) {
  ViewNorms smaller;
  for (std::size_t i = 0; i < smaller.at.size(); ++i)
    smaller.at[i] = std::min(a.at[i], b.at[i]);
  for (std::size_t i = 0; i < pieces; ++i) {
    smaller.above[i] = std::min(a.above[i], b.above[i]);
    smaller.below[i] = std::min(a.below[i], b.below[i]);
  }
  return smaller;
}

MatrixSeries difference_of(const MatrixSeries& a, MatrixSeries b) {
  for (std::size_t i = 0; i < b.coefficients.data.size(); ++i)
    b.coefficients.data[i] = a.coefficients.data[i] - b.coefficients.data[i];
  add_to(b.tail, a.tail);
  return b;
}

} // namespace flexgram
