/// irka: interpolation at the mirror images of the small body's own poles (Gugercin,
/// Antoulas, Beattie 2008; Wyatt 2012 for second order), one-sided.

#include "base/index.hpp"
#include "basis/method.hpp"
#include "linalg/decompositions.hpp"

#include <algorithm>
#include <cmath>

namespace flexgram {
namespace {

using Complex = std::complex<double>;

/// One-sided, symmetric iteration to H2 optimality: interpolation at the mirror images of
/// the reduced poles, along the reduced modes' loads; one real vector for each pair of
/// poles, the real part at the phase where it is largest.
Dense irka_basis(const Elastic& e, Dense basis) {
  const int m = basis.columns;
  const DenseSystem& full = e.system;
  const Dense& B = e.response.modal_inputs();
  const auto& mu = e.response.mu();
  std::vector<double> previous;
  for (int iteration = 0; iteration < 40; ++iteration) {
    const DenseSystem small = full.project(basis);
    const DenseResponse modes(small, e.response.tau());
    double change = previous.empty() ? 1 : 0;
    for (std::size_t i = 0; i < previous.size(); ++i)
      change = std::max(change, std::abs(modes.lambda()[i] - previous[i]) /
                                    (modes.lambda()[i] + e.response.tau()));
    if (change < 1e-6) break;
    previous = modes.lambda();
    Dense next(e.count, m);
    for (int i = 0; i < m; ++i) {
      const double l = std::max(modes.lambda()[as_size(i)], 0.0);
      const double omega = std::sqrt(l);
      double d = full.damping.alpha + full.damping.beta * l + full.damping.eta * omega;
      for (const auto& [law, T] : small.terms) {
        const Dense u = part_of(modes.U(), 0, m, i, 1);
        d += multiply_transposed(u, multiply(T, u))(0, 0) / modes.mu()[as_size(i)] *
             law.as_damper(omega);
      }
      const Complex s(0.5 * d, std::sqrt(std::max(l - 0.25 * d * d, 0.0)));
      // The extra damping of the full system by its diagonal: the point of interpolation
      // need not be exact.
      Dense vector(e.count, 1);
      std::vector<Complex> v;
      Complex square = 0;
      for (int k = 0; k < e.count; ++k) {
        Complex load = 0;
        for (int p = 0; p < B.columns; ++p) load += B(k, p) * modes.modal_inputs()(i, p);
        const double m_k = mu[as_size(k)], k_k = 1 - e.response.tau() * m_k;
        const Complex a = s * s * m_k +
                          s * (full.damping.alpha * m_k + full.damping.beta * k_k) +
                          k_k * Complex(1, full.damping.eta);
        v.push_back(load / (a == 0.0 ? Complex(1e-300) : a));
        square += m_k * v.back() * v.back();
      }
      const Complex turn = std::exp(Complex(0, -0.5 * std::arg(square)));
      double size = 0;
      for (int k = 0; k < e.count; ++k) {
        vector(k, 0) = (v[as_size(k)] * turn).real();
        size += vector(k, 0) * vector(k, 0);
      }
      for (double& x : vector.data) x /= size > 0 ? std::sqrt(size) : 1;
      set_part(next, 0, i, vector);
    }
    basis = orthonormal_columns(multiply(e.response.U(), next));
  }
  return basis;
}

Candidate make(const SecondStage& stage) {
  const auto e = std::make_shared<Elastic>(stage);
  const Dense start =
      weighted_svd(gramian_factor(e->response, stage.bands, stage.equal_ports), e->gram)
          .vectors;
  Candidate c;
  c.least = e->rigid + 1;
  c.most = e->rigid + start.columns;
  c.basis = [e, start](int m) {
    return after_rigid(irka_basis(*e, first_columns(start, m - e->rigid)), e->rigid,
                       e->N);
  };
  return c;
}

} // namespace

extern const Method irka_method;
const Method irka_method{"iterative rational Krylov, H2 optimal if it converges", make};

} // namespace flexgram
