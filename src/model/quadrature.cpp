#include "model/quadrature.hpp"

#include "base/error.hpp"

#include <cmath>
#include <numbers>

namespace flexgram {
namespace {

using std::numbers::pi;

/// Rules on [−1, 1], nodes ascending.
Quadrature midpoint(int count) {
  Quadrature q;
  for (int l = 0; l < count; ++l) {
    q.omega.push_back(-1 + (2.0 * l + 1) / count);
    q.weight.push_back(2.0 / count);
  }
  return q;
}

/// Newton's method on the Legendre polynomial, from the Chebyshev-like first guess.
Quadrature gauss(int count) {
  Quadrature q;
  for (int l = count; l >= 1; --l) {
    double x = std::cos(pi * (l - 0.25) / (count + 0.5)), slope = 0;
    for (int step = 0; step < 100; ++step) {
      double p = 1, previous = 0;
      for (int k = 1; k <= count; ++k) {
        const double next = ((2 * k - 1) * x * p - (k - 1) * previous) / k;
        previous = p;
        p = next;
      }
      slope = count * (x * p - previous) / (x * x - 1);
      const double change = p / slope;
      x -= change;
      if (std::abs(change) < 1e-16) break;
    }
    q.omega.push_back(x);
    q.weight.push_back(2 / ((1 - x * x) * slope * slope));
  }
  return q;
}

/// Weights by the closed cosine sum (Waldvogel 2006, eq. 2.4 written out).
Quadrature clenshaw_curtis(int count) {
  if (count == 1) return {{0.0}, {2.0}};
  const int intervals = count - 1;
  Quadrature q;
  for (int l = intervals; l >= 0; --l) {
    double sum = 0;
    for (int j = 1; 2 * j <= intervals; ++j)
      sum += (2 * j == intervals ? 1.0 : 2.0) / (4.0 * j * j - 1) *
             std::cos(2 * pi * j * l / intervals);
    const double ends = l == 0 || l == intervals ? 1.0 : 2.0;
    q.omega.push_back(std::cos(pi * l / intervals));
    q.weight.push_back(ends / intervals * (1 - sum));
  }
  return q;
}

} // namespace

Quadrature band_quadrature(double first, double last, int count, QuadratureRule rule,
                           bool logarithmic) {
  if (first == last) return {{first}, {1.0}};
  if (logarithmic && first <= 0)
    throw Error("{spacing} log: the band must start above zero");
  Quadrature q = rule == QuadratureRule::gauss             ? gauss(count)
                 : rule == QuadratureRule::clenshaw_curtis ? clenshaw_curtis(count)
                                                           : midpoint(count);
  const double a = logarithmic ? std::log(first) : first;
  const double b = logarithmic ? std::log(last) : last;
  for (std::size_t l = 0; l < q.omega.size(); ++l) {
    const double t = 0.5 * (a + b) + 0.5 * (b - a) * q.omega[l];
    q.omega[l] = logarithmic ? std::exp(t) : t;
    q.weight[l] *= 0.5 * (b - a) * (logarithmic ? q.omega[l] : 1.0);
  }
  return q;
}

const char* word_of(QuadratureRule rule) {
  switch (rule) {
  case QuadratureRule::midpoint:
    return "midpoint";
  case QuadratureRule::gauss:
    return "gauss";
  case QuadratureRule::clenshaw_curtis:
    break;
  }
  return "clenshaw_curtis";
}

} // namespace flexgram
