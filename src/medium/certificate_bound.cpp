/// The bound itself, over an interval of ω (docs/proof.md, sections 3 and 4). Declared in
/// certificate.hpp.

#include "base/index.hpp"
#include "linalg/decompositions.hpp"
#include "medium/certificate.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numeric>

namespace flexgram {
namespace {

using Complex = std::complex<double>;
constexpr double infinity = std::numeric_limits<double>::infinity();

/// sup over μ >= 0 of |(n_0 + n_1 μ)/(d_0 + d_1 μ)|, the limit included. The stationary
/// points of the quotient of the squares are the roots of a quadratic.
double largest_quotient(std::array<Complex, 2> n, std::array<Complex, 2> d) {
  const auto square = [](std::array<Complex, 2> f) {
    return std::array<double, 3>{std::norm(f[0]), 2 * (f[1] * std::conj(f[0])).real(),
                                 std::norm(f[1])};
  };
  const auto N = square(n), D = square(d);
  const auto value = [&](double mu) {
    const double denominator = D[0] + mu * (D[1] + mu * D[2]);
    return denominator > 0 ? (N[0] + mu * (N[1] + mu * N[2])) / denominator : infinity;
  };
  double largest = std::max(value(0), D[2] > 0 ? N[2] / D[2] : infinity);
  const double x = N[2] * D[1] - N[1] * D[2], y = N[2] * D[0] - N[0] * D[2],
               e = N[1] * D[0] - N[0] * D[1], root = y * y - x * e; // xμ² + 2yμ + e = 0
  const auto stationary = [&](double mu) {
    if (mu > 0 && std::isfinite(mu)) largest = std::max(largest, value(mu));
  };
  if (x == 0 && y != 0) stationary(-e / (2 * y));
  if (x != 0 && root >= 0) {
    stationary((-y - std::sqrt(root)) / x);
    stationary((-y + std::sqrt(root)) / x);
  }
  return std::sqrt(std::max(largest, 0.0)) * (1 + 1e-14);
}

/// Squares of the singular values of W, descending; of many columns their norm alone.
Certificate::SquaredValues squares_of(const ComplexDense& w) {
  const ComplexDense gram = multiply_transposed(w, w, true);
  Certificate::SquaredValues squares{frobenius_norm(gram), {}};
  if (w.columns > Certificate::few_ports) return squares;
  squares.each = hermitian_eigenvalues(gram);
  std::reverse(squares.each.begin(), squares.each.end());
  return squares;
}

/// √Σ σ_i(A)² σ_i(B)², from the squares; if those of one are not known, at most that, by
/// the Cauchy-Schwarz inequality.
double paired_norm(const Certificate::SquaredValues& a,
                   const Certificate::SquaredValues& b) {
  const std::vector<double>&alpha = a.each, &beta = b.each;
  if (alpha.empty() || beta.empty()) return std::sqrt(a.norm * b.norm) * (1 + 1e-12);
  double sum = 0;
  for (std::size_t i = 0; i < std::min(alpha.size(), beta.size()); ++i)
    sum += std::max(alpha[i], 0.0) * std::max(beta[i], 0.0);
  return std::sqrt(sum);
}

} // namespace

/// δ over the interval: of a body without terms ‖J A_Φ⁻¹ Jᵀ‖ at most, of others what it takes from
/// the Hermitian part of S.
double Certificate::mode_coupling(const DenseResponse& response,
                                  const ResponseSeries& x) const {
  if (!provable_) return infinity;
  if (!response.is_diagonal()) return by_terms_.over(response.system(), x.interval);
  const Coefficients outer(response.system(), -shifts_.sigma, x.interval);
  const double largest_c = std::abs(outer.c) + outer.moved_c;
  double sum = 0;
  for (std::size_t j = 0; j < ritz_.mu.size(); ++j)
    sum += std::pow(largest_c * ritz_.G_norm[j], 2) * x.largest[j];
  return sum;
}

Certificate::Inverse Certificate::inverse(const DenseResponse& response,
                                          const ResponseSeries& x) const {
  Inverse result;
  // Re (a_k + c μ) >= 1 + (ω_c² − ω²) μ, whatever the damping; with gyroscopic forces the
  // Hermitian part of S₀ is at least 1/q.
  double q = softening_.enlarges(x.interval.last), radius = q;
  if (!(softening_.needed_square(x.interval.last) <= shifts_.sigma))
    return {0, infinity, infinity, false};
  if (response.is_diagonal()) {
    const Coefficients k(response.system(), -shifts_.sigma, x.interval);
    const std::array<Complex, 2> denominator{k.a, k.c};
    q = std::min(q, largest_quotient({1.0, 0.0}, denominator));
    result.centre = 0.5 / k.a; // of 1/a_k and 0, for μ = 0 and ∞
    radius =
        largest_quotient({1.0 - result.centre * k.a, -result.centre * k.c}, denominator);
    // (a_k + c μ) at any other frequency is (1 + ε) times that at the centre.
    const double moved =
        k.moved_a * q + k.moved_c * largest_quotient({0.0, 1.0}, denominator);
    if (!(moved < 1)) return {0, infinity, infinity, true};
    radius += q * moved / (1 - moved);
    q = std::min(1.0, q / (1 - moved));
  }
  const double delta = mode_coupling(response, x);
  result.proved = q * delta < 1;
  result.norm = result.proved ? q / (1 - q * delta) : q;
  result.radius = radius + (result.proved ? q * delta * result.norm : 0.0);
  return result;
}

/// Of each mode the norm of its coordinate over some ports, in their units, anywhere in the
/// interval. @param columns  of x, the responses to the ports.
ProjectionRounding::Sizes Certificate::sizes_of(const ResponseSeries& x,
                                                const std::vector<int>& ports,
                                                const std::vector<int>& columns) const {
  ProjectionRounding::Sizes sizes(as_size(x.envelope.rows), 0.0);
  for (std::size_t k = 0; k < ports.size(); ++k) {
    const double unit = 1 / scale_[as_size(ports[k])];
    for (std::size_t i = 0; i < sizes.size(); ++i) {
      const double here = unit * x.envelope(static_cast<int>(i), columns[k]);
      sizes[i] += here * here;
    }
  }
  for (double& s : sizes) s = std::sqrt(s);
  return sizes;
}

/// Of each mode the rounding of its rows of some ports, in their units.
std::vector<double> Certificate::off(const std::vector<int>& ports) const {
  std::vector<double> off;
  for (int i = 0; i < rounding_.ports.rows; ++i)
    off.push_back(rounding_.of_ports(as_size(i), ports, scale_));
  return off;
}

/// @param x  the response to all ports.
Certificate::RoundingSizes
Certificate::rounding_sizes(const ResponseSeries& x,
                            const std::vector<int>& ports) const {
  const auto norm = [&](const Dense& rows) {
    if (rows.columns == 0) return 0.0;
    const Dense values = multiply_transposed(rows, x.envelope);
    double sum = 0;
    for (int j : ports)
      for (int i = 0; i < values.rows; ++i)
        sum += std::pow(values(i, j) / scale_[as_size(j)], 2);
    return std::sqrt(sum);
  };
  return {sizes_of(x, ports, ports), off(ports), norm(rigid_.rows),
          norm(rigid_.stiffness)};
}

/// Rounding of the projected matrices and ports, and what is told beside the claim.
/// @param omega  the interval's last.
void Certificate::add_rounding(Bound& bound, const DenseResponse& response, double omega,
                               const RoundingSizes& in, const RoundingSizes& out) const {
  const Damping& damping = response.system().damping;
  const double a_k = std::hypot(1, damping.eta + omega * damping.beta);
  bound.floor = rounding_.of_response(a_k, largest_of(response.system().terms, omega),
                                      omega, out.x, in.x);
  bound.rigid_floor = rounding_.of_rigid_modes(omega, out.x, in.x);
  double data_in = 0, data_out = 0;
  const auto rigid = as_size(rounding_.rigid);
  for (std::size_t i = 0; i < in.x.size(); ++i) {
    (i < rigid ? bound.rigid_floor : bound.floor) +=
        out.ports[i] * in.x[i] + in.ports[i] * out.x[i];
    data_in += std::pow(rounding_weights_[i] * in.x[i], 2);
    data_out += std::pow(rounding_weights_[i] * out.x[i], 2);
  }
  bound.data_rounding = 4 * data_rounding_ * a_k * std::sqrt(data_in * data_out);
  bound.rigid_rounding = a_k * (out.rigid * in.stiffness + out.stiffness * in.rigid);
}

std::optional<ErrorForm> Certificate::form(const DenseResponse& response,
                                           const PortSet& ports) const {
  if (!provable_) return std::nullopt;
  ErrorForm form;
  form.damping = response.system().damping;
  form.kappa = shifts_.kappa;
  form.cutoff = std::sqrt(shifts_.sigma);
  form.coupling = ritz_.G_norm;
  form.residual_stiffness = transpose(parts_.K);
  form.lost_stiffness = parts_.dropped_K;
  form.mass = response.mu();
  for (std::size_t j = 0; j < form.mass.size(); ++j) {
    const double lambda = response.lambda()[j];
    form.stiffness.push_back(std::isfinite(lambda) ? lambda * form.mass[j] : 1.0);
  }
  auto sums = rounding_.row_sums();
  form.rounding_stiffness = std::move(sums[0]);
  form.rounding_mass = std::move(sums[1]);
  const auto in_units = [&](const Dense& a, const std::vector<int>& chosen) {
    Dense some(a.rows, static_cast<int>(chosen.size()));
    for (int c = 0; c < some.columns; ++c) {
      const int port = chosen[as_size(c)];
      for (int i = 0; i < a.rows; ++i) some(i, c) = a(i, port) / scale_[as_size(port)];
    }
    return some;
  };
  const auto lost_of = [&](const std::vector<int>& chosen) {
    std::vector<double> lost;
    for (int port : chosen) {
      const auto at = as_size(port);
      lost.push_back(parts_.dropped_ports[at] / scale_[at]);
    }
    return lost;
  };
  form.inputs = in_units(response.modal_inputs(), ports.inputs);
  form.outputs = in_units(response.modal_inputs(), ports.outputs);
  form.residual_inputs = in_units(parts_.ports, ports.inputs);
  form.residual_outputs = in_units(parts_.ports, ports.outputs);
  form.lost_inputs = lost_of(ports.inputs);
  form.lost_outputs = lost_of(ports.outputs);
  form.rounding_inputs = in_units(rounding_.ports, ports.inputs);
  form.rounding_outputs = in_units(rounding_.ports, ports.outputs);
  return form;
}

const Certificate::SquaredValues&
Certificate::ResidualsAt::squares_of(const std::vector<int>& columns) {
  const auto known = squares.find(columns);
  if (known != squares.end()) return known->second;
  return squares.emplace(columns, flexgram::squares_of(columns_of(w, columns)))
      .first->second;
}

/// |…| of the residual's claim for a block, anywhere in an interval.
/// @param of_outputs  those of A(ω)ᵀ; of_inputs itself where A is symmetric.
double Certificate::error_of(const Inverse& S, const PortSet& block, const Moved& moved,
                             ResidualsAt& of_inputs, ResidualsAt& of_outputs) const {
  const bool same = &of_outputs == &of_inputs && block.inputs == block.outputs;
  const double in = moved.inputs, out = moved.outputs;
  const ComplexDense w_in = columns_of(of_inputs.w, block.inputs);
  const ComplexDense w_out =
      same ? ComplexDense() : columns_of(of_outputs.w, block.outputs);
  const ComplexDense& w_c = same ? w_in : w_out;
  const double added = frobenius_norm(w_c) * in + frobenius_norm(w_in) * out + in * out;
  const double paired =
      added + (same ? frobenius_norm(multiply_transposed(w_in, w_in, true))
                    : paired_norm(of_outputs.squares_of(block.outputs),
                                  of_inputs.squares_of(block.inputs)));
  // The Gram matrix is that of the norm or more: no bound of W_CᵀW_B by itself.
  const auto coefficients = [&](const ComplexDense& w_of, double moved_by) {
    double square = 0, widest = 0;
    for (std::size_t i = 0; i < gram_.each.size(); ++i) {
      widest = std::max(widest, gram_.each[i]);
      for (int j = 0; j < w_of.columns; ++j)
        square += std::norm(gram_.each[i] * w_of(static_cast<int>(i), j));
    }
    return std::sqrt(square) + widest * moved_by;
  };
  const double known = added + frobenius_norm(multiply_transposed(w_c, w_in)) +
                       gram_.added * coefficients(w_c, out) * coefficients(w_in, in);
  return std::min(S.norm * paired, std::abs(S.centre) * known + S.radius * paired);
}

std::vector<Certificate::Bound>
Certificate::over(const DenseResponse& response, const ResponseSeries& x,
                  const std::vector<PortSet>& blocks,
                  const ResponseSeries* of_transposed) const {
  const ResponseSeries& y = of_transposed ? *of_transposed : x;
  const auto add_rounding_of = [&](Bound& bound, const PortSet& block) {
    const RoundingSizes in = rounding_sizes(x, block.inputs);
    add_rounding(bound, response, x.interval.last, in,
                 !of_transposed && block.outputs == block.inputs
                     ? in
                     : rounding_sizes(y, block.outputs));
  };
  std::vector<Bound> bounds;
  if (whole_) {
    for (const PortSet& block : blocks) add_rounding_of(bounds.emplace_back(), block);
    return bounds;
  }
  const Inverse S = inverse(response, x);
  std::vector<int> all(as_size(x.x.columns));
  std::iota(all.begin(), all.end(), 0);
  const MatrixSeries w = residual(response, x, chosen(all)),
                     of_other = of_transposed ? residual(response, y, chosen(all, true))
                                              : MatrixSeries();
  const std::vector<double> far_x = moved(w),
                            far_y = of_transposed ? moved(of_other) : far_x;
  const auto moved_of = [](const std::vector<double>& moved, const std::vector<int>& of) {
    double square = 0;
    for (int j : of) square += std::pow(moved[as_size(j)], 2);
    return std::sqrt(square);
  };
  ResidualsAt inputs{w.centre()}, others;
  if (of_transposed) others.w = of_other.centre();
  ResidualsAt& outputs = of_transposed ? others : inputs;
  for (const PortSet& block : blocks) {
    Bound bound;
    bound.error = error_of(
        S, block, {moved_of(far_x, block.inputs), moved_of(far_y, block.outputs)}, inputs,
        outputs);
    bound.proved = S.proved;
    add_rounding_of(bound, block);
    bounds.push_back(bound);
  }
  return bounds;
}

/// The error is Z e + Φ f with ê = E_Z^½ e = S⁻¹W and f = −A_Φ⁻¹Jᵀê. From the real part of
/// êᴴSê = êᴴW, with t = êᴴTê and s = ‖ê‖: s² + (ω_c² − ω²) t <= s‖W‖ + δ s², and the energy
/// of Z e is s² + ω_c² t.
Certificate::FieldBound Certificate::field_over(const DenseResponse& response,
                                                const ResponseSeries& x,
                                                const FewResiduals& few,
                                                const std::vector<double>& strain) const {
  FieldBound bound;
  const Inverse S = inverse(response, x);
  bound.proved = S.proved && response.is_diagonal() && !x.largest.empty();
  const double last = x.interval.last, delta = mode_coupling(response, x);
  if (!bound.proved || !(last * last < shifts_.sigma) || !(delta < 1))
    return {infinity, infinity, false};
  const Chosen of = chosen(few);
  const std::vector<int>&ports = of.ports, &columns = of.columns;
  const MatrixSeries w = residual(response, x, of);
  const ComplexDense at_centre = w.centre();
  const std::vector<double> away = moved(w);
  double squares = 0;
  for (int j : columns) {
    double square = 0;
    for (int i = 0; i < at_centre.rows; ++i) square += std::norm(at_centre(i, j));
    squares += std::pow(std::sqrt(square) + away[as_size(j)], 2);
  }
  const double g = shifts_.sigma / (shifts_.sigma - last * last),
               curved = g * (1 - delta) - 1;
  const double s = curved > 0 ? std::min(S.norm, g / (2 * curved)) : S.norm;
  const Coefficients outer(response.system(), -shifts_.sigma, x.interval);
  const double largest_c = std::abs(outer.c) + outer.moved_c;
  double along = 0; // energy of Φ f
  for (std::size_t j = 0; j < ritz_.mu.size(); ++j)
    along += std::pow(strain[j] * largest_c * ritz_.G_norm[j] * x.largest[j], 2);
  bound.error = (std::sqrt(g * s - curved * s * s) + std::sqrt(along) * S.norm) *
                std::sqrt(squares) * (1 + 1e-12);
  // Rounding of the projected matrices: −A⁻¹ E x, in these coordinates.
  const Damping& damping = response.system().damping;
  const ProjectionRounding::Sizes sizes = sizes_of(x, ports, columns);
  const auto forces = rounding_.of_equations(
      std::hypot(1, damping.eta + last * damping.beta), last, sizes);
  double answer = 0;
  for (std::size_t k = 0; k < strain.size(); ++k)
    answer += std::pow(strain[k] * x.largest[k] * forces[k], 2);
  bound.floor = std::sqrt(answer);
  for (std::size_t k = 0; k < sizes.size(); ++k)
    bound.floor += rounding_.strain[k] * sizes[k];
  return bound;
}

} // namespace flexgram
