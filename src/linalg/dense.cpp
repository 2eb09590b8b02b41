#include "linalg/dense.hpp"

#include "base/index.hpp"

#include <petscsys.h>

#include <petscblaslapack.h>

#include <algorithm>
#include <cmath>
#include <stdexcept>

extern "C" {
void zgemm_(const char* op_a, const char* op_b, const int* m, const int* n, const int* k,
            const std::complex<double>* alpha, const std::complex<double>* a,
            const int* lda, const std::complex<double>* b, const int* ldb,
            const std::complex<double>* beta, std::complex<double>* c, const int* ldc);
}

namespace flexgram {
namespace {

Dense gemm(const char* op_a, const char* op_b, const Dense& a, const Dense& b) {
  const bool ta = *op_a == 'T', tb = *op_b == 'T';
  Dense c(ta ? a.columns : a.rows, tb ? b.rows : b.columns);
  if (c.data.empty()) return c;
  const PetscBLASInt m = c.rows, n = c.columns, k = ta ? a.rows : a.columns;
  const PetscBLASInt lda = std::max(a.rows, 1), ldb = std::max(b.rows, 1), ldc = c.rows;
  const double one = 1, zero = 0;
  BLASgemm_(op_a, op_b, &m, &n, &k, &one, a.data.data(), &lda, b.data.data(), &ldb, &zero,
            c.data.data(), &ldc);
  return c;
}

} // namespace

Dense identity(int order) {
  Dense result(order, order);
  for (int i = 0; i < order; ++i) result(i, i) = 1;
  return result;
}

namespace {

template <class T>
DenseOf<T> transpose_of(const DenseOf<T>& a) {
  DenseOf<T> t(a.columns, a.rows);
  for (int j = 0; j < a.columns; ++j)
    for (int i = 0; i < a.rows; ++i) t(j, i) = a(i, j);
  return t;
}

} // namespace

Dense transpose(const Dense& a) { return transpose_of(a); }
ComplexDense transpose(const ComplexDense& a) { return transpose_of(a); }

Dense multiply(const Dense& a, const Dense& b) { return gemm("N", "N", a, b); }
Dense multiply_transposed(const Dense& a, const Dense& b) { return gemm("T", "N", a, b); }

void multiply_rows_transposed(const Dense& a, const Dense& b, int first, int last,
                              int column, int columns, Dense& c) {
  const PetscBLASInt m = a.columns, n = columns, k = last - first;
  const PetscBLASInt lda = std::max(a.rows, 1), ldb = std::max(b.rows, 1),
                     ldc = std::max(c.rows, 1);
  if (m == 0 || n == 0) return;
  const double one = 1, zero = 0;
  BLASgemm_("T", "N", &m, &n, &k, &one, a.data.data() + first, &lda,
            b.column(column) + first, &ldb, &zero, c.column(column), &ldc);
}

Dense outer_square(const Dense& a) {
  Dense c(a.rows, a.rows);
  if (a.data.empty()) return c;
  const double one = 1, zero = 0;
  BLASsyrk_("U", "N", &a.rows, &a.columns, &one, a.data.data(), &a.rows, &zero,
            c.data.data(), &c.rows);
  for (int j = 0; j < c.columns; ++j)
    for (int i = 0; i < j; ++i) c(j, i) = c(i, j);
  return c;
}

Dense part_of(const Dense& a, int r0, int rows, int c0, int columns) {
  Dense part(rows, columns);
  for (int j = 0; j < columns; ++j)
    std::copy_n(a.column(c0 + j) + r0, rows, part.column(j));
  return part;
}

void set_part(Dense& a, int r0, int c0, const Dense& part) {
  for (int j = 0; j < part.columns; ++j)
    std::copy_n(part.column(j), part.rows, a.column(c0 + j) + r0);
}

Dense beside(const Dense& a, const Dense& b) {
  if (a.columns == 0) return b;
  if (b.columns == 0) return a;
  Dense both(a.rows, a.columns + b.columns);
  set_part(both, 0, 0, a);
  set_part(both, 0, a.columns, b);
  return both;
}

Dense first_columns(const Dense& a, int count) {
  if (count > a.columns) throw std::logic_error("first_columns: more than there are");
  Dense result(a.rows, count);
  std::copy_n(a.data.begin(), result.data.size(), result.data.begin());
  return result;
}

namespace {

template <class T>
DenseOf<T> chosen(const DenseOf<T>& a, const std::vector<int>& columns) {
  DenseOf<T> part(a.rows, static_cast<int>(columns.size()));
  for (int j = 0; j < part.columns; ++j)
    std::copy_n(a.column(columns[as_size(j)]), a.rows, part.column(j));
  return part;
}

} // namespace

Dense columns_of(const Dense& a, const std::vector<int>& columns) {
  return chosen(a, columns);
}

ComplexDense columns_of(const ComplexDense& a, const std::vector<int>& columns) {
  return chosen(a, columns);
}

Dense columns_of(const Dense& a, const std::vector<int>& columns,
                 const std::vector<double>& divisors) {
  Dense part = chosen(a, columns);
  for (int j = 0; j < part.columns; ++j)
    for (int i = 0; i < part.rows; ++i)
      part(i, j) /= divisors[as_size(columns[as_size(j)])];
  return part;
}

Dense absolute(Dense a) {
  for (double& x : a.data) x = std::abs(x);
  return a;
}

void add_to(Dense& a, const Dense& b, double factor) {
  for (std::size_t i = 0; i < a.data.size(); ++i) a.data[i] += factor * b.data[i];
}

double frobenius_norm(const Dense& a) {
  double sum = 0;
  for (double x : a.data) sum += x * x;
  return std::sqrt(sum);
}

double max_norm(const Dense& a) {
  double largest = 0;
  for (double x : a.data) largest = std::max(largest, std::abs(x));
  return largest;
}

double frobenius_norm(const ComplexDense& a) {
  double sum = 0;
  for (const auto& x : a.data) sum += std::norm(x);
  return std::sqrt(sum);
}

void symmetrise(Dense& a, Symmetry of) {
  const bool skew = of == Symmetry::skew;
  for (int j = 0; j < a.columns; ++j) {
    for (int i = 0; i < j; ++i) {
      a(i, j) = 0.5 * (skew ? a(i, j) - a(j, i) : a(i, j) + a(j, i));
      a(j, i) = skew ? -a(i, j) : a(i, j);
    }
    if (skew) a(j, j) = 0;
  }
}

namespace {

ComplexDense as_complex(const Dense& re, const Dense& im) {
  ComplexDense c(re.rows, re.columns);
  for (std::size_t i = 0; i < c.data.size(); ++i) c.data[i] = {re.data[i], im.data[i]};
  return c;
}

/// Real and imaginary parts apart: two real products are cheaper than a complex one.
ComplexDense real_times_complex(const char* op, const Dense& a, const ComplexDense& b) {
  Dense re(b.rows, b.columns), im(b.rows, b.columns);
  for (std::size_t i = 0; i < b.data.size(); ++i) {
    re.data[i] = b.data[i].real();
    im.data[i] = b.data[i].imag();
  }
  return as_complex(gemm(op, "N", a, re), gemm(op, "N", a, im));
}

} // namespace

ComplexDense as_complex(const Dense& a) {
  ComplexDense result(a.rows, a.columns);
  std::copy(a.data.begin(), a.data.end(), result.data.begin());
  return result;
}

double pivot_size(const ComplexDense& a, int i) {
  double size = std::abs(a(i, i));
  for (int j = 0; j < a.columns; ++j)
    if (const double by = std::abs(a(i, j)); j != i && by > 0)
      size = std::max(size, by * by / std::max(by, std::abs(a(j, j))));
  return size;
}

double norm_bound(const ComplexDense& a) {
  std::vector<double> rows(static_cast<std::size_t>(a.rows), 0.0);
  double one = 0, squares = 0;
  for (int j = 0; j < a.columns; ++j) {
    double column = 0;
    for (int i = 0; i < a.rows; ++i) {
      const double size = std::sqrt(std::norm(a(i, j)));
      squares += size * size;
      column += size;
      rows[static_cast<std::size_t>(i)] += size;
    }
    one = std::max(one, column);
  }
  const double most = rows.empty() ? 0.0 : *std::max_element(rows.begin(), rows.end());
  return std::sqrt(std::min(one * most, squares)) * (1 + 1e-12);
}

std::vector<double> balancing(const ComplexDense& a) {
  constexpr int sweeps = 4;
  constexpr double most = 1e3; // and its inverse
  const int n = a.rows;
  std::vector<double> squares(a.data.size()), D(static_cast<std::size_t>(n), 1.0);
  for (std::size_t i = 0; i < squares.size(); ++i) squares[i] = std::norm(a.data[i]);
  const auto at = [&](int i, int j) -> double& {
    return squares[static_cast<std::size_t>(j) * static_cast<std::size_t>(n) +
                   static_cast<std::size_t>(i)];
  };
  for (int sweep = 0; sweep < sweeps; ++sweep) {
    double changed = 1;
    for (int k = 0; k < n; ++k) {
      double row = 0, column = 0;
      for (int i = 0; i < n; ++i)
        if (i != k) {
          row += at(k, i);
          column += at(i, k);
        }
      if (!(row > 0) || !(column > 0)) continue;
      double& d = D[static_cast<std::size_t>(k)];
      const double now = std::clamp(d * std::pow(row / column, 0.25), 1 / most, most),
                   by = (now / d) * (now / d);
      d = now;
      changed = std::max({changed, by, 1 / by});
      for (int i = 0; i < n; ++i)
        if (i != k) {
          at(k, i) /= by;
          at(i, k) *= by;
        }
    }
    if (changed < 1.5) break;
  }
  return D;
}

ComplexDense balanced(ComplexDense a, const std::vector<double>& D) {
  for (int j = 0; j < a.columns; ++j)
    for (int i = 0; i < a.rows; ++i)
      a(i, j) *= D[static_cast<std::size_t>(j)] / D[static_cast<std::size_t>(i)];
  return a;
}

ComplexDense multiply(const Dense& a, const ComplexDense& b) {
  return real_times_complex("N", a, b);
}
ComplexDense multiply_transposed(const Dense& a, const ComplexDense& b) {
  return real_times_complex("T", a, b);
}

namespace {
ComplexDense zgemm(const char* op, const ComplexDense& a, const ComplexDense& b) {
  const bool as_is = *op == 'N';
  ComplexDense c(as_is ? a.rows : a.columns, b.columns);
  if (c.data.empty() || b.data.empty()) return c;
  const int m = c.rows, k = b.rows;
  const std::complex<double> one = 1, zero = 0;
  zgemm_(op, "N", &m, &b.columns, &k, &one, a.data.data(), &a.rows, b.data.data(),
         &b.rows, &zero, c.data.data(), &c.rows);
  return c;
}
} // namespace

ComplexDense multiply(const ComplexDense& a, const ComplexDense& b) {
  return zgemm("N", a, b);
}
ComplexDense multiply_first(const ComplexDense& a, const ComplexDense& b) {
  return zgemm("N", a, b);
}
ComplexDense multiply_transposed(const ComplexDense& a, const ComplexDense& b,
                                 bool conjugate) {
  return zgemm(conjugate ? "C" : "T", a, b);
}

Dense bordered(const Dense& a, const Dense& columns, Symmetry of) {
  const int old = columns.rows - columns.columns;
  Dense result(columns.rows, columns.rows);
  if (old > 0) set_part(result, 0, 0, a);
  set_part(result, 0, old, columns);
  for (int j = old; j < result.columns; ++j)
    for (int i = 0; i < old; ++i)
      result(j, i) = of == Symmetry::skew ? -result(i, j) : result(i, j);
  Dense corner = part_of(result, old, columns.columns, old, columns.columns);
  symmetrise(corner, of);
  set_part(result, old, old, corner);
  return result;
}

} // namespace flexgram
