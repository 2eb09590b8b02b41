#include "medium/pencil_series.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>

namespace flexgram {
namespace {

using Complex = std::complex<double>;
constexpr double epsilon = std::numeric_limits<double>::epsilon();

/// 1/(d_0 + d_1 t + d_2 t²) of a mode: its series, as far as that is more than rounding; what all of
/// it leaves, and |·| at most.
struct Factor {
  std::vector<Complex> coefficients;
  double left, rounding, largest; ///< the second not in the first
};
std::optional<Factor> factor_of(const PencilModes::Diagonal& d, int degree) {
  const double size = std::abs(d.d0), first = std::abs(d.d1), second = std::abs(d.d2),
               least = size - first - second;
  if (!(first + second <= slowest * size) || !(least > 2 * d.rounding))
    return std::nullopt;
  Factor factor{{1.0 / d.d0}, 0, 0, 1 / (least - d.rounding)};
  double majorant = 1 / size, before = 0;
  for (int k = 1; k <= degree; ++k) {
    Complex next = d.d1 * factor.coefficients.back();
    if (k > 1) next += d.d2 * factor.coefficients[as_size(k) - 2];
    const double next_majorant = (first * majorant + second * before) / size;
    factor.coefficients.push_back(-next / d.d0);
    before = majorant;
    majorant = next_majorant;
  }
  factor.left = (first * majorant + second * (before + majorant)) / least;
  factor.rounding = (d.rounding / least + (16 + 4 * degree) * epsilon) * factor.largest;
  double dropped = std::abs(factor.coefficients.back());
  while (factor.coefficients.size() > 1 && dropped <= epsilon * factor.largest) {
    factor.rounding += std::abs(factor.coefficients.back());
    factor.coefficients.pop_back();
    dropped += std::abs(factor.coefficients.back());
  }
  return factor;
}

} // namespace

/// y = (D + (m − τa)Φ)⁻¹(c + ρ) of the coordinates y in X, Φ and ρ of rounding: with B = |D⁻¹ Φ|
/// and v = |D⁻¹|(|ρ| + |Φ||D⁻¹c|) it is D⁻¹c but for v + Bv + B²v + …
PencilSeries pencil_series(const PencilModes& modes, const PencilModes::Loads& loads,
                           Interval interval, int degree) {
  const int N = modes.X().rows, p = loads.c.columns, count = modes.count();
  std::vector<Factor> factors;
  for (int i = 0; i < count; ++i) {
    auto factor = factor_of(modes.diagonal(interval, i), degree);
    if (!factor) return {true, std::nullopt};
    factors.push_back(std::move(*factor));
  }
  // Rounding, in the coordinates of the modes.
  const double shift = modes.largest_shift(interval);
  Dense largest(count, p);
  for (int j = 0; j < p; ++j)
    for (int i = 0; i < count; ++i)
      largest(i, j) = factors[as_size(i)].largest * loads.sizes(i, j);
  const Dense of_modes = multiply(modes.lost_of_modes(), largest);
  std::vector<double> feedback = modes.sums_of_lost_modes(); // row sums of B
  double most = 0;
  for (int i = 0; i < count; ++i) {
    feedback[as_size(i)] *= shift * factors[as_size(i)].largest;
    most = std::max(most, feedback[as_size(i)]);
  }
  if (!(most <= 0.5)) return {false, std::nullopt};
  Dense lost(count, p), left(count, p); // all of it; without the series' remainder
  for (int j = 0; j < p; ++j) {
    double worst = 0;
    for (int i = 0; i < count; ++i) {
      lost(i, j) =
          factors[as_size(i)].largest * (loads.lost(i, j) + shift * of_modes(i, j));
      worst = std::max(worst, lost(i, j));
    }
    for (int i = 0; i < count; ++i) {
      const Factor& factor = factors[as_size(i)];
      lost(i, j) += 2 * feedback[as_size(i)] * worst;
      const double moved = 2 * lost(i, j) / factor.largest; // of c
      lost(i, j) += factor.rounding * loads.sizes(i, j) +
                    product_rounding(count) * largest(i, j); // the product with X
      left(i, j) = lost(i, j) + factor.left * (loads.sizes(i, j) + moved);
    }
  }
  ResponseSeries series = ResponseSeries::zero(interval, N, p, degree);
  // Modes far away have few coefficients that count.
  std::vector<int> order(as_size(count));
  std::iota(order.begin(), order.end(), 0);
  const auto length = [&](int i) { return factors[as_size(i)].coefficients.size(); };
  std::stable_sort(order.begin(), order.end(),
                   [&](int a, int b) { return length(a) > length(b); });
  const ComplexDense X = columns_of(modes.X(), order);
  for (int k = 0, active = count; k <= degree; ++k) {
    while (active > 0 && length(order[as_size(active - 1)]) <= as_size(k)) --active;
    if (active == 0) break;
    ComplexDense y(active, p);
    for (int j = 0; j < p; ++j)
      for (int a = 0; a < active; ++a) {
        const int i = order[as_size(a)];
        y(a, j) = factors[as_size(i)].coefficients[as_size(k)] * loads.c(i, j);
      }
    const ComplexDense x = multiply_first(X, y);
    series.x.set(k, x);
    for (std::size_t i = 0; i < x.data.size(); ++i)
      series.envelope.data[i] += std::sqrt(std::norm(x.data[i]));
  }
  series.rounding = multiply(modes.sizes(), lost);
  // Slow modes and sharp resonances lose digits here that solves keep.
  for (int j = 0; j < p; ++j) {
    double size = 0, off = 0;
    for (int i = 0; i < N; ++i) {
      size = std::hypot(size, series.envelope(i, j));
      off = std::hypot(off, series.rounding(i, j));
    }
    if (!(off <= modes.negligible() * size)) return {false, std::nullopt};
  }
  series.x.tail = multiply(modes.sizes(), left);
  add_to(series.envelope, series.x.tail);
  return {true, std::move(series)};
}

} // namespace flexgram
