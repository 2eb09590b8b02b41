/// What A couples the space V to in the rest of the body (docs/proof.md, section 5). Declared in
/// certificate.hpp.

#include "base/index.hpp"
#include "medium/certificate.hpp"

#include <cmath>

namespace flexgram {

/// The parts hold P y = y − W V Vᵀ y of forces y, W = M + κK and VᵀWV = I. Of a column u of V with
/// uᵀKu = k, uᵀMu = m, w = m + κk, P K u = (m K − k M)u/w. A vector c with cᵀEV = 0 has
/// cᵀK u = σ cᵀM u, so cᵀM u = w/(σm − k) cᵀP K u, and of any y
/// cᵀy = cᵀP y + (1 + κσ) Σ_j cᵀM u_j u_jᵀy/w_j.
Certificate::Couplings Certificate::couplings(const DenseSystem& system,
                                              const std::vector<double>& unit,
                                              const std::vector<int>& ports,
                                              const Dense& port_rows) const {
  const int N = system.order();
  const double sigma = shifts_.sigma, kappa = shifts_.kappa, both = 1 + kappa * sigma;
  Couplings of;
  of.sigma = sigma;
  of.softening = softening_;
  of.provable = provable_;
  const Dense K = transpose(parts_.K); // k × N in the coordinates U
  of.M = Dense(K.rows, N);
  Dense inverse(N, N); // 1/w_j
  std::vector<double> dropped;
  double squares = 0;
  for (int j = 0; j < N; ++j) {
    const auto at = as_size(j);
    const double k = system.K(j, j), m = system.M(j, j), w = m + kappa * k,
                 factor = unit[at] * w / (sigma * m - k);
    for (int i = 0; i < K.rows; ++i) of.M(i, j) = factor * K(i, j);
    inverse(j, j) = 1 / w;
    dropped.push_back(std::abs(factor) * parts_.dropped_K[at]);
    squares += dropped.back() * dropped.back();
  }
  of.dropped_M = std::sqrt(squares);
  const Dense through = multiply(of.M, inverse);
  /// Of Σ_j cᵀM u_j u_jᵀy/w_j, y of each column.
  const auto dropped_through = [&](const Dense& rows, int column) {
    double sum = 0;
    for (int j = 0; j < N; ++j)
      sum += dropped[as_size(j)] * inverse(j, j) * std::abs(rows(j, column));
    return both * sum;
  };
  for (std::size_t t = 0; t < parts_.terms.size(); ++t) {
    Dense T = multiply(through, system.terms[t].matrix);
    double sum = 0;
    for (int j = 0; j < N; ++j) {
      for (int i = 0; i < T.rows; ++i)
        T(i, j) = both * T(i, j) + unit[as_size(j)] * parts_.terms[t](j, i);
      sum += std::pow(unit[as_size(j)] * parts_.dropped_terms[t][as_size(j)] +
                          dropped_through(system.terms[t].matrix, j),
                      2);
    }
    of.terms.push_back(std::move(T));
    of.dropped_terms.push_back(std::sqrt(sum));
  }
  of.ports = columns_of(parts_.ports, ports, scale_);
  add_to(of.ports, multiply(through, port_rows), both);
  for (std::size_t p = 0; p < ports.size(); ++p)
    of.dropped_ports.push_back(parts_.dropped_ports[as_size(ports[p])] /
                                   scale_[as_size(ports[p])] +
                               dropped_through(port_rows, static_cast<int>(p)));
  return of;
}

} // namespace flexgram
