#include "medium/response_series.hpp"

#include "base/index.hpp"
#include "linalg/decompositions.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

namespace flexgram {
namespace {

using Complex = std::complex<double>;
constexpr double epsilon = std::numeric_limits<double>::epsilon();
/// Series that converge more slowly than this are not worth their products.
constexpr double slowest = 0.7;

/// The coefficients of A(ω) = a_k K + a_m M + …, ω = centre + half t, of a mode:
/// d_0 + d_1 t + d_2 t², and how far d_0 may be off by rounding.
struct Diagonal {
  Complex d0, d1, d2;
  double rounding, cancelled; ///< the second is part of the first: by a difference
};
Diagonal diagonal(const DenseResponse& response, Interval interval, int mode) {
  const Damping& damping = response.system().damping;
  const auto at = as_size(mode);
  const double mu = response.mu()[at], lambda = response.lambda()[at],
               k = std::isfinite(lambda) ? mu * lambda : 1.0, c = interval.centre(),
               h = interval.half();
  return {response.diagonal(mode, c),
          Complex(-2 * c * h * mu, h * (k * damping.beta + mu * damping.alpha)),
          -h * h * mu, response.rounding_of_diagonal(mode, c),
          response.rounding_of_difference(mode, c)};
}

void set_coefficient(MatrixSeries& series, int k, const ComplexDense& value) {
  double *re = series.coefficients.column(2 * series.columns * k),
         *im = series.coefficients.column(2 * series.columns * k + series.columns);
  for (std::size_t i = 0; i < value.data.size(); ++i) {
    re[i] = value.data[i].real();
    im[i] = value.data[i].imag();
  }
}

ResponseSeries empty_series(Interval interval, int N, int p, int degree) {
  return {interval,
          {p, Dense(N, 2 * p * (degree + 1)), Dense(N, p)},
          Dense(N, p),
          Dense(N, p),
          {}};
}

std::optional<ResponseSeries> of_modes(const DenseResponse& response, const Dense& B,
                                       Interval interval, int degree) {
  const int N = B.rows, p = B.columns;
  ComplexDense factor(N, degree + 1); // of t^k, of each mode
  std::vector<double> tail, lost, largest;
  for (int i = 0; i < N; ++i) {
    const Diagonal d = diagonal(response, interval, i);
    const double size = std::abs(d.d0), first = std::abs(d.d1), second = std::abs(d.d2),
                 least = size - first - second, rounding = d.rounding;
    if (!(first + second <= slowest * size) || !(least > 2 * rounding))
      return std::nullopt;
    double majorant = 1 / size, before = 0;
    factor(i, 0) = 1.0 / d.d0;
    for (int k = 1; k <= degree; ++k) {
      Complex next = d.d1 * factor(i, k - 1);
      double next_majorant = first * majorant;
      if (k > 1) {
        next += d.d2 * factor(i, k - 2);
        next_majorant += second * before;
      }
      factor(i, k) = -next / d.d0;
      before = majorant;
      majorant = next_majorant / size;
    }
    const double bound = 1 / least, beside = bound / (least - rounding);
    lost.push_back((16 + 4 * degree) * epsilon * bound +
                   (rounding - d.cancelled) * beside);
    tail.push_back((first * majorant + second * (before + majorant)) / least +
                   d.cancelled * beside + lost.back());
    largest.push_back(1 / (least - rounding));
  }
  ResponseSeries series = empty_series(interval, N, p, degree);
  for (int k = 0; k <= degree; ++k)
    for (int j = 0; j < p; ++j) {
      double *re = series.x.coefficients.column(2 * p * k + j),
             *im = series.x.coefficients.column(2 * p * k + p + j);
      for (int i = 0; i < N; ++i) {
        re[i] = factor(i, k).real() * B(i, j);
        im[i] = factor(i, k).imag() * B(i, j);
      }
    }
  for (int j = 0; j < p; ++j)
    for (int i = 0; i < N; ++i) {
      series.x.tail(i, j) = tail[as_size(i)] * std::abs(B(i, j));
      series.rounding(i, j) = lost[as_size(i)] * std::abs(B(i, j));
      series.envelope(i, j) = largest[as_size(i)] * std::abs(B(i, j));
    }
  series.largest = std::move(largest);
  return series;
}

/// An upper bound of the spectral norm: √(‖A‖₁‖A‖∞).
double norm_bound(const ComplexDense& a) {
  std::vector<double> rows(as_size(a.rows), 0.0);
  double one = 0;
  for (int j = 0; j < a.columns; ++j) {
    double column = 0;
    for (int i = 0; i < a.rows; ++i) {
      const double size = std::abs(a(i, j));
      column += size;
      rows[as_size(i)] += size;
    }
    one = std::max(one, column);
  }
  return std::sqrt(one *
                   (rows.empty() ? 0.0 : *std::max_element(rows.begin(), rows.end())));
}

double column_norm(const ComplexDense& a, int j) {
  double sum = 0;
  for (int i = 0; i < a.rows; ++i) sum += std::norm(a(i, j));
  return std::sqrt(sum);
}

std::optional<ResponseSeries> of_solves(const DenseResponse& response, const Dense& B,
                                        Interval interval, int degree) {
  const std::vector<Dense>& terms = response.modal_terms();
  const int N = B.rows, p = B.columns;
  const double c = interval.centre(), h = interval.half();
  // [A⁻¹, A⁻¹A′h, …] by one factorisation; A″ is diagonal.
  ComplexDense A(N, N), right(N, h > 0 ? 2 * N : N);
  std::vector<double> curvature;
  Dense sizes(N, N); // of the entries of A anywhere in the interval
  std::vector<Complex> slopes;
  for (const auto& [law, T] : response.system().terms) slopes.push_back(h * law.slope());
  add_terms(A, response.system().coefficients(c).terms, terms);
  for (int i = 0; i < N; ++i) {
    const Diagonal d = diagonal(response, interval, i);
    A(i, i) += d.d0;
    right(i, i) = 1;
    curvature.push_back(d.d2.real());
    sizes(i, i) = std::abs(d.d0) + d.rounding / epsilon + std::abs(d.d1) + std::abs(d.d2);
    if (h == 0) continue;
    for (std::size_t t = 0; t < terms.size(); ++t)
      for (int j = 0; j < N; ++j) right(j, N + i) += slopes[t] * terms[t](j, i);
    right(i, N + i) += d.d1;
  }
  const std::vector<double> largest = largest_of(response.system().terms, c + h);
  for (std::size_t t = 0; t < terms.size(); ++t)
    for (std::size_t i = 0; i < sizes.data.size(); ++i)
      sizes.data[i] += largest[t] * std::abs(terms[t].data[i]);
  ComplexDense solved;
  try {
    solved = solve(std::move(A), std::move(right));
  } catch (const ShiftError&) {
    return std::nullopt;
  }
  ComplexDense inverse(N, N), slope(N, h > 0 ? N : 0), bend(N, h > 0 ? N : 0);
  std::copy_n(solved.data.begin(), inverse.data.size(), inverse.data.begin());
  std::copy_n(solved.data.begin() + static_cast<std::ptrdiff_t>(inverse.data.size()),
              slope.data.size(), slope.data.begin());
  for (int j = 0; j < bend.columns; ++j)
    for (int i = 0; i < N; ++i) bend(i, j) = inverse(i, j) * curvature[as_size(j)];
  const double away = norm_bound(slope) + norm_bound(bend);
  if (!(away <= slowest)) return std::nullopt;

  ResponseSeries series = empty_series(interval, N, p, degree);
  ComplexDense last(N, p), before; // X_k, X_(k−1)
  for (std::size_t i = 0; i < B.data.size(); ++i) last.data[i] = B.data[i];
  last = multiply(inverse, last);
  std::vector<double> left(as_size(p), 0.0);
  for (int k = 0; k <= degree; ++k) {
    set_coefficient(series.x, k, last);
    for (std::size_t i = 0; i < last.data.size(); ++i)
      series.envelope.data[i] += std::abs(last.data[i]);
    if (h == 0) break;
    ComplexDense next = multiply(slope, last);
    if (k > 0) {
      const ComplexDense curved = multiply(bend, before);
      for (std::size_t i = 0; i < next.data.size(); ++i) next.data[i] += curved.data[i];
    }
    for (auto& x : next.data) x = -x;
    before = std::move(last);
    last = std::move(next);
  }
  if (h > 0) { // `last` is X_(degree + 1): what the series leaves, by Neumann's series
    const ComplexDense beyond = multiply(bend, before);
    for (int j = 0; j < p; ++j)
      left[as_size(j)] += (column_norm(last, j) + column_norm(beyond, j)) / (1 - away);
  }
  // Rounding, entry by entry: |A⁻¹| times that of the equations' terms.
  Dense summed = multiply(sizes, series.envelope), inverse_sizes(N, N);
  for (std::size_t i = 0; i < summed.data.size(); ++i)
    summed.data[i] += std::abs(B.data[i]);
  for (std::size_t i = 0; i < inverse.data.size(); ++i)
    inverse_sizes.data[i] = std::abs(inverse.data[i]);
  const Dense rounding = multiply(inverse_sizes, summed);
  for (int j = 0; j < p; ++j)
    for (int i = 0; i < N; ++i) {
      series.rounding(i, j) = 4 * epsilon * N * rounding(i, j);
      series.x.tail(i, j) = left[as_size(j)] + series.rounding(i, j);
      series.envelope(i, j) += series.x.tail(i, j);
    }
  return series;
}

} // namespace

ComplexDense MatrixSeries::centre() const {
  ComplexDense f(rows(), columns);
  for (std::size_t i = 0; i < f.data.size(); ++i)
    f.data[i] = {real(0)[i], imaginary(0)[i]};
  return f;
}

MatrixSeries from_row(MatrixSeries F, int first) {
  for (Dense* part : {&F.coefficients, &F.tail})
    for (int j = 0; j < part->columns; ++j) std::fill_n(part->column(j), first, 0.0);
  return F;
}

MatrixSeries multiply_transposed(const Dense& A, const MatrixSeries& F) {
  Dense sizes = A;
  for (double& a : sizes.data) a = std::abs(a);
  MatrixSeries product{F.columns, multiply_transposed(A, F.coefficients),
                       multiply_transposed(sizes, F.tail)};
  // Rounding of the sums: at most rows · ε of their absolute values, of which the largest
  // coefficients are the first.
  Dense absolute = first_columns(F.coefficients, 2 * F.columns);
  for (double& a : absolute.data) a = std::abs(a);
  const Dense summed = multiply_transposed(sizes, absolute);
  for (int j = 0; j < F.columns; ++j)
    for (int i = 0; i < product.tail.rows; ++i)
      product.tail(i, j) +=
          2 * epsilon * A.rows * (summed(i, j) + summed(i, F.columns + j));
  return product;
}

MatrixSeries times_quadratic(const std::array<Complex, 3>& f, const MatrixSeries& F) {
  MatrixSeries product{F.columns, Dense(F.rows(), F.coefficients.columns), F.tail};
  const std::size_t count = as_size(F.rows()) * as_size(F.columns);
  const double size = std::abs(f[0]) + std::abs(f[1]) + std::abs(f[2]);
  for (double& t : product.tail.data) t *= size;
  const int degree = F.degree();
  for (int k = 0; k <= degree + 2; ++k)
    for (int l = std::max(0, k - degree); l <= std::min(k, 2); ++l) {
      const double *re = F.real(k - l), *im = F.imaginary(k - l);
      const double a = f[as_size(l)].real(), b = f[as_size(l)].imag();
      if (a == 0 && b == 0) continue;
      if (k > degree) {
        for (std::size_t i = 0; i < count; ++i)
          product.tail.data[i] += std::hypot(a, b) * std::hypot(re[i], im[i]);
        continue;
      }
      double *to_re = product.coefficients.column(2 * F.columns * k),
             *to_im = product.coefficients.column(2 * F.columns * k + F.columns);
      for (std::size_t i = 0; i < count; ++i) {
        to_re[i] += a * re[i] - b * im[i];
        to_im[i] += a * im[i] + b * re[i];
      }
    }
  return product;
}

std::optional<ResponseSeries> response_series(const DenseResponse& response,
                                              Interval interval, int degree) {
  return response_series(response, interval, degree, response.modal_inputs());
}

std::optional<ResponseSeries> response_series(const DenseResponse& response,
                                              Interval interval, int degree,
                                              const Dense& B) {
  if (interval.half() == 0) degree = 0;
  return response.is_diagonal() ? of_modes(response, B, interval, degree)
                                : of_solves(response, B, interval, degree);
}

std::optional<ResponseSeries> modal_factors(const DenseResponse& response,
                                            Interval interval, int degree) {
  if (interval.half() == 0) degree = 0;
  Dense one(response.system().order(), 1);
  for (double& x : one.data) x = 1;
  return of_modes(response, one, interval, degree);
}

} // namespace flexgram
