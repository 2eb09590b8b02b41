#include "medium/response_series.hpp"

#include "base/index.hpp"
#include "linalg/decompositions.hpp"
#include "medium/pencil_series.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

namespace flexgram {
namespace {

using Complex = std::complex<double>;
constexpr double epsilon = std::numeric_limits<double>::epsilon();

/// |z| of numbers whose squares do not overflow: faster than std::abs.
double size_of(const Complex& z) { return std::sqrt(std::norm(z)); }

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
    double dropped = 0;
    for (int k = degree; k > 0; --k) {
      dropped += std::abs(factor(i, k));
      if (dropped > epsilon * bound) break;
      factor(i, k) = 0;
    }
    lost.push_back((17 + 4 * degree) * epsilon * bound +
                   (rounding - d.cancelled) * beside);
    tail.push_back((first * majorant + second * (before + majorant)) / least +
                   d.cancelled * beside + lost.back());
    largest.push_back(1 / (least - rounding));
  }
  ResponseSeries series = ResponseSeries::zero(interval, N, p, degree);
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

/// A_0 + A_1 t + … of a system with terms: diagonals, and the terms' matrices times the series
/// of their factors.
struct CoupledSeries {
  CoupledSeries(const DenseResponse& response, Interval of, int degree)
      : interval(of), T(response.modal_terms()),
        symmetric(is_symmetric(response.system().terms)) {
    for (const auto& [law, matrix] : response.system().terms)
      factors.push_back(law.series(of, degree));
    for (int i = 0; i < response.system().order(); ++i)
      diagonals.push_back(diagonal(response, of, i));
  }
  int order() const { return static_cast<int>(diagonals.size()); }

  ComplexDense at_centre(const std::vector<Complex>& g) const {
    ComplexDense A(order(), order());
    add_terms(A, g, T);
    for (int i = 0; i < order(); ++i) A(i, i) += diagonals[as_size(i)].d0;
    return A;
  }
  /// Whether a mode alone shows that the series does not converge fast enough. Only a guess:
  /// terms couple modes.
  bool looks_hopeless(const ComplexDense& A) const {
    constexpr double margin = 1.5;
    for (int i = 0; i < order(); ++i) {
      Complex slope = diagonals[as_size(i)].d1;
      for (std::size_t t = 0; t < T.size(); ++t)
        slope += factors[t].coefficients[1] * T[t](i, i);
      if (std::abs(slope) > margin * slowest * pivot_size(A, i)) return true;
    }
    return false;
  }
  /// A_1 X_k + A_2 X_(k−1) + …. @param X  X_0 … X_k.
  ComplexDense next(const std::vector<ComplexDense>& X) const {
    const std::size_t k = X.size() - 1;
    const int p = X.back().columns;
    ComplexDense sum(order(), p);
    for (int j = 0; j < p; ++j)
      for (int i = 0; i < order(); ++i) {
        const Diagonal& d = diagonals[as_size(i)];
        sum(i, j) = d.d1 * X[k](i, j);
        if (k > 0) sum(i, j) += d.d2 * X[k - 1](i, j);
      }
    for (std::size_t t = 0; t < T.size(); ++t) {
      const std::vector<Complex>& g = factors[t].coefficients;
      ComplexDense x(order(), p);
      for (std::size_t l = 1; l < g.size() && l <= k + 1; ++l)
        if (g[l] != 0.0)
          for (std::size_t i = 0; i < x.data.size(); ++i)
            x.data[i] += g[l] * X[k + 1 - l].data[i];
      const ComplexDense product = multiply(T[t], x);
      for (std::size_t i = 0; i < sum.data.size(); ++i) sum.data[i] += product.data[i];
    }
    return sum;
  }
  /// |A| at most, entry by entry and anywhere in the interval, with its rounding.
  Dense sizes(const std::vector<double>& largest) const {
    Dense sizes(order(), order());
    for (int i = 0; i < order(); ++i) {
      const Diagonal& d = diagonals[as_size(i)];
      sizes(i, i) =
          std::abs(d.d0) + d.rounding / epsilon + std::abs(d.d1) + std::abs(d.d2);
    }
    for (std::size_t t = 0; t < T.size(); ++t)
      for (std::size_t i = 0; i < sizes.data.size(); ++i)
        sizes.data[i] += largest[t] * std::abs(T[t].data[i]);
    return sizes;
  }

