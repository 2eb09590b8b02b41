/// Polynomials over a cell of (ω, p), an interval of ω times one of each parameter of the body
/// (docs/proof.md, section 5). Used by error_between.cpp.

#pragma once

#include "medium/model.hpp"

#include <map>

namespace flexgram {

/// An interval of ω [rad/s] and one of each parameter, in its unit.
struct Cell {
  Interval omega;
  std::vector<Interval> values;

  std::size_t variables() const { return 1 + values.size(); }
  Interval& side(std::size_t v) { return v == 0 ? omega : values[v - 1]; }
  /// Its halves along one variable.
  std::pair<Cell, Cell> halves(std::size_t v) const;
};

/// Powers of the variables, each of which goes from −1 to 1: ω first.
using Powers = std::vector<int>;
int degree_of(const Powers& powers);

/// Σ C_k s^k over a cell.
using CellSeries = std::map<Powers, ComplexDense>;

/// What K, M and the matrix of each term are multiplied by in A(ω, p).
struct CellFactors {
  std::map<Powers, std::vector<std::complex<double>>> of;
  std::vector<double> rest; ///< of each matrix: what the series leave, at most

  CellFactors(const DenseSystem& system, const Cell& cell);
  /// Of each matrix the sum of the sizes of its factors: |factor| at most, with its rest.
  std::vector<double> largest() const;
};

/// K, M and the matrices of the terms between two spaces.
using Matrices = std::vector<Dense>;
/// A between them.
CellSeries series_of(const Matrices& matrices, const CellFactors& factors);

/// a ← a + factor · b.
void add_to(ComplexDense& a, const ComplexDense& b, double factor = 1);
/// sum ← sum + factor · b
void add_to(CellSeries& sum, const CellSeries& b, double factor = 1);
/// sum ← sum + factor · A x
void add_product(const CellSeries& A, const CellSeries& x, double factor,
                 CellSeries& sum);

/// yᵀz
CellSeries transposed_product(const CellSeries& y, const CellSeries& z);

/// The spectral norm, from above.
double spectral_norm(const ComplexDense& a);
double spectral_norm(const Dense& a);
/// Of each column.
std::vector<double> column_norms(const ComplexDense& a);
std::vector<double> column_norms(const Dense& a);

} // namespace flexgram
