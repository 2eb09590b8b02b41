#include "medium/cell_bound.hpp"

#include "linalg/decompositions.hpp"
#include "medium/cell_response.hpp"

#include <algorithm>
#include <cmath>

namespace flexgram {

CellBound::CellBound(const MediumModel& medium, const Dense& Q,
                     const Certificate::Couplings& couplings, const Cell& region)
    : medium_(medium), couplings_(couplings), spaces_(medium, Q, couplings, region) {}

CellBound::Look CellBound::look(const Cell& cell) const {
  const CellFactors factors(medium_.system, cell);
  CellResponse of = cell_response(cell, factors, spaces_.RR, spaces_.R_ports);
  const Look unknown{{}, of.longest()};
  if (!of.known) return unknown;
  const std::vector<double> R_sizes = diagonal_sizes(spaces_.RR, of.scale);
  const auto products = [](std::vector<double> left, const std::vector<double>& right) {
    for (std::size_t m = 0; m < left.size(); ++m) left[m] *= right[m];
    return left;
  };
  const CellResidual in_V = cell_residual(of, factors, spaces_.ZR, spaces_.Z_ports,
                                          products(diagonal_sizes(spaces_.ZZ), R_sizes));
  const double coupled = in_V.norm * in_V.norm * of.inverse;
  if (!(coupled < 1)) return unknown;
  const double S = 1 / (1 - coupled);
  double size_of_R = 0;
  for (std::size_t i = 0; i < of.scale.size(); ++i)
    size_of_R += std::pow(spaces_.R_sizes[i] * of.scale[i], 2);
  size_of_R = std::sqrt(size_of_R);
  std::vector<double> C_sizes = spaces_.C_sizes;
  for (double& size : C_sizes) size *= size_of_R;
  const CellResidual beyond =
      cell_residual(of, factors, spaces_.CR, couplings_.ports, C_sizes);
  const std::size_t ports = of.sizes.size();
  const Powers none(cell.variables(), 0);

  // z = S⁻¹ of what is left in V: Jacobi's iteration for the linear part, the rest by its norm.
  // S = A − J (RᵀAR)⁻¹ Jᵀ differs from that at the centre by `moved`.
  const CellSeries A = series_of(spaces_.ZZ, factors);
  const ComplexDense& at_centre = A.at(none);
  const std::vector<double> largest = factors.largest();
  double moved = in_V.moved * (2 * in_V.norm + in_V.moved) * of.inverse +
                 in_V.norm * in_V.norm * of.moved,
         g = 0, off_CZ = 0,
         dropped = couplings_.dropped_M * (largest[0] * couplings_.sigma + largest[1]);
  std::vector<double> along(cell.variables(), 0.0);
  for (std::size_t m = 0; m < spaces_.ZZ.size(); ++m) {
    moved +=
        (largest[m] - std::abs(factors.of.at(none)[m]) + cell_rounding * largest[m]) *
        spaces_.ZZ_norms[m];
    for (const auto& [powers, f] : factors.of)
      for (std::size_t v = 0; v < powers.size(); ++v)
        if (powers[v] > 0) along[v] += std::abs(f[m]) * spaces_.ZZ_norms[m];
    off_CZ += factors.rest[m] * spaces_.CZ_norms[m] +
              cell_rounding * largest[m] * spaces_.C_sizes[m] * spaces_.Z_size;
    if (m > 1) {
      g += largest[m] * spaces_.CZ_norms[m];
      dropped += largest[m] * couplings_.dropped_terms[m - 2];
    }
  }
  for (std::size_t v = 0; v < along.size(); ++v)
    of.by_variable[v] = std::max(of.by_variable[v], along[v]);
  // K and M couple by the same matrix: σ a_k + a_m.
  double shift = couplings_.sigma * factors.rest[0] + factors.rest[1];
  for (const auto& [powers, f] : factors.of)
    shift += std::abs(couplings_.sigma * f[0] + f[1]);
  g += shift * spaces_.CZ_norms[1] + dropped * spaces_.Z_size + off_CZ;
  std::vector<double> z_error(ports), z_size(ports);
  for (std::size_t j = 0; j < ports; ++j) z_error[j] = in_V.tails[j];
  CellSeries z;
  for (const auto& [powers, y] : in_V.y) {
    if (degree_of(powers) > 1) {
      const std::vector<double> norms = column_norms(y);
      for (std::size_t j = 0; j < ports; ++j) z_error[j] += norms[j];
      continue;
    }
    ComplexDense solution(y.rows, y.columns), left = y;
    for (int sweep = 0; sweep < 3; ++sweep) {
      for (int j = 0; j < y.columns; ++j)
        for (int i = 0; i < y.rows; ++i) solution(i, j) += left(i, j) / at_centre(i, i);
      left = y;
      add_to(left, multiply(at_centre, solution), -1);
      add_to(left, multiply(in_V.at_centre,
                            multiply(of.at_centre,
                                     multiply_transposed(in_V.at_centre, solution))));
    }
    const std::vector<double> off = column_norms(left), size = column_norms(solution);
    for (std::size_t j = 0; j < ports; ++j) {
      z_error[j] += off[j] + moved * size[j];
      z_size[j] += size[j];
    }
    z.emplace(powers, std::move(solution));
  }
  for (double& error : z_error) error *= S;

  // W of the medium model, and its Schur complement.
  CellSeries W = beyond.y;
  add_product(series_of(spaces_.CZ, factors), z, -1, W);
  const double to_C = beyond.norm + dropped * size_of_R,
               m = to_C * of.inverse * in_V.norm,
               off = (to_C * to_C * of.inverse + g * g * coupled * S +
                      (2 * g * m + m * m) * S),
               free = 1 / (1 - spaces_.chi * spaces_.chi);
  if (!(free * off < 1)) return unknown;
  const double S_beyond = free / (1 - free * off);
  std::vector<double> W_tails = beyond.tails;
  for (std::size_t j = 0; j < ports; ++j) {
    const double all_z = z_size[j] + z_error[j],
                 x = size_of_R * (of.sizes[j] + of.inverse * in_V.norm * all_z) +
                     spaces_.Z_size * all_z;
    W_tails[j] += (g + m) * z_error[j] + (off_CZ + m) * z_size[j] +
                  couplings_.dropped_ports[j] + dropped * x;
  }

  const FourNorms of_V(in_V.y, in_V.tails), of_body(W, W_tails);
  const CellProduct within{transposed_product(in_V.y, z),
                           column_sums(in_V.y, static_cast<int>(ports)), in_V.tails,
                           z_size, z_error};
  std::optional<CellProduct> of_modes;
  if (!spaces_.QQ.empty()) {
    const CellResponse small = cell_response(cell, factors, spaces_.QQ, spaces_.Q_ports);
    if (!small.known) return {{}, small.longest()};
    of_modes = cell_product(of, small, factors, spaces_.RQ, spaces_.R_ports,
                            products(diagonal_sizes(spaces_.QQ, small.scale), R_sizes));
  }
  Dense scaled_ports = spaces_.R_ports;
  for (int j = 0; j < scaled_ports.columns; ++j)
    for (int i = 0; i < scaled_ports.rows; ++i)
      scaled_ports(i, j) *= of.scale[as_size(i)];
  CellSeries H; // of R, from all ports to all
  for (const auto& [powers, x] : of.x)
    H.emplace(powers, multiply_transposed(scaled_ports, x));
  const std::vector<double> output_sizes = column_norms(scaled_ports);
  Look result{{}, of.longest()};
  const int n_in = medium_.system.B.columns,
            first = medium_.system.outputs_are_inputs ? 0 : n_in;
  for (const PortView& view : medium_.views) {
    std::vector<int> rows = view.rows;
    for (int& row : rows) row += first;
    // yᵀS⁻¹y = yᵀz + yᵀ(S⁻¹y − z)
    const double of_R = std::min(within.of(rows, view.columns),
                                 S * of_V.of(rows) * of_V.of(view.columns)) +
                        S_beyond * of_body.of(rows) * of_body.of(view.columns),
                 error = of_R + (of_modes ? of_modes->of(rows, view.columns) : 0.0);
    // ‖H‖ of R is no less than its part along that at the centre.
    const ComplexDense& centre = H.at(none);
    double square = 0, turned = 0;
    for (const auto& [powers, h] : H) {
      double common = 0;
      for (int column : view.columns)
        for (int row : rows)
          common += (std::conj(centre(row, column)) * h(row, column)).real();
      if (powers == none)
        square = common;
      else
        turned += std::abs(common);
    }
    const double size = std::sqrt(square),
                 least = size * (1 - 1e-10) - turned / std::max(size, 1e-300) -
                         root_of_squares(output_sizes, rows) *
                             root_of_squares(of.tails, view.columns) -
                         of_R;
    if (!(least > 0) || !std::isfinite(error)) return {{}, of.longest()};
    result.worst_of.push_back(error / least);
  }
  return result;
}

} // namespace flexgram