  Interval interval;
  const std::vector<Dense>& T;
  bool symmetric;
  std::vector<LawSeries> factors;
  std::vector<Diagonal> diagonals;
};

/// ‖A⁻¹(A(ω) − A)‖ at most, anywhere in the interval, and its parts that the remainder of a
/// series needs: in the norm ‖D⁻¹x‖ of a diagonal D that balances A⁻¹A_1. Slow modes beside fast
/// ones are large in the Euclidean norm, by the ratio of their frequencies.
struct Distance {
  Distance(const CoupledSeries& A, const ComplexDense& inverse) {
    const int N = A.order();
    ComplexDense slope(N, N), bend(N, N);
    for (int j = 0; j < N; ++j) {
      const Diagonal& d = A.diagonals[as_size(j)];
      for (int i = 0; i < N; ++i) {
        slope(i, j) = inverse(i, j) * d.d1;
        bend(i, j) = inverse(i, j) * d.d2;
      }
    }
    std::vector<ComplexDense> of_moving; // (A⁻¹T)ᵀ
    // The transpose of A⁻¹T is TᵀA⁻ᵀ: TA⁻¹ where both are symmetric.
    const ComplexDense of_transposed = A.symmetric ? ComplexDense() : transpose(inverse);
    for (std::size_t t = 0; t < A.T.size(); ++t) {
      const LawSeries& g = A.factors[t];
      if (g.moved() == 0) {
        of_moving.emplace_back();
        continue;
      }
      ComplexDense transposed = A.symmetric ? multiply(A.T[t], inverse)
                                            : multiply(transpose(A.T[t]), of_transposed);
      for (int j = 0; j < N; ++j)
        for (int i = 0; i < N; ++i) slope(i, j) += g.coefficients[1] * transposed(j, i);
      of_moving.push_back(std::move(transposed));
    }
    D = balancing(slope);
    curved = norm_bound(balanced(bend, D));
    whole = curved + norm_bound(balanced(slope, D));
    std::vector<double> inverse_D;
    for (double d : D) inverse_D.push_back(1 / d);
    for (std::size_t t = 0; t < of_moving.size(); ++t) {
      of_terms.push_back(norm_bound(balanced(of_moving[t], inverse_D)));
      whole += of_terms.back() * A.factors[t].beyond_linear();
    }
  }
  /// Of a column what t^(degree + 2) and further powers leave of the equation, and the rests of
  /// the factors. @param X  X_0 … X_degree.
  double left(const CoupledSeries& A, const std::vector<ComplexDense>& X,
              int column) const {
    double sum = curved * norm(X.back(), column);
    for (std::size_t t = 0; t < of_terms.size(); ++t) {
      const LawSeries& g = A.factors[t];
      if (g.beyond_linear() == 0) continue;
      for (std::size_t k = 0; k < X.size(); ++k) {
        double beyond = g.rest;
        for (std::size_t l = X.size() + 1 - k; l < g.coefficients.size(); ++l)
          beyond += std::abs(g.coefficients[l]);
        sum += of_terms[t] * beyond * norm(X[k], column);
      }
    }
    return sum;
  }

  double norm(const ComplexDense& x, int column) const {
    double sum = 0;
    for (int i = 0; i < x.rows; ++i) sum += std::norm(x(i, column) / D[as_size(i)]);
    return std::sqrt(sum);
  }

  std::vector<double> D;
  double whole = 0, curved = 0; ///< the second: of A_2's diagonal
  std::vector<double> of_terms; ///< ‖A⁻¹T‖
};

std::optional<ResponseSeries> of_solves(const DenseResponse& response, const Dense& B,
                                        Interval interval, int degree) {
  const int N = B.rows, p = B.columns;
  const std::vector<Term<Dense>>& terms = response.system().terms;
  const CoupledSeries A(response, interval, degree);
  ComplexDense centre =
      A.at_centre(response.system().coefficients(interval.centre()).terms);
  const bool is_point = interval.half() == 0;
  if (!is_point && A.looks_hopeless(centre)) return std::nullopt;
  ComplexDense inverse(N, N);
  for (int i = 0; i < N; ++i) inverse(i, i) = 1;
  try {
    inverse = solve(std::move(centre), std::move(inverse));
  } catch (const ShiftError&) {
    return std::nullopt;
  }
  std::optional<Distance> away;
  if (!is_point && !(away.emplace(A, inverse).whole <= slowest)) return std::nullopt;

  ResponseSeries series = ResponseSeries::zero(interval, N, p, degree);
  std::vector<ComplexDense> X(1, ComplexDense(N, p)); // X_0 … X_k
  std::copy(B.data.begin(), B.data.end(), X[0].data.begin());
  X[0] = multiply(inverse, X[0]);
  for (int k = 0; k <= degree; ++k) {
    series.x.set(k, X.back());
    for (std::size_t i = 0; i < X.back().data.size(); ++i)
      series.envelope.data[i] += size_of(X.back().data[i]);
    if (is_point) break;
    ComplexDense next = multiply(inverse, A.next(X));
    for (auto& x : next.data) x = -x;
    if (k < degree)
      X.push_back(std::move(next));
    else // what the series leaves, by Neumann's series
      for (int j = 0; j < p; ++j) {
        const double left =
            (away->norm(next, j) + away->left(A, X, j)) / (1 - away->whole);
        for (int i = 0; i < N; ++i) series.x.tail(i, j) = left * away->D[as_size(i)];
      }
  }
  // Rounding, entry by entry: |A⁻¹| times that of the equations' terms.
  Dense summed = multiply(A.sizes(largest_of(terms, interval.last)), series.envelope),
        inverse_sizes(N, N);
  for (std::size_t i = 0; i < summed.data.size(); ++i)
    summed.data[i] += std::abs(B.data[i]);
  for (std::size_t i = 0; i < inverse.data.size(); ++i)
    inverse_sizes.data[i] = size_of(inverse.data[i]);
  const Dense rounding = multiply(inverse_sizes, summed);
  for (int j = 0; j < p; ++j)
    for (int i = 0; i < N; ++i) {
      series.rounding(i, j) = 4 * epsilon * N * rounding(i, j);
      series.x.tail(i, j) += series.rounding(i, j);
      series.envelope(i, j) += series.x.tail(i, j);
    }
  return series;
}

} // namespace

