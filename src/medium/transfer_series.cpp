#include "medium/transfer_series.hpp"

#include "base/index.hpp"
#include "linalg/decompositions.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

namespace flexgram {
namespace {

using Long = long double;
using LongComplex = std::complex<Long>;
using LongDense = DenseOf<LongComplex>;
constexpr double epsilon = std::numeric_limits<double>::epsilon();
/// Rounding of the numbers below beside that of doubles: 2⁻¹¹, with room.
const double finer =
    std::numeric_limits<Long>::epsilon() < epsilon / 1024 ? 0x1p-10 : 1.0;

/// PA = LU of a small matrix.
class LongFactors {
public:
  explicit LongFactors(LongDense A) : A_(std::move(A)) {
    const int n = A_.rows;
    for (int k = 0; k < n; ++k) {
      int pivot = k;
      for (int i = k + 1; i < n; ++i)
        if (std::norm(A_(i, k)) > std::norm(A_(pivot, k))) pivot = i;
      pivots_.push_back(pivot);
      for (int j = 0; j < n && pivot != k; ++j) std::swap(A_(k, j), A_(pivot, j));
      for (int i = k + 1; i < n; ++i) A_(i, k) /= A_(k, k);
      for (int j = k + 1; j < n; ++j)
        for (int i = k + 1; i < n; ++i) A_(i, j) -= A_(i, k) * A_(k, j);
    }
  }
  void solve(LongComplex* x) const {
    const int n = A_.rows;
    for (int k = 0; k < n; ++k) std::swap(x[k], x[pivots_[as_size(k)]]);
    for (int k = 0; k < n; ++k)
      for (int i = k + 1; i < n; ++i) x[i] -= A_(i, k) * x[k];
    for (int k = n; k-- > 0;) {
      x[k] /= A_(k, k);
      for (int i = 0; i < k; ++i) x[i] -= A_(i, k) * x[k];
    }
  }

private:
  LongDense A_;
  std::vector<int> pivots_;
};

/// Coefficients of A(ω) = A_0 + A_1 t + A_2 t² beside those of the terms, ω = c + h t.
struct LongDiagonals {
  std::vector<LongComplex> a0, a1;
  std::vector<Long> a2;

