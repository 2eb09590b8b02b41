#include "medium/cell_response.hpp"

#include "linalg/decompositions.hpp"

#include <algorithm>
#include <cmath>

namespace flexgram {
namespace {

using Complex = std::complex<double>;

/// Of the response; what comes beyond is bounded.
constexpr int degree = 2;
/// Σ‖A⁻¹(A(ω, p) − A)‖ up to which its series are taken.
constexpr double most_moved = 0.7;

/// Each column of A times its factor.
ComplexDense scaled_columns(ComplexDense a, const std::vector<double>& scale) {
  for (int j = 0; j < a.columns; ++j)
    for (int i = 0; i < a.rows; ++i) a(i, j) *= scale[as_size(j)];
  return a;
}
CellSeries scaled_columns(CellSeries series, const std::vector<double>& scale) {
  for (auto& [powers, a] : series) a = scaled_columns(std::move(a), scale);
  return series;
}

double sum_of_norms(const CellSeries& series) {
  double sum = 0;
  for (const auto& [powers, a] : series) sum += spectral_norm(a);
  return sum;
}

ComplexDense gram(const ComplexDense& a) { return multiply_transposed(a, a, true); }
double four_norm(const ComplexDense& gram, const std::vector<int>& columns) {
  double square = 0;
  for (int j : columns)
    for (int i : columns) square += std::norm(gram(i, j));
  return std::sqrt(std::sqrt(square));
}

/// ‖·‖_F of a block over the cell, at most.
double largest_of(const CellSeries& series, const std::vector<int>& rows,
                  const std::vector<int>& columns) {
  std::vector<const ComplexDense*> linear;
  const ComplexDense* constant = nullptr;
  double sum = 0, largest = 0;
  const auto norm = [&](const auto& entry) {
    double square = 0;
    for (int j : columns)
      for (int i : rows) square += std::norm(entry(i, j));
    return std::sqrt(square);
  };
  for (const auto& [powers, a] : series) {
    const int k = degree_of(powers);
    if (k == 0) constant = &a;
    if (k == 1) linear.push_back(&a);
    if (k > 1) sum += norm(a);
  }
  for (std::size_t corner = 0; corner < std::size_t(1) << linear.size(); ++corner) {
    const double here = norm([&](int i, int j) {
      Complex at = (*constant)(i, j);
      for (std::size_t v = 0; v < linear.size(); ++v)
        at += (corner >> v & 1) != 0 ? (*linear[v])(i, j) : -(*linear[v])(i, j);
      return at;
    });
    if (!(here <= largest)) largest = here; // not a number stays
  }
  return largest + sum;
}

} // namespace

/// Of each column the sum of the norms of its coefficients.
std::vector<double> column_sums(const CellSeries& series, int columns) {
  std::vector<double> sums(as_size(columns), 0.0);
  for (const auto& [powers, a] : series) {
    const std::vector<double> norms = column_norms(a);
    for (std::size_t j = 0; j < sums.size(); ++j) sums[j] += norms[j];
  }
  return sums;
}

double root_of_squares(const std::vector<double>& of, const std::vector<int>& chosen) {
  double sum = 0;
  for (int j : chosen) sum += of[as_size(j)] * of[as_size(j)];
  return std::sqrt(sum);
}

FourNorms::FourNorms(const CellSeries& series, std::vector<double> tails)
    : tails_(std::move(tails)) {
  std::vector<const ComplexDense*> linear;
  const ComplexDense* constant = nullptr;
  for (const auto& [powers, a] : series) {
    const int k = degree_of(powers);
    if (k == 0) constant = &a;
    if (k == 1) linear.push_back(&a);
    if (k > 1) others_.push_back(gram(a));
  }
  for (std::size_t corner = 0; corner < std::size_t(1) << linear.size(); ++corner) {
    ComplexDense at = *constant;
    for (std::size_t v = 0; v < linear.size(); ++v)
      add_to(at, *linear[v], (corner >> v & 1) != 0 ? 1 : -1);
    corners_.push_back(gram(at));
  }
}

double FourNorms::of(const std::vector<int>& columns) const {
  double largest = 0, sum = 0;
  for (const ComplexDense& a : corners_)
    if (const double here = four_norm(a, columns); !(here <= largest)) largest = here;
  for (const ComplexDense& a : others_) sum += four_norm(a, columns);
  return largest + sum + root_of_squares(tails_, columns);
}

double CellProduct::of(const std::vector<int>& rows,
                       const std::vector<int>& columns) const {
  const double tail = root_of_squares(y_tail, rows);
  return largest_of(yz, rows, columns) + tail * root_of_squares(z_size, columns) +
         (root_of_squares(y_size, rows) + tail) * root_of_squares(z_error, columns);
}

CellResponse cell_response(const Cell& cell, const CellFactors& factors,
                           const Matrices& matrices, const Dense& ports) {
  CellResponse of;
  of.by_variable.assign(cell.variables(), 0.0);
  CellSeries A = series_of(matrices, factors);
  const Powers none(cell.variables(), 0);
  const int r = ports.rows, p = ports.columns;
  const ComplexDense centre = A.at(none);
  for (int i = 0; i < r; ++i)
    of.scale.push_back(1 / std::sqrt(std::max(pivot_size(centre, i), 1e-300)));
  const auto scaled = [&](ComplexDense a) {
    for (int j = 0; j < r; ++j)
      for (int i = 0; i < r; ++i) a(i, j) *= of.scale[as_size(i)] * of.scale[as_size(j)];
    return a;
  };
  ComplexDense inverse;
  try {
    inverse = solve(scaled(centre), as_complex(identity(r)));
  } catch (const ShiftError&) {
    return of;
  }
  const double norm = spectral_norm(inverse);
  double of_rest = 0, moved = 0;
  for (std::size_t m = 0; m < matrices.size(); ++m)
    if (factors.rest[m] > 0)
      of_rest += factors.rest[m] * norm * frobenius_norm(scaled(as_complex(matrices[m])));
  moved = of_rest;
  CellSeries G;
  std::vector<double>& by_variable = of.by_variable;
  for (auto& [powers, a] : A) {
    if (powers == none) continue;
    const auto at = G.emplace(powers, multiply(inverse, scaled(std::move(a)))).first;
    const double size = spectral_norm(at->second);
    moved += size;
    for (std::size_t v = 0; v < by_variable.size(); ++v)
      if (powers[v] > 0) by_variable[v] += size;
  }
  by_variable[0] += of_rest;

  if (!(moved < most_moved)) return of;
  of.known = true;
  of.inverse = norm / (1 - moved);
  of.moved = moved * of.inverse;
  ComplexDense start = as_complex(ports);
  for (int j = 0; j < p; ++j)
    for (int i = 0; i < r; ++i) start(i, j) *= of.scale[as_size(i)];
  of.x.emplace(none, multiply(inverse, start));
  CellSeries left;
  for (int k = 1; k <= degree + 1; ++k) {
    CellSeries product; // −G x of this degree from all terms below it
    add_product(G, of.x, -1, product);
    for (auto& [powers, a] : product) {
      const int d = degree_of(powers);
      if (k <= degree && d == k) of.x.emplace(powers, std::move(a));
      if (k > degree && d > degree) left.emplace(powers, std::move(a));
    }
  }
  of.at_centre = std::move(inverse);
  of.G = std::move(G);
  of.of_rest = of_rest;
  of.of_G = moved;
  of.sizes = column_sums(of.x, p);
  of.tails = column_sums(left, p);
  for (std::size_t j = 0; j < of.tails.size(); ++j) {
    of.tails[j] = (of.tails[j] + of_rest * of.sizes[j]) / (1 - moved);
    of.sizes[j] += of.tails[j];
  }
  return of;
}

std::vector<double> diagonal_sizes(const Matrices& matrices,
                                   const std::vector<double>& scale) {
  std::vector<double> sizes;
  for (const Dense& a : matrices) {
    const auto s = [&](int i) { return scale.empty() ? 1.0 : scale[as_size(i)]; };
    double sum = 0, squares = 0;
    for (int j = 0; j < a.columns; ++j) {
      sum += s(j) * s(j) * std::abs(a(j, j));
      for (int i = 0; i < a.rows; ++i) squares += std::pow(s(i) * s(j) * a(i, j), 2);
    }
    sizes.push_back(std::sqrt(std::max(sum, std::sqrt(squares) * (1 - 1e-9))));
  }
  return sizes;
}

CellResidual cell_residual(const CellResponse& of, const CellFactors& factors,
                           const Matrices& matrices, const Dense& ports,
                           const std::vector<double>& sizes) {
  CellResidual result;
  const CellSeries A = scaled_columns(series_of(matrices, factors), of.scale);
  const std::vector<double> port_norms = column_norms(ports), largest = factors.largest();
  double off = 0; // what A is not known by
  for (std::size_t m = 0; m < matrices.size(); ++m) {
    const double size = frobenius_norm(scaled_columns(as_complex(matrices[m]), of.scale));
    off += factors.rest[m] * size +
           cell_rounding * largest[m] * std::max(sizes[m], size * (1 - 1e-9));
  }
  result.at_centre = A.begin()->second;
  result.norm = sum_of_norms(A) + off;
  result.moved = result.norm - spectral_norm(result.at_centre);
  result.y.emplace(of.x.begin()->first, as_complex(ports));
  add_product(A, of.x, -1, result.y);
  for (std::size_t j = 0; j < of.tails.size(); ++j)
    result.tails.push_back(result.norm * of.tails[j] + off * of.sizes[j] +
                           cell_rounding * port_norms[j]);
  return result;
}

/// y = RᵀP − RᵀAQ x
CellProduct cell_product(const CellResponse& of, const CellModel& inputs,
                         const CellModel& outputs, const CellFactors& factors,
                         const Dense& ports, const std::vector<double>& sizes) {
  const auto scaled = [&](Dense rows) {
    for (int j = 0; j < rows.columns; ++j)
      for (int i = 0; i < rows.rows; ++i) rows(i, j) *= of.scale[as_size(i)];
    return rows;
  };
  const auto residual = [&](const CellModel& model) {
    Matrices RQ;
    for (const Dense& matrix : model.matrices) RQ.push_back(scaled(matrix));
    return cell_residual(model.response, factors, RQ, scaled(ports), sizes);
  };
  const CellResidual in_R = residual(inputs);
  std::optional<CellResidual> of_outputs;
  if (&outputs.matrices != &inputs.matrices) of_outputs = residual(outputs);
  const CellResidual& y_of = of_outputs ? *of_outputs : in_R;
  const int p = ports.columns;
  CellProduct result{{}, column_sums(y_of.y, p), y_of.tails, {}, {}};
  // z + G z = (RᵀAR)⁻¹ y at the centre, by degrees; `left`: what z leaves of it.
  CellSeries start, z;
  for (const auto& [powers, y] : in_R.y) start.emplace(powers, multiply(of.at_centre, y));
  for (int k = 0; k <= degree; ++k) {
    CellSeries here;
    add_product(of.G, z, -1, here);
    add_to(here, start);
    for (auto& [powers, a] : here)
      if (degree_of(powers) == k) z.emplace(powers, std::move(a));
  }
  CellSeries left = start;
  add_product(of.G, z, -1, left);
  add_to(left, z, -1);
  const double inverse = spectral_norm(of.at_centre);
  result.z_size = column_sums(z, p);
  result.z_error = column_sums(left, p);
  for (std::size_t j = 0; j < result.z_error.size(); ++j)
    result.z_error[j] =
        (result.z_error[j] + of.of_rest * result.z_size[j] + inverse * in_R.tails[j]) /
        (1 - of.of_G);
  result.yz = transposed_product(y_of.y, z);
  return result;
}

} // namespace flexgram
