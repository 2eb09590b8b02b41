#include "medium/cell_bound.hpp"

#include "linalg/decompositions.hpp"
#include "medium/cell_response.hpp"

#include <algorithm>
#include <cmath>

namespace flexgram {

CellBound::CellBound(const MediumModel& medium, const Dense& Q,
                     const Certificate::Couplings& couplings, const Cell& region)
    : medium_(medium), couplings_(couplings), spaces_(medium, Q, couplings, region) {}

namespace {

std::vector<double> products(std::vector<double> left, const std::vector<double>& right) {
  for (std::size_t m = 0; m < left.size(); ++m) left[m] *= right[m];
  return left;
}

double root_of_weighted(const std::vector<double>& sizes,
                        const std::vector<double>& scale) {
  double sum = 0;
  for (std::size_t i = 0; i < scale.size(); ++i) sum += std::pow(sizes[i] * scale[i], 2);
  return std::sqrt(sum);
}

} // namespace

/// What A, or Aᵀ, makes of all ports.
struct CellBound::Side {
  CellResponse of;           ///< of R
  CellResidual in_V, beyond; ///< in Z and in C
  CellSeries z;              ///< S⁻¹ of that in Z, its linear part
  std::vector<double> z_size, z_error;
  CellSeries W; ///< residual of the medium model
  std::vector<double> W_tails;
};

/// Norms over the cell, of A and of Aᵀ.
struct CellBound::Norms {
  double in_V = 0, in_V_moved = 0, to_C = 0; ///< of J, how far it moves, of J_C
  double inverse = 0, inverse_moved = 0;     ///< of (RᵀAR)⁻¹
  double size_of_R = 0;
  double coupled = 0, S = 0; ///< ‖J‖²‖(RᵀAR)⁻¹‖, 1/(1 − that)
  double g = 0, off_CZ = 0, dropped = 0;
  double moved = 0; ///< ‖S − S at the centre‖
};

CellBound::Side CellBound::side(const Cell& cell, const CellFactors& factors,
                                const CellRegion::Blocks& A) const {
  Side side{
      cell_response(cell, factors, A.RR, spaces_.R_ports), {}, {}, {}, {}, {}, {}, {}};
  if (!side.of.known) return side;
  const std::vector<double> R_sizes = diagonal_sizes(A.RR, side.of.scale);
  side.in_V = cell_residual(side.of, factors, A.ZR, spaces_.Z_ports,
                            products(diagonal_sizes(A.ZZ), R_sizes));
  const double size_of_R = root_of_weighted(spaces_.R_sizes, side.of.scale);
  std::vector<double> C_sizes = spaces_.C_sizes;
  for (double& size : C_sizes) size *= size_of_R;
  side.beyond = cell_residual(side.of, factors, A.CR, couplings_.ports, C_sizes);
  return side;
}

std::optional<CellBound::Norms> CellBound::norms(const Cell& cell,
                                                 const CellFactors& factors,
                                                 const Side& inputs, const Side& outputs,
                                                 std::vector<double>& along) const {
  const Powers none(cell.variables(), 0);
  const std::vector<double> largest = factors.largest();
  Norms n;
  for (const Side* side : {&inputs, &outputs}) {
    n.in_V = std::max(n.in_V, side->in_V.norm);
    n.in_V_moved = std::max(n.in_V_moved, side->in_V.moved);
    n.to_C = std::max(n.to_C, side->beyond.norm);
    n.inverse = std::max(n.inverse, side->of.inverse);
    n.inverse_moved = std::max(n.inverse_moved, side->of.moved);
  }
  n.size_of_R = root_of_weighted(spaces_.R_sizes, inputs.of.scale);
  n.coupled = n.in_V * n.in_V * n.inverse;
  if (!(n.coupled < 1)) return std::nullopt;
  n.S = 1 / (1 - n.coupled);
  // S = A − J (RᵀAR)⁻¹ Jᵀ differs from that at the centre by `moved`.
  n.moved = n.in_V_moved * (2 * n.in_V + n.in_V_moved) * n.inverse +
            n.in_V * n.in_V * n.inverse_moved;
  n.dropped = couplings_.dropped_M * (largest[0] * couplings_.sigma + largest[1]);
  along.assign(cell.variables(), 0.0);
  for (std::size_t m = 0; m < spaces_.ZZ_norms.size(); ++m) {
    n.moved +=
        (largest[m] - std::abs(factors.of.at(none)[m]) + cell_rounding * largest[m]) *
        spaces_.ZZ_norms[m];
    for (const auto& [powers, f] : factors.of)
      for (std::size_t v = 0; v < powers.size(); ++v)
        if (powers[v] > 0) along[v] += std::abs(f[m]) * spaces_.ZZ_norms[m];
    n.off_CZ += factors.rest[m] * spaces_.CZ_norms[m] +
                cell_rounding * largest[m] * spaces_.C_sizes[m] * spaces_.Z_size;
    if (m > 1) {
      n.g += largest[m] * spaces_.CZ_norms[m];
      n.dropped += largest[m] * couplings_.dropped_terms[m - 2];
    }
  }
  // K and M couple by the same matrix: σ a_k + a_m.
  double shift = couplings_.sigma * factors.rest[0] + factors.rest[1];
  for (const auto& [powers, f] : factors.of)
    shift += std::abs(couplings_.sigma * f[0] + f[1]);
  n.g += shift * spaces_.CZ_norms[1] + n.dropped * spaces_.Z_size + n.off_CZ;
  n.to_C += n.dropped * n.size_of_R;
  return n;
}

/// z = S⁻¹ of what is left in V: Jacobi's iteration for the linear part, the rest by its norm; then W of
/// the medium model. @param other  of the transposed matrix.
void CellBound::solve(Side& side, const Side& other, const CellRegion::Blocks& A,
                      const CellFactors& factors, const Norms& n) const {
  const std::size_t ports = side.of.sizes.size();
  const ComplexDense at_centre = series_of(A.ZZ, factors).begin()->second;
  side.z_error = side.in_V.tails;
  side.z_size.assign(ports, 0.0);
  for (const auto& [powers, y] : side.in_V.y) {
    if (degree_of(powers) > 1) {
      const std::vector<double> norms = column_norms(y);
      for (std::size_t j = 0; j < ports; ++j) side.z_error[j] += norms[j];
      continue;
    }
    ComplexDense solution(y.rows, y.columns), left = y;
    for (int sweep = 0; sweep < 3; ++sweep) {
      for (int j = 0; j < y.columns; ++j)
        for (int i = 0; i < y.rows; ++i) solution(i, j) += left(i, j) / at_centre(i, i);
      left = y;
      add_to(left, multiply(at_centre, solution), -1);
      add_to(left,
             multiply(side.in_V.at_centre,
                      multiply(side.of.at_centre,
                               multiply_transposed(other.in_V.at_centre, solution))));
    }
    const std::vector<double> off = column_norms(left), size = column_norms(solution);
    for (std::size_t j = 0; j < ports; ++j) {
      side.z_error[j] += off[j] + n.moved * size[j];
      side.z_size[j] += size[j];
    }
    side.z.emplace(powers, std::move(solution));
  }
  for (double& error : side.z_error) error *= n.S;
  side.W = side.beyond.y;
  add_product(series_of(A.CZ, factors), side.z, -1, side.W);
  side.W_tails = side.beyond.tails;
  const double m = n.to_C * n.inverse * n.in_V;
  for (std::size_t j = 0; j < ports; ++j) {
    const double all_z = side.z_size[j] + side.z_error[j],
                 x = n.size_of_R * (side.of.sizes[j] + n.inverse * n.in_V * all_z) +
                     spaces_.Z_size * all_z;
    side.W_tails[j] += (n.g + m) * side.z_error[j] + (n.off_CZ + m) * side.z_size[j] +
                       couplings_.dropped_ports[j] + n.dropped * x;
  }
}

CellBound::Look CellBound::look(const Cell& cell) const {
  const CellFactors factors(medium_.system, cell);
  const CellRegion::Blocks &A = spaces_.of_A, &At = spaces_.of_outputs();
  const bool symmetric = &A == &At;
  Side inputs = side(cell, factors, A);
  const Look unknown{{}, inputs.of.longest()};
  if (!inputs.of.known) return unknown;
  std::optional<Side> of_outputs;
  if (!symmetric) {
    of_outputs = side(cell, factors, At);
    if (!of_outputs->of.known) return unknown;
  }
  Side& outputs = symmetric ? inputs : *of_outputs;
  std::vector<double> along;
  const auto n = norms(cell, factors, inputs, outputs, along);
  if (!n) return unknown;
  for (std::size_t v = 0; v < along.size(); ++v)
    inputs.of.by_variable[v] = std::max(inputs.of.by_variable[v], along[v]);
  solve(inputs, outputs, A, factors, *n);
  if (!symmetric) solve(outputs, inputs, At, factors, *n);

  // The Schur complement of C.
  const double m = n->to_C * n->inverse * n->in_V,
               off = (n->to_C * n->to_C * n->inverse + n->g * n->g * n->coupled * n->S +
                      (2 * n->g * m + m * m) * n->S),
               free = 1 / (spaces_.kept - spaces_.chi * spaces_.chi);
  if (!(free * off < 1)) return unknown;
  const double S_beyond = free / (1 - free * off);

  const auto ports = static_cast<int>(inputs.of.sizes.size());
  const FourNorms in_V(inputs.in_V.y, inputs.in_V.tails),
      of_body(inputs.W, inputs.W_tails);
  std::optional<FourNorms> out_V, out_body;
  if (!symmetric) {
    out_V.emplace(outputs.in_V.y, outputs.in_V.tails);
    out_body.emplace(outputs.W, outputs.W_tails);
  }
  const CellProduct within{transposed_product(outputs.in_V.y, inputs.z),
                           column_sums(outputs.in_V.y, ports), outputs.in_V.tails,
                           inputs.z_size, inputs.z_error};
  std::optional<CellProduct> of_modes;
  if (!A.QQ.empty()) {
    const CellResponse small = cell_response(cell, factors, A.QQ, spaces_.Q_ports);
    if (!small.known) return {{}, small.longest()};
    std::optional<CellResponse> of_transposed;
    if (!symmetric) {
      of_transposed = cell_response(cell, factors, At.QQ, spaces_.Q_ports);
      if (!of_transposed->known) return {{}, small.longest()};
    }
    of_modes = cell_product(inputs.of, {small, A.RQ},
                            {symmetric ? small : *of_transposed, At.RQ}, factors,
                            spaces_.R_ports,
                            products(diagonal_sizes(A.QQ, small.scale),
                                     diagonal_sizes(A.RR, inputs.of.scale)));
  }
  Dense scaled_ports = spaces_.R_ports;
  for (int j = 0; j < scaled_ports.columns; ++j)
    for (int i = 0; i < scaled_ports.rows; ++i)
      scaled_ports(i, j) *= inputs.of.scale[as_size(i)];
  CellSeries H; // of R, from all ports to all
  for (const auto& [powers, x] : inputs.of.x)
    H.emplace(powers, multiply_transposed(scaled_ports, x));
  const std::vector<double> output_sizes = column_norms(scaled_ports);
  const Powers none(cell.variables(), 0);
  Look result{{}, inputs.of.longest()};
  const int n_in = medium_.system.B.columns,
            first = medium_.system.outputs_are_inputs ? 0 : n_in;
  for (const PortView& view : medium_.views) {
    std::vector<int> rows = view.rows;
    for (int& row : rows) row += first;
    // yᵀS⁻¹y = yᵀz + yᵀ(S⁻¹y − z)
    const double of_R = std::min(within.of(rows, view.columns),
                                 n->S * (out_V ? *out_V : in_V).of(rows) *
                                     in_V.of(view.columns)) +
                        S_beyond * (out_body ? *out_body : of_body).of(rows) *
                            of_body.of(view.columns),
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
                             root_of_squares(inputs.of.tails, view.columns) -
                         of_R;
    if (!(least > 0) || !std::isfinite(error)) return {{}, inputs.of.longest()};
    result.worst_of.push_back(error / least);
  }
  return result;
}

} // namespace flexgram
