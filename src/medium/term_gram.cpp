#include "medium/term_gram.hpp"

#include "base/index.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

namespace flexgram {

TermGram::TermGram(const Dense& C, const Dense& B) : summed(C.columns + B.columns) {
  Q = multiply(C, transpose(C));
  const Dense of_B = multiply(B, transpose(B));
  for (std::size_t i = 0; i < Q.data.size(); ++i) Q.data[i] *= of_B.data[i];
  for (int i = 0; i < Q.rows; ++i) size.push_back(std::sqrt(std::max(Q(i, i), 0.0)));
}

TermGram::TermGram(const TermGram& a, const Dense& mixed, const TermGram& b)
    : Q(a.order() + b.order(), a.order() + b.order()), size(a.size),
      summed(std::max(a.summed, b.summed)) {
  set_part(Q, 0, 0, a.Q);
  set_part(Q, 0, a.order(), mixed);
  set_part(Q, a.order(), 0, transpose(mixed));
  set_part(Q, a.order(), a.order(), b.Q);
  size.insert(size.end(), b.size.begin(), b.size.end());
}

namespace {

/// @param Q_f  Q times the coefficients of f.
TermNorms norms_of(const TermGram& gram, const MatrixSeries& f, const Dense& Q_f) {
  const int n = gram.order(), degree = f.degree();
  // G_kl = Re ⟨F_k, F_l⟩ of the coefficients F_k = Σ_i f_ik c_i b_iᵀ.
  const Dense parts = multiply_transposed(f.coefficients, Q_f);
  Dense G(degree + 1, degree + 1);
  for (int l = 0; l <= degree; ++l)
    for (int k = 0; k <= degree; ++k)
      G(k, l) = parts(2 * k, 2 * l) + parts(2 * k + 1, 2 * l + 1);
  // |computed − exact| <= γ Σ_ij |f_i| |c_iᵀc_j| |b_iᵀb_j| |f_j| <= γ (Σ |f_i| ‖c_i‖‖b_i‖)²,
  // for any ‖Σ t_k F_k‖² with |t_k| <= 1.
  const double gamma = std::numeric_limits<double>::epsilon() *
                       (4.0 * n + 2 * gram.summed + (degree + 1) * (degree + 1) + 16);
  double sizes = 0, bend = 0, tail = 0; // bend: Σ k(k − 1)‖F_k‖ >= max‖F″‖
  for (int k = 0; k <= degree; ++k) {
    double sum = 0;
    for (int i = 0; i < n; ++i)
      sum += std::hypot(f.real(k)[i], f.imaginary(k)[i]) * gram.size[as_size(i)];
    sizes += sum;
    bend += k * (k - 1) * std::sqrt(std::max(G(k, k), 0.0) + gamma * sum * sum);
  }
  for (int i = 0; i < n; ++i) tail += f.tail(i, 0) * gram.size[as_size(i)];
  const double lost = gamma * sizes * sizes;

  TermNorms result;
  result.rounding = std::sqrt(lost);
  ViewNorms& norms = result.norms;
  const double width = 2.0 / pieces, away = bend * width * width / 8 + tail;
  const auto product = [&](const std::vector<double>& s, const std::vector<double>& t) {
    double sum = 0;
    for (int l = 0; l <= degree; ++l)
      for (int k = 0; k <= degree; ++k) sum += s[as_size(k)] * G(k, l) * t[as_size(l)];
    return sum;
  };
  std::vector<double> last, next(as_size(degree) + 1);
  double square_before = 0;
  for (int node = 0; node <= pieces; ++node) {
    const double t = -1 + node * width;
    next[0] = 1;
    for (std::size_t k = 1; k < next.size(); ++k) next[k] = next[k - 1] * t;
    const auto at = as_size(node);
    const double square = std::max(product(next, next), 0.0);
    norms.at[at] = std::sqrt(square);
    if (node > 0) { // of the chord from `last` to `next`
      const double both = product(last, next), along = square_before - both,
                   across = square_before - 2 * both + square;
      double least = std::min(square, square_before);
      if (along > 0 && along < across) least = square_before - along * along / across;
      // A convex combination is off by no more than its ends.
      norms.above[at - 1] = std::sqrt(std::max(square, square_before) + lost) + away;
      norms.below[at - 1] = std::max(
          std::sqrt(std::max(least - lost - 1e-14 * square_before, 0.0)) - away, 0.0);
    }
    last = next;
    square_before = square;
  }
  return result;
}

} // namespace

TermNorms term_norms(const TermGram& gram, const MatrixSeries& f) {
  return norms_of(gram, f, multiply(gram.Q, f.coefficients));
}

std::vector<TermNorms> term_norms(const TermGram& gram,
                                  const std::vector<MatrixSeries>& all) {
  int columns = 0;
  for (const MatrixSeries& f : all) columns += f.coefficients.columns;
  Dense together(gram.order(), columns);
  columns = 0;
  for (const MatrixSeries& f : all) {
    set_part(together, 0, columns, f.coefficients);
    columns += f.coefficients.columns;
  }
  const Dense Q_f = multiply(gram.Q, together);
  std::vector<TermNorms> result;
  columns = 0;
  for (const MatrixSeries& f : all) {
    const int own = f.coefficients.columns;
    result.push_back(norms_of(gram, f, part_of(Q_f, 0, gram.order(), columns, own)));
    columns += own;
  }
  return result;
}

MatrixSeries stacked(const MatrixSeries& a, const MatrixSeries& b) {
  MatrixSeries all{1, Dense(a.rows() + b.rows(), a.coefficients.columns),
                   Dense(a.rows() + b.rows(), 1)};
  set_part(all.coefficients, 0, 0, a.coefficients);
  set_part(all.coefficients, a.rows(), 0, b.coefficients);
  set_part(all.tail, 0, 0, a.tail);
  set_part(all.tail, a.rows(), 0, b.tail);
  return all;
}

} // namespace flexgram