  LongDiagonals(const ModalNumbers& numbers, Interval interval) {
    const Damping& d = numbers.damping;
    const Long c = static_cast<Long>(interval.centre()),
               h = static_cast<Long>(interval.half()), eta = static_cast<Long>(d.eta);
    for (std::size_t i = 0; i < numbers.k.size(); ++i) {
      const Long k = numbers.k[i], m = numbers.m[i],
                 viscous = k * static_cast<Long>(d.beta) + m * static_cast<Long>(d.alpha);
      a0.emplace_back(k - c * c * m, k * eta + c * viscous);
      a1.emplace_back(-2 * c * h * m, h * viscous);
      a2.push_back(-h * h * m);
    }
  }
};

/// T Σ g_l X_(k−l), l >= 2, of a term whose factor is no linear function of ω.
/// @param X  X_0 … X_(k−1).
void subtract_further(const Dense& T, const std::vector<LongComplex>& g,
                      const std::vector<LongDense>& X, LongDense& next) {
  if (g.size() <= 2 || X.size() < 2) return;
  LongDense sum(next.rows, next.columns);
  for (std::size_t l = 2; l < g.size() && l <= X.size(); ++l)
    for (std::size_t i = 0; i < sum.data.size(); ++i)
      sum.data[i] += g[l] * X[X.size() - l].data[i];
  for (int j = 0; j < next.columns; ++j)
    for (int l = 0; l < T.columns; ++l)
      for (int i = 0; i < T.rows; ++i)
        next(i, j) -= static_cast<Long>(T(i, l)) * sum(l, j);
}

/// X_0, X_1, … of X = A⁻¹B.
std::vector<LongDense> response_in_long_double(const ModalNumbers& numbers,
                                               Interval interval, int degree) {
  const int N = numbers.order(), p = numbers.B.columns;
  const bool coupled = !numbers.terms.empty();
  const LongDiagonals diagonals(numbers, interval);
  std::optional<LongFactors> factors;
  LongDense A(coupled ? N : 0, coupled ? N : 0), slope = A; // of the terms, of t^0 and t
  std::vector<std::vector<LongComplex>> laws;
  for (const auto& [law, T] : numbers.terms) {
    laws.push_back(law.kind().coefficients(interval, degree));
    const std::vector<LongComplex>& g = laws.back();
    for (std::size_t i = 0; i < T.data.size(); ++i) {
      A.data[i] += g[0] * static_cast<Long>(T.data[i]);
      slope.data[i] += g[1] * static_cast<Long>(T.data[i]);
    }
  }
  if (coupled) {
    for (int i = 0; i < N; ++i) A(i, i) += diagonals.a0[as_size(i)];
    factors.emplace(std::move(A));
  }
  std::vector<LongDense> X;
  for (int k = 0; k <= degree; ++k) {
    LongDense next(N, p);
    for (std::size_t t = 0; t < laws.size(); ++t)
      subtract_further(numbers.terms[t].matrix, laws[t], X, next);
    for (int j = 0; j < p; ++j) {
      LongComplex* x = next.column(j);
      for (int i = 0; i < N; ++i) {
        const auto at = as_size(i);
        if (k == 0) x[i] = static_cast<Long>(numbers.B(i, j));
        if (k > 0) x[i] -= diagonals.a1[at] * X.back()(i, j);
        if (k > 1) x[i] -= diagonals.a2[at] * X[as_size(k - 2)](i, j);
        if (!coupled) x[i] /= diagonals.a0[at];
      }
      for (int l = 0; l < N && k > 0 && coupled; ++l)
        for (int i = 0; i < N; ++i) x[i] -= slope(i, l) * X.back()(l, j);
      if (coupled) factors->solve(x);
    }
    X.push_back(std::move(next));
  }
  return X;
}

double largest_of(const double* values, std::size_t count) {
  double largest = 0;
  for (std::size_t i = 0; i < count; ++i)
    largest = std::max(largest, std::abs(values[i]));
  return largest;
}

} // namespace

std::optional<ModalNumbers> ModalNumbers::of(const DenseSystem& system) {
  ModalNumbers numbers;
  const int N = system.order();
  for (int j = 0; j < N; ++j) {
    for (int i = 0; i < N; ++i)
      if (i != j && (system.K(i, j) != 0 || system.M(i, j) != 0)) return std::nullopt;
    numbers.k.push_back(static_cast<Long>(system.K(j, j)));
    numbers.m.push_back(static_cast<Long>(system.M(j, j)));
  }
  numbers.terms = system.terms;
  numbers.damping = system.damping;
  numbers.B = system.B;
  numbers.C = system.outputs_are_inputs ? system.B : system.C;
  return numbers;
}

ModalNumbers ModalNumbers::of(const DenseResponse& response, Dense B, Dense C) {
  ModalNumbers numbers;
  for (std::size_t j = 0; j < response.mu().size(); ++j) {
    const Long mu = static_cast<Long>(response.mu()[j]);
    const double lambda = response.lambda()[j];
    numbers.k.push_back(std::isfinite(lambda) ? mu * static_cast<Long>(lambda) : Long(1));
    numbers.m.push_back(mu);
  }
  for (std::size_t t = 0; t < response.modal_terms().size(); ++t)
    numbers.terms.push_back({response.system().terms[t].law, response.modal_terms()[t]});
  numbers.damping = response.system().damping;
  numbers.B = std::move(B);
  numbers.C = std::move(C);
  return numbers;
}

double size_at_centre(const MatrixSeries& H) {
  return largest_of(H.coefficients.data.data(), 2 * H.tail.data.size());
}

MatrixSeries transfer_series(const Dense& C, const ResponseSeries& x, int first,
                             const ModalNumbers* numbers, double size) {
  constexpr double clear = 1e-11; // a tail beside H that is not worth more digits
  constexpr int most = 200, most_with_dampers = 100, most_entries = 64;
  const MatrixSeries X = from_row(x.x, first);
  MatrixSeries H = multiply_transposed(C, X);
  const std::size_t entries = H.tail.data.size();
  const double tail = largest_of(H.tail.data.data(), entries);
  if (size == 0) size = size_at_centre(H);
  if (!numbers || !(tail > clear * size) || finer == 1 || entries > most_entries ||
      numbers->order() > (numbers->terms.empty() ? most : most_with_dampers))
    return H;
  Dense left = X.tail, rounding = x.rounding, terms = x.envelope;
  for (Dense* part : {&rounding, &terms})
    for (int j = 0; j < part->columns; ++j) std::fill_n(part->column(j), first, 0.0);
  for (std::size_t i = 0; i < left.data.size(); ++i)
    left.data[i] = std::max(left.data[i] - rounding.data[i], 0.0) +
                   finer * (rounding.data[i] + 4 * epsilon * C.rows * terms.data[i]);
  Dense finer_tail = multiply_transposed(absolute(C), left);
  if (!(largest_of(finer_tail.data.data(), entries) < 0.5 * tail)) return H;
  const int degree = H.degree();
  const auto response = response_in_long_double(*numbers, x.interval, degree);
  for (int k = 0; k <= degree; ++k)
    for (int j = 0; j < H.columns; ++j)
      for (int i = 0; i < H.rows(); ++i) {
        LongComplex sum = 0;
        for (int l = first; l < numbers->order(); ++l)
          sum += static_cast<Long>(numbers->C(l, i)) * response[as_size(k)](l, j);
        const std::complex<double> value(static_cast<double>(sum.real()),
                                         static_cast<double>(sum.imag()));
        H.coefficients(i, 2 * H.columns * k + j) = value.real();
        H.coefficients(i, 2 * H.columns * k + H.columns + j) = value.imag();
        finer_tail(i, j) += epsilon * std::abs(value);
      }
  H.tail = std::move(finer_tail);
  return H;
}

MatrixSeries scale_outputs(const OutputForm& form, Interval interval, MatrixSeries H) {
  if (!form.has_factors()) return H;
  const int degree = H.degree(), n_in = H.columns;
  for (int i = 0; i < H.rows(); ++i) {
    const std::complex<double> f0 = form.factor(i, interval.centre()),
                               f1 = form.slope(i) * interval.half();
    if (f0 == 1.0 && f1 == 0.0) continue;
    for (int j = 0; j < n_in; ++j) {
      const auto at = [&](int k) {
        return std::complex<double>(H.coefficients(i, 2 * n_in * k + j),
                                    H.coefficients(i, 2 * n_in * k + n_in + j));
      };
      double& tail = H.tail(i, j);
      tail = tail * (std::abs(f0) + std::abs(f1)) + std::abs(f1) * std::abs(at(degree));
      for (int k = degree; k >= 0; --k) {
        const std::complex<double> value =
            f0 * at(k) + (k > 0 ? f1 * at(k - 1) : std::complex<double>());
        H.coefficients(i, 2 * n_in * k + j) = value.real();
        H.coefficients(i, 2 * n_in * k + n_in + j) = value.imag();
        tail += 4 * epsilon * std::abs(value);
      }
    }
  }
  return H;
}

MatrixSeries complete_outputs(const OutputForm& form, Interval interval, MatrixSeries H) {
  H = scale_outputs(form, interval, std::move(H));
  if (!form.has_direct()) return H;
  for (int j = 0; j < H.columns; ++j)
    for (int i = 0; i < H.rows(); ++i) {
      double& value = H.coefficients(i, j);
      value += form.direct()(i, j);
      H.tail(i, j) += epsilon * std::abs(value);
    }
  return H;
}

} // namespace flexgram