void MatrixSeries::set(int k, const ComplexDense& value) {
  double *re = coefficients.column(2 * columns * k),
         *im = coefficients.column(2 * columns * k + columns);
  for (std::size_t i = 0; i < value.data.size(); ++i) {
    re[i] = value.data[i].real();
    im[i] = value.data[i].imag();
  }
}

ResponseSeries ResponseSeries::zero(Interval interval, int N, int p, int degree) {
  return {interval,
          {p, Dense(N, 2 * p * (degree + 1)), Dense(N, p)},
          Dense(N, p),
          Dense(N, p),
          {}};
}

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

namespace {

/// [first, last) of the rows of these columns that are not zero.
std::pair<int, int> rows_that_count(const Dense& a, int column, int columns) {
  int first = a.rows, last = 0;
  for (int j = column; j < column + columns; ++j) {
    const double* x = a.column(j);
    for (int i = 0; i < first; ++i)
      if (x[i] != 0) first = i;
    for (int i = a.rows; i-- > last;)
      if (x[i] != 0) last = i + 1;
  }
  return {std::min(first, last), last};
}

} // namespace

MatrixSeries multiply_transposed(const Dense& A, const Dense& sizes,
                                 const MatrixSeries& F) {
  const int each = 2 * F.columns;
  MatrixSeries product{F.columns, Dense(A.columns, F.coefficients.columns), {}};
  // Modes far from the interval have few coefficients, and those near it stand together.
  std::vector<std::pair<int, int>> rows;
  for (int k = 0; k <= F.degree(); ++k)
    rows.push_back(rows_that_count(F.coefficients, each * k, each));
  for (int k = 0, end = 0; k <= F.degree(); k = end) {
    const auto [first, last] = rows[as_size(k)];
    while (end <= F.degree() && rows[as_size(end)] == rows[as_size(k)]) ++end;
    multiply_rows_transposed(A, F.coefficients, first, last, each * k, each * (end - k),
                             product.coefficients);
  }
  // Rounding of the sums: at most rows · ε of their absolute values, of which the largest
  // coefficients are the first.
  Dense off = F.tail;
  for (int j = 0; j < F.columns; ++j)
    for (int i = 0; i < off.rows; ++i)
      off(i, j) +=
          2 * epsilon * A.rows *
          (std::abs(F.coefficients(i, j)) + std::abs(F.coefficients(i, F.columns + j)));
  product.tail = multiply_transposed(sizes, off);
  return product;
}

MatrixSeries multiply_transposed(const Dense& A, const MatrixSeries& F) {
  return multiply_transposed(A, absolute(A), F);
}

MatrixSeries times(const std::vector<Complex>& f, const MatrixSeries& F, double rest) {
  MatrixSeries product{F.columns, Dense(F.rows(), F.coefficients.columns), F.tail};
  const std::size_t count = as_size(F.rows()) * as_size(F.columns);
  double size = rest;
  for (const Complex& x : f) size += std::abs(x);
  for (double& t : product.tail.data) t *= size;
  const int degree = F.degree(), most = static_cast<int>(f.size()) - 1;
  for (int k = 0; k <= degree; ++k) {
    double left = rest; // of f, beyond this degree with F's k-th coefficient
    for (int l = degree - k + 1; l <= most; ++l) left += std::abs(f[as_size(l)]);
    if (left == 0) continue;
    for (std::size_t i = 0; i < count; ++i)
      product.tail.data[i] += left * size_of({F.real(k)[i], F.imaginary(k)[i]});
  }
  for (int k = 0; k <= degree; ++k)
    for (int l = 0; l <= std::min(k, most); ++l) {
      const double *re = F.real(k - l), *im = F.imaginary(k - l);
      const double a = f[as_size(l)].real(), b = f[as_size(l)].imag();
      if (a == 0 && b == 0) continue;
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
  if (response.is_diagonal()) return of_modes(response, B, interval, degree);
  if (const PencilModes* modes = response.pencil()) {
    const bool are_own = &B == &response.modal_inputs();
    PencilSeries by_modes = pencil_series(
        *modes, are_own ? modes->own_loads() : modes->loads(B), interval, degree);
    if (by_modes.is_known) return std::move(by_modes.series);
  }
  return of_solves(response, B, interval, degree);
}

std::optional<ResponseSeries> modal_factors(const DenseResponse& response,
                                            Interval interval, int degree) {
  if (interval.half() == 0) degree = 0;
  Dense one(response.system().order(), 1);
  for (double& x : one.data) x = 1;
  return of_modes(response, one, interval, degree);
}

} // namespace flexgram
