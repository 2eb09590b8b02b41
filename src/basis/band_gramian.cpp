#include "basis/band_gramian.hpp"

#include "base/index.hpp"
#include "base/process.hpp"
#include "linalg/decompositions.hpp"
#include "model/pencil_modes.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

namespace flexgram {
namespace {

using Complex = std::complex<double>;
constexpr int points = 10;
constexpr double loss_factor = 0.01; // of undamped bodies

double distance(Complex pole, double a, double b) {
  const double beside = std::max({a - pole.real(), pole.real() - b, 0.0});
  return std::hypot(beside, pole.imag());
}

void append(Quadrature& q, double a, double b, const BandWeight* weight) {
  Quadrature part = band_quadrature(a, b, points);
  for (std::size_t l = 0; l < part.omega.size(); ++l) {
    const double w = weight ? weight->at(part.omega[l]) : 1.0;
    if (w <= 0) continue;
    q.omega.push_back(part.omega[l]);
    q.weight.push_back(part.weight[l] * w);
  }
}

/// Halves [a, b] until it is no longer than its distance to the nearest pole.
void refine(Quadrature& q, double a, double b, const std::vector<Complex>& poles,
            const BandWeight* weight, int depth = 0) {
  double nearest = std::numeric_limits<double>::infinity();
  for (const auto& pole : poles) nearest = std::min(nearest, distance(pole, a, b));
  if (b - a <= nearest || depth == 60) return append(q, a, b, weight);
  const double middle = 0.5 * (a + b);
  refine(q, a, middle, poles, weight, depth + 1);
  refine(q, middle, b, poles, weight, depth + 1);
}

/// S of so many rows, SSᵀ the sum over all nodes of their two columns' products.
/// @param fill  (columns, number of the first, ω, √(w/π)) writes those of a node.
template <class Fill>
Dense summed_over(const Quadrature& nodes, int rows, const Fill& fill) {
  Dense sum(rows, 0);
  constexpr std::size_t chunk = 256;
  for (std::size_t first = 0; first < nodes.omega.size(); first += chunk) {
    stop_if_interrupted();
    const std::size_t count = std::min(chunk, nodes.omega.size() - first);
    Dense next(rows, 2 * static_cast<int>(count));
    for (std::size_t l = 0; l < count; ++l)
      fill(next, 2 * static_cast<int>(l), nodes.omega[first + l],
           std::sqrt(nodes.weight[first + l] / std::numbers::pi));
    sum = compressed(beside(sum, next));
  }
  return sum;
}

/// S of N rows, SSᵀ = Σ_l w_l Re(f fᴴ) with the factors f = 1/a of the modes.
Dense factors_of_modes(const DenseResponse& response, const Quadrature& nodes,
                       double eta_added) {
  const int N = response.system().order();
  return summed_over(nodes, N, [&](Dense& S, int column, double omega, double root) {
    const auto a = response.diagonal(omega, eta_added);
    for (int i = 0; i < N; ++i) {
      const Complex value = root / a[as_size(i)];
      S(i, column) = value.real();
      S(i, column + 1) = value.imag();
    }
  });
}

/// Factor of each port, in modal coordinates: the 1/a_i once, then rows times the port's
/// loads.
std::vector<Dense> by_modes(const DenseResponse& response, const Quadrature& nodes,
                            double eta_added) {
  const Dense scalar = factors_of_modes(response, nodes, eta_added);
  const Dense& B = response.modal_inputs();
  const int N = B.rows;
  std::vector<Dense> factors;
  for (int p = 0; p < B.columns; ++p) {
    factors.push_back(scalar);
    for (int j = 0; j < scalar.columns; ++j)
      for (int i = 0; i < N; ++i) factors.back()(i, j) *= B(i, p);
  }
  return factors;
}

std::vector<Dense> by_solves(const DenseResponse& response, const Quadrature& nodes,
                             double eta_added) {
  const int N = response.system().order(), ports = response.system().B.columns,
            all = 2 * static_cast<int>(nodes.omega.size()),
            most = std::min(4 * N + 2, all); // columns, before they are compressed
  std::vector<Dense> factors(as_size(ports), Dense(N, most));
  std::vector<int> filled(as_size(ports), 0);
  for (std::size_t l = 0; l < nodes.omega.size(); ++l) {
    stop_if_interrupted();
    const double root = std::sqrt(nodes.weight[l] / std::numbers::pi);
    const ComplexDense x = response.modal_response(nodes.omega[l], eta_added);
    for (int p = 0; p < ports; ++p) {
      Dense& factor = factors[as_size(p)];
      int& count = filled[as_size(p)];
      for (int i = 0; i < N; ++i) {
        factor(i, count) = root * x(i, p).real();
        factor(i, count + 1) = root * x(i, p).imag();
      }
      count += 2;
      if (count + 2 <= most || most == all) continue;
      const Dense fewer = compressed(part_of(factor, 0, N, 0, count));
      set_part(factor, 0, 0, fewer);
      count = fewer.columns;
    }
  }
  for (std::size_t p = 0; p < factors.size(); ++p)
    factors[p] = part_of(factors[p], 0, N, 0, filled[p]);
  return factors;
}

/// S of 2c rows, SSᵀ = [Re F, −Im F; Im F, Re F], F = Σ_l w_l f fᴴ with the factors f = 1/d of the
/// c complex modes.
Dense factors_of_modes(const PencilModes& modes, const Quadrature& nodes) {
  const int c = modes.count();
  return summed_over(nodes, 2 * c, [&](Dense& S, int column, double omega, double root) {
    for (int i = 0; i < c; ++i) {
      const auto d = modes.diagonal({omega, omega}, i);
      const double least = std::max(d.rounding, 1e-150); // on an undamped pole
      const Complex value = root / (std::abs(d.d0) > least ? d.d0 : least);
      S(i, column) = S(c + i, column + 1) = value.real();
      S(c + i, column) = value.imag();
      S(i, column + 1) = -value.imag();
    }
  });
}

/// As `by_modes`, of X diag(f) (EX)⁻¹B.
std::vector<Dense> by_pencil(const PencilModes& modes, const DenseResponse& response,
                             const Quadrature& nodes) {
  const Dense scalar = factors_of_modes(modes, nodes), &B = response.modal_inputs();
  const int N = B.rows, c = modes.count();
  const ComplexDense loads = multiply(modes.inverse(), as_complex(B));
  std::vector<Dense> factors;
  for (int p = 0; p < B.columns; ++p) {
    Dense rows(N, 2 * c);
    for (int j = 0; j < c; ++j)
      for (int i = 0; i < N; ++i) {
        const Complex x = modes.X()(i, j) * loads(j, p);
        rows(i, j) = x.real();
        rows(i, c + j) = -x.imag();
      }
    factors.push_back(multiply(rows, scalar));
  }
  return factors;
}

/// By complex modes, where there are so many nodes that these are cheaper than solves.
std::vector<Dense> of_each_port(const DenseResponse& response, const Quadrature& nodes,
                                double eta_added) {
  if (response.is_diagonal()) return by_modes(response, nodes, eta_added);
  const std::size_t few = as_size(8 * response.system().order());
  if (nodes.omega.size() > few) {
    DenseSystem lossy = response.system();
    lossy.damping.eta += eta_added;
    const DenseResponse damped(lossy, response.tau(), response.U(), response.lambda(),
                               response.modal_inputs(), response.modal_terms());
    if (const auto modes = PencilModes::of(damped))
      return by_pencil(*modes, damped, nodes);
  }
  return by_solves(response, nodes, eta_added);
}

Dense factor_of(const DenseResponse& response, const Quadrature& nodes, double eta_added,
                bool equal_ports) {
  Dense all(response.system().order(), 0);
  const auto& mu = response.mu(); // UᵀMU
  for (Dense& part : of_each_port(response, nodes, eta_added)) {
    double square = 0;
    for (int j = 0; j < part.columns; ++j)
      for (int i = 0; i < part.rows; ++i)
        square += mu[as_size(i)] * part(i, j) * part(i, j);
    if (equal_ports && square > 0)
      for (double& x : part.data) x /= std::sqrt(square);
    const Dense rows = compressed(part);
    all.data.insert(all.data.end(), rows.data.begin(), rows.data.end());
    all.columns += rows.columns;
    if (all.columns > 8 * all.rows) all = compressed(all);
  }
  return multiply(response.U(), compressed(all));
}

/// A factor of P = (SSᵀ) ∘ (BBᵀ), entry by entry, the same Gramian at a price without the
/// ports. Eigenvalues of P, scaled to a unit diagonal, are right to ε of the largest, so half
/// the digits are lost.
Dense factor_by_squares(const DenseResponse& response, const Quadrature& nodes,
                        double eta_added, bool equal_ports) {
  const Dense S = factors_of_modes(response, nodes, eta_added);
  Dense P = multiply(S, transpose(S)), B = response.modal_inputs();
  for (int p = 0; p < B.columns && equal_ports; ++p) {
    double square = 0;
    for (int i = 0; i < B.rows; ++i)
      square += response.mu()[as_size(i)] * P(i, i) * B(i, p) * B(i, p);
    for (int i = 0; i < B.rows && square > 0; ++i) B(i, p) /= std::sqrt(square);
  }
  const Dense loads = multiply(B, transpose(B));
  for (std::size_t i = 0; i < P.data.size(); ++i) P.data[i] *= loads.data[i];
  symmetrise(P);
  // Rigid and resonant modes are large: each by its own size.
  std::vector<double> root;
  for (int i = 0; i < P.rows; ++i) root.push_back(P(i, i) > 0 ? std::sqrt(P(i, i)) : 1.0);
  for (int j = 0; j < P.columns; ++j)
    for (int i = 0; i < P.rows; ++i) P(i, j) /= root[as_size(i)] * root[as_size(j)];
  SymmetricEigen eigen = symmetric_eigen(std::move(P));
  for (int j = 0; j < eigen.vectors.columns; ++j)
    for (int i = 0; i < eigen.vectors.rows; ++i)
      eigen.vectors(i, j) *=
          root[as_size(i)] * std::sqrt(std::max(eigen.values[as_size(j)], 0.0));
  return multiply(response.U(), eigen.vectors);
}

} // namespace

double BandWeight::at(double w) const {
  if (omega.size() < 2 || w < omega.front() || w > omega.back())
    return omega.size() == 1 ? weight[0] : 0.0;
  const auto above = std::upper_bound(omega.begin(), omega.end(), w) - omega.begin();
  const auto right = as_size(std::clamp<std::ptrdiff_t>(
      above, 1, static_cast<std::ptrdiff_t>(omega.size()) - 1));
  if (omega[right] == omega[right - 1]) return weight[right];
  const double t = (w - omega[right - 1]) / (omega[right] - omega[right - 1]);
  return (1 - t) * weight[right - 1] + t * weight[right];
}

Dense gramian_factor(const DenseResponse& response, const std::vector<BandWeight>& bands,
                     bool equal_ports, bool half_the_digits) {
  const double eta = response.system().is_undamped() ? loss_factor : 0.0;
  const auto at = poles(response, eta);
  Quadrature nodes;
  for (const auto& band : bands) {
    if (band.omega.front() == band.omega.back()) {
      nodes.omega.push_back(band.omega.front());
      nodes.weight.push_back(1.0);
      continue;
    }
    for (std::size_t l = 0; l + 1 < band.omega.size(); ++l)
      refine(nodes, band.omega[l], band.omega[l + 1], at, &band);
  }
  if (half_the_digits && response.is_diagonal())
    return factor_by_squares(response, nodes, eta, equal_ports);
  return factor_of(response, nodes, eta, equal_ports);
}

Dense whole_axis_factor(const DenseResponse& response, bool equal_ports) {
  const double eta = response.system().is_undamped() ? loss_factor : 0.0;
  const auto at = poles(response, eta);
  double far = 0;
  for (const auto& pole : at) far = std::max(far, std::abs(pole));
  Quadrature nodes;
  refine(nodes, 0, 2 * far, at, nullptr);
  // The tail in 1/ω: X falls as ω⁻², so the integrand is smooth in t = 2 far/ω.
  Quadrature tail = band_quadrature(0, 1, 2 * points);
  for (std::size_t l = 0; l < tail.omega.size(); ++l) {
    nodes.omega.push_back(2 * far / tail.omega[l]);
    nodes.weight.push_back(tail.weight[l] * 2 * far / (tail.omega[l] * tail.omega[l]));
  }
  return factor_of(response, nodes, eta, equal_ports);
}

} // namespace flexgram
