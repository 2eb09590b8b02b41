#include "linalg/lbfgs.hpp"

#include "base/process.hpp"

#include <algorithm>
#include <cmath>
#include <deque>

namespace flexgram {
namespace {

using Vector = std::vector<double>;

double dot(const Vector& a, const Vector& b) {
  double sum = 0;
  for (std::size_t i = 0; i < a.size(); ++i) sum += a[i] * b[i];
  return sum;
}

/// s = x_{k+1} − x_k and y = g_{k+1} − g_k.
struct Pair {
  Vector s, y;
  double sy;
};

/// −H g with the inverse Hessian that the pairs stand for.
Vector direction(const std::deque<Pair>& pairs, const Vector& g) {
  Vector d = g;
  Vector alpha(pairs.size());
  for (std::size_t k = pairs.size(); k-- > 0;) {
    alpha[k] = dot(pairs[k].s, d) / pairs[k].sy;
    for (std::size_t i = 0; i < d.size(); ++i) d[i] -= alpha[k] * pairs[k].y[i];
  }
  const double scale = pairs.empty()
                           ? 1 / std::max(std::sqrt(dot(g, g)), 1e-300)
                           : pairs.back().sy / dot(pairs.back().y, pairs.back().y);
  for (double& x : d) x *= scale;
  for (std::size_t k = 0; k < pairs.size(); ++k) {
    const double beta = dot(pairs[k].y, d) / pairs[k].sy;
    for (std::size_t i = 0; i < d.size(); ++i) d[i] += (alpha[k] - beta) * pairs[k].s[i];
  }
  for (double& x : d) x = -x;
  return d;
}

/// Where the cubic through two values and slopes is least; the middle if that is outside.
double cubic(double a, double fa, double ga, double b, double fb, double gb) {
  const double d1 = ga + gb - 3 * (fa - fb) / (a - b), square = d1 * d1 - ga * gb;
  const double middle = 0.5 * (a + b), low = std::min(a, b), high = std::max(a, b);
  if (!(square >= 0)) return middle;
  const double d2 = std::copysign(std::sqrt(square), b - a);
  const double t = b - (b - a) * (gb + d2 - d1) / (gb - ga + 2 * d2);
  const double margin = 0.1 * (high - low);
  return t > low + margin && t < high - margin ? t : middle;
}

} // namespace

double minimise(const Objective& f, Vector& x, const LbfgsOptions& options) {
  constexpr double sufficient = 1e-4, flat = 0.9;
  Vector g(x.size()), x_new(x.size()), g_new(x.size());
  double value = f(x, g);
  std::deque<Pair> pairs;
  std::deque<double> before;
  for (int k = 0; k < options.iterations; ++k) {
    stop_if_interrupted();
    const Vector d = direction(pairs, g);
    const double slope = dot(g, d);
    if (!(slope < 0)) break;
    // Bracket, then narrow: `low` is the better end.
    double low = 0, f_low = value, g_low = slope, high = 0, f_high = 0, g_high = 0;
    double t = 1, f_t = value, g_t = 0;
    bool bracketed = false, good = false;
    for (int trial = 0; trial < 25 && !good; ++trial) {
      for (std::size_t i = 0; i < x.size(); ++i) x_new[i] = x[i] + t * d[i];
      f_t = f(x_new, g_new);
      g_t = dot(g_new, d);
      const bool too_high =
          !std::isfinite(f_t) || f_t > value + sufficient * t * slope || f_t >= f_low;
      if (too_high && !(trial == 0 && f_t < value + sufficient * t * slope)) {
        high = t;
        f_high = f_t;
        g_high = g_t;
        bracketed = true;
      } else if (std::abs(g_t) <= -flat * slope) {
        good = true;
        break;
      } else {
        if (bracketed ? g_t * (high - low) >= 0 : g_t >= 0) {
          high = low;
          f_high = f_low;
          g_high = g_low;
          bracketed = true;
        }
        low = t;
        f_low = f_t;
        g_low = g_t;
      }
      if (bracketed && std::abs(high - low) < 1e-12 * std::max(low, high)) break;
      t = !bracketed              ? 2.5 * t
          : std::isfinite(f_high) ? cubic(low, f_low, g_low, high, f_high, g_high)
                                  : 0.5 * (low + high);
    }
    if (!good && !(f_t < value)) break; // no progress along a descent direction
    Pair pair{Vector(x.size()), Vector(x.size()), 0};
    for (std::size_t i = 0; i < x.size(); ++i) {
      pair.s[i] = x_new[i] - x[i];
      pair.y[i] = g_new[i] - g[i];
    }
    pair.sy = dot(pair.s, pair.y);
    if (pair.sy > 1e-12 * std::sqrt(dot(pair.s, pair.s) * dot(pair.y, pair.y))) {
      pairs.push_back(std::move(pair));
      if (static_cast<int>(pairs.size()) > options.history) pairs.pop_front();
    }
    std::swap(x, x_new);
    std::swap(g, g_new);
    value = f_t;
    if (value <= options.enough) break;
    before.push_back(value);
    if (before.size() > 10) {
      if (before.front() - value < 10 * options.decrease) break;
      before.pop_front();
    }
  }
  return value;
}

} // namespace flexgram
