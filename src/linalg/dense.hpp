#pragma once

#include "base/index.hpp"

#include <complex>
#include <cstddef>
#include <vector>

namespace flexgram {

/// A small dense matrix, column-major, the same on every rank.
template <class T>
struct DenseOf {
  DenseOf() = default;
  DenseOf(int row_count, int column_count)
      : rows(row_count), columns(column_count),
        data(as_size(row_count) * as_size(column_count)) {}
  T& operator()(int i, int j) { return data[index(i, j)]; }
  const T& operator()(int i, int j) const { return data[index(i, j)]; }
  T* column(int j) { return data.data() + index(0, j); }
  const T* column(int j) const { return data.data() + index(0, j); }

  int rows = 0, columns = 0;
  std::vector<T> data;

private:
  std::size_t index(int i, int j) const {
    return as_size(i) + as_size(j) * as_size(rows);
  }
};
using Dense = DenseOf<double>;
using ComplexDense = DenseOf<std::complex<double>>;

Dense identity(int order);
Dense transpose(const Dense& a);
ComplexDense transpose(const ComplexDense& a);
Dense multiply(const Dense& a, const Dense& b);            ///< A B
Dense multiply_transposed(const Dense& a, const Dense& b); ///< Aᵀ B
/// Of AᵀB these columns, summed over the rows [first, last) alone, into the same columns of C.
void multiply_rows_transposed(const Dense& a, const Dense& b, int first, int last,
                              int column, int columns, Dense& c);
Dense outer_square(const Dense& a); ///< A Aᵀ, at half the price of a product
/// Rows [r0, r0 + rows) and columns [c0, c0 + columns) of A.
Dense part_of(const Dense& a, int r0, int rows, int c0, int columns);
/// Copies `part` into A from row r0, column c0 on.
void set_part(Dense& a, int r0, int c0, const Dense& part);
Dense beside(const Dense& a, const Dense& b); ///< [A B]; either may be empty
Dense first_columns(const Dense& a, int count);
/// The chosen columns, in that order.
Dense columns_of(const Dense& a, const std::vector<int>& columns);
ComplexDense columns_of(const ComplexDense& a, const std::vector<int>& columns);
/// The same, column j of A divided by divisors[j].
Dense columns_of(const Dense& a, const std::vector<int>& columns,
                 const std::vector<double>& divisors);
Dense absolute(Dense a);                                  ///< |A_ij|
void add_to(Dense& a, const Dense& b, double factor = 1); ///< A ← A + factor B
double frobenius_norm(const Dense& a);
double max_norm(const Dense& a); ///< the largest |a_ij|
double frobenius_norm(const ComplexDense& a);
ComplexDense as_complex(const Dense& a);
/// At least the spectral norm: √(‖A‖₁‖A‖∞), or ‖A‖_F.
double norm_bound(const ComplexDense& a);
/// The diagonal of D with which rows and columns of D⁻¹AD are about equally large (Osborne 1960);
/// within a factor of 10⁶, lest rounding of A matter.
std::vector<double> balancing(const ComplexDense& a);
/// D⁻¹AD.
ComplexDense balanced(ComplexDense a, const std::vector<double>& D);
/// |a_ii|, or what another row leaves of it, |a_ij|²/|a_jj|, if that is more: by the roots of these
/// a matrix is scaled whose diagonal may vanish.
double pivot_size(const ComplexDense& a, int i);
enum class Symmetry { symmetric, skew }; ///< Aᵀ = A, Aᵀ = −A
/// Replaces A by (A + Aᵀ)/2, or by (A − Aᵀ)/2.
void symmetrise(Dense& a, Symmetry of = Symmetry::symmetric);
/// [A, c; ±cᵀ, d] from the new columns [c; d].
Dense bordered(const Dense& a, const Dense& columns, Symmetry of = Symmetry::symmetric);

ComplexDense multiply(const Dense& a, const ComplexDense& b);            ///< A B
ComplexDense multiply_transposed(const Dense& a, const ComplexDense& b); ///< Aᵀ B
ComplexDense multiply(const ComplexDense& a, const ComplexDense& b);     ///< A B
/// The product of A's first columns, as many as B has rows, and B.
ComplexDense multiply_first(const ComplexDense& a, const ComplexDense& b);
/// AᵀB without, AᴴB with conjugation.
ComplexDense multiply_transposed(const ComplexDense& a, const ComplexDense& b,
                                 bool conjugate = false);

} // namespace flexgram
