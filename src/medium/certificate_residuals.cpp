/// Residuals W of ports over an interval of ω: what T holds of them, what it does not
/// (docs/proof.md, sections 3 and 4). Declared in certificate.hpp.

#include "base/index.hpp"
#include "linalg/decompositions.hpp"
#include "medium/certificate.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>

namespace flexgram {

using Complex = std::complex<double>;

/// a_k − κ a_m as a polynomial in t.
std::vector<Complex> Certificate::residual_factors(const DenseResponse& response,
                                                   Interval interval) const {
  const Damping& d = response.system().damping;
  const double omega = interval.centre(), h = interval.half();
  const Complex i(0, 1);
  return {1.0 + i * (d.eta + omega * d.beta) -
              shifts_.kappa * (i * omega * d.alpha - omega * omega),
          h * (i * d.beta - shifts_.kappa * (i * d.alpha - 2 * omega)),
          shifts_.kappa * h * h};
}

/// ‖E^−½ ·‖ of what T does not hold of a port's residual, at most.
/// In the unit of the port. @param column  of x, the response to the k-th of the ports.
/// @param factor, of_terms  |a_k − κ a_m| and |g| of each term at most.
double Certificate::lost(const ResponseSeries& x, int column, const Chosen& of,
                         std::size_t k, double factor,
                         const std::vector<double>& of_terms) const {
  const ResidualParts& parts = of.parts;
  double sum = std::pow(parts.dropped_ports[as_size(of.columns[k])], 2);
  for (int l = 0; l < x.envelope.rows; ++l) {
    const auto at = as_size(l);
    sum += std::pow(x.envelope(l, column) * factor * parts.dropped_K[at], 2);
    for (std::size_t t = 0; t < of_terms.size(); ++t)
      sum +=
          std::pow(x.envelope(l, column) * of_terms[t] * parts.dropped_terms[t][at], 2);
  }
  return std::sqrt(sum) / scale_[as_size(of.ports[k])];
}

Certificate::FewResiduals Certificate::residuals_of(const std::vector<int>& ports) const {
  FewResiduals few{ports, {}};
  ResidualParts& parts = few.parts;
  parts = {columns_of(parts_.ports, ports),
           parts_.K,
           parts_.terms,
           {},
           parts_.dropped_K,
           parts_.dropped_terms};
  for (int port : ports)
    parts.dropped_ports.push_back(parts_.dropped_ports[as_size(port)]);
  const int rows = parts.ports.rows, N = parts.K.rows,
            of_matrices = N * (1 + static_cast<int>(parts.terms.size())),
            all = of_matrices + static_cast<int>(ports.size());
  const auto first_of = [&](std::size_t term) {
    return N * (1 + static_cast<int>(term));
  };
  if (rows < 2 * all) return few;
  Dense vectors(all, rows);
  set_part(vectors, 0, 0, parts.K);
  for (std::size_t t = 0; t < parts.terms.size(); ++t)
    set_part(vectors, first_of(t), 0, parts.terms[t]);
  set_part(vectors, of_matrices, 0, transpose(parts.ports));
  // Householder's QR turns each vector by no more than 2ε · rows · all of its length, all of
  // them perhaps alike: `lost` adds squares.
  const double turned =
      2 * std::numeric_limits<double>::epsilon() * rows * std::pow(all, 1.5);
  const auto enlarge = [&](std::vector<double>& dropped, int first) {
    for (std::size_t k = 0; k < dropped.size(); ++k) {
      double square = 0;
      for (int i = 0; i < rows; ++i)
        square += std::pow(vectors(first + static_cast<int>(k), i), 2);
      dropped[k] += turned * std::sqrt(square);
    }
  };
  enlarge(parts.dropped_K, 0);
  for (std::size_t t = 0; t < parts.terms.size(); ++t)
    enlarge(parts.dropped_terms[t], first_of(t));
  enlarge(parts.dropped_ports, of_matrices);
  const Dense own = compressed(vectors);
  parts.K = part_of(own, 0, N, 0, all);
  for (std::size_t t = 0; t < parts.terms.size(); ++t)
    parts.terms[t] = part_of(own, first_of(t), N, 0, all);
  parts.ports = transpose(part_of(own, of_matrices, all - of_matrices, 0, all));
  return few;
}

Certificate::Chosen Certificate::chosen(const FewResiduals& few) {
  Chosen of{few.parts, std::vector<int>(few.ports.size()), few.ports, false};
  std::iota(of.columns.begin(), of.columns.end(), 0);
  return of;
}

/// What T holds of W = E^−½ R, in its coordinates and in the units of the ports.
MatrixSeries Certificate::held_residual(const DenseResponse& response,
                                        const ResponseSeries& x, const Chosen& of) const {
  const ResidualParts& parts = of.parts;
  const int p = x.x.columns;
  MatrixSeries w = multiply_transposed(
      parts.K, parts.K_sizes(), times(residual_factors(response, x.interval), x.x));
  for (double& value : w.coefficients.data) value = -value;
  for (std::size_t t = 0; t < parts.terms.size(); ++t) {
    const Law& law = response.system().terms[t].law;
    const LawSeries g = law.series(x.interval, x.x.degree());
    const MatrixSeries damped =
        multiply_transposed(parts.terms[t], times(g.coefficients, x.x, g.rest));
    const double sign = of.of_transposed && law.is_skew() ? -1 : 1;
    for (std::size_t l = 0; l < w.coefficients.data.size(); ++l)
      w.coefficients.data[l] -= sign * damped.coefficients.data[l];
    for (std::size_t l = 0; l < w.tail.data.size(); ++l)
      w.tail.data[l] += damped.tail.data[l];
  }
  for (int j = 0; j < p; ++j) {
    const double* constant = parts.ports.column(of.columns[as_size(j)]);
    for (int l = 0; l < w.rows(); ++l) w.coefficients(l, j) += constant[l];
  }
  const auto scale = [&](int j) { return scale_[as_size(of.ports[as_size(j)])]; };
  for (int c = 0; c < w.coefficients.columns; ++c)
    for (int l = 0; l < w.rows(); ++l) w.coefficients(l, c) /= scale(c % p);
  for (int j = 0; j < p; ++j)
    for (int l = 0; l < w.rows(); ++l) w.tail(l, j) /= scale(j);
  return w;
}

/// W of these ports, to which x is the response, with a row of its own for what T does not
/// hold.
MatrixSeries Certificate::residual(const DenseResponse& response, const ResponseSeries& x,
                                   const Chosen& of) const {
  const int p = x.x.columns;
  const auto f = residual_factors(response, x.interval);
  const double largest = std::abs(f[0]) + std::abs(f[1]) + std::abs(f[2]);
  const std::vector<double> of_terms =
      largest_of(response.system().terms, x.interval.last);
  const MatrixSeries w = held_residual(response, x, of);
  MatrixSeries whole{p, Dense(w.rows() + 1, w.coefficients.columns),
                     Dense(w.rows() + 1, p)};
  set_part(whole.coefficients, 0, 0, w.coefficients);
  set_part(whole.tail, 0, 0, w.tail);
  for (int j = 0; j < p; ++j)
    whole.tail(w.rows(), j) = lost(x, j, of, as_size(j), largest, of_terms);
  return whole;
}

/// What the columns of W differ from their values at the centre, at most.
std::vector<double> Certificate::moved(const MatrixSeries& w) {
  std::vector<double> moved;
  for (int j = 0; j < w.columns; ++j) {
    double sum = 0, tail = 0;
    for (int k = 1; k <= w.degree(); ++k) {
      const std::size_t first = as_size(j) * as_size(w.rows());
      double square = 0;
      for (std::size_t i = first; i < first + as_size(w.rows()); ++i)
        square += w.real(k)[i] * w.real(k)[i] + w.imaginary(k)[i] * w.imaginary(k)[i];
      sum += std::sqrt(square);
    }
    for (int i = 0; i + 1 < w.rows(); ++i) tail += w.tail(i, j) * w.tail(i, j);
    // What T does not hold is not orthogonal to it in E⁻¹.
    moved.push_back(sum + std::sqrt(tail) + w.tail(w.rows() - 1, j));
  }
  return moved;
}

} // namespace flexgram
