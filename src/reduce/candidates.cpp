/// Small bases out of the medium space.
///
/// Balancing. For symmetric M, D, K and C = Bᵀ the velocity observability Gramian of the
/// first-order form [−K 0; 0 M] x' = [0 −K; −K −D] x + [0; B] u equals the position
/// controllability Gramian: with the load on the first equation instead, v = A(s)⁻¹B. So
/// position-velocity balancing (Reis, Stykel 2008) is the position Gramian over the whole
/// axis in the mass inner product. Only where C ≠ Bᵀ it is something of its own.

#include "reduce/candidates.hpp"

#include "base/text.hpp"

#include <algorithm>
#include <cmath>

namespace flexgram {
namespace {

using Complex = std::complex<double>;

/// Unit vectors first … N−1 of R^N.
Dense unit_vectors(int N, int first) {
  Dense e(N, N - first);
  for (int j = 0; j < e.columns; ++j) e(first + j, j) = 1;
  return e;
}

/// Columns of `a` behind the rigid unit vectors.
Dense after_rigid(const Dense& a, int rigid, int N) {
  Dense result(N, rigid + a.columns);
  for (int j = 0; j < rigid; ++j) result(j, j) = 1;
  for (int j = 0; j < a.columns; ++j)
    std::copy_n(a.column(j), a.rows, result.column(rigid + j) + (N - a.rows));
  return result;
}

/// Left singular vectors of F in the inner product G: GᵀG-orthonormal, descending.
struct WeightedSvd {
  Dense vectors;
  std::vector<double> sigma;
};
WeightedSvd weighted_svd(const Dense& F, const Dense& G) {
  Dense L = G;
  if (cholesky(L) != 0)
    throw Error("the inner product is not positive on the medium space");
  const LeftSvd svd = left_svd(compressed(multiply_transposed(L, F)));
  WeightedSvd result;
  for (double s : svd.values) result.sigma.push_back(s * s);
  Dense inverse = identity(L.rows);
  solve_right_transposed(L, inverse); // L⁻ᵀ
  result.vectors = multiply(inverse, svd.vectors);
  return result;
}

Candidate nested(const std::string& name, Dense all, int least = 1) {
  Candidate c;
  c.name = name;
  c.least = least;
  c.most = all.columns;
  c.nested = true;
  c.basis = [all = std::move(all)](int m) { return first_columns(all, m); };
  return c;
}

struct Elastic {
  explicit Elastic(const SecondStage& stage)
      : rigid(stage.medium.rigid), N(stage.medium.system.order()), count(N - rigid),
        system(stage.medium.system.project(unit_vectors(N, rigid))),
        gram(part_of(stage.gram, rigid, count, rigid, count)),
        response(system, stage.medium.tau) {}
  int rigid, N, count;
  DenseSystem system;
  Dense gram;
  DenseResponse response;
};

/// The Gramian's eigenvalues; its eigenvectors, or where the rigid modes are kept apart
/// those of its elastic part.
Candidate gramian(const std::string& name, const SecondStage& stage,
                  const std::vector<BandWeight>& bands) {
  const DenseResponse response(stage.medium.system, stage.medium.tau);
  const Dense F = gramian_factor(response, bands, stage.equal_ports);
  const WeightedSvd all = weighted_svd(F, stage.gram);
  Candidate c;
  if (stage.medium.rigid > 0 && stage.keep_rigid) {
    const int N = F.rows, rigid = stage.medium.rigid, count = N - rigid;
    const Dense elastic = weighted_svd(part_of(F, rigid, count, 0, F.columns),
                                       part_of(stage.gram, rigid, count, rigid, count))
                              .vectors;
    c = nested(name, after_rigid(elastic, rigid, N), rigid + 1);
  } else {
    c = nested(name, all.vectors);
  }
  c.sigma = all.sigma;
  return c;
}

Candidate gramian_modes(const SecondStage& stage) {
  const Elastic e(stage);
  const double last = stage.bands.back().omega.back();
  int in_band = 0;
  for (double l : stage.medium.lambda) in_band += l <= last * last;
  Dense F = gramian_factor(e.response, stage.bands, stage.equal_ports);
  // Modes are the first coordinates and M-orthogonal to the rest, so what they leave is
  // the rest.
  for (int j = 0; j < F.columns; ++j)
    for (int i = 0; i < in_band; ++i) F(i, j) = 0;
  const int rest = e.count - in_band;
  const Dense inner = weighted_svd(part_of(F, in_band, rest, 0, F.columns),
                                   part_of(e.gram, in_band, rest, in_band, rest))
                          .vectors;
  return nested("gramian_modes", after_rigid(inner, e.rigid + in_band, e.N),
                e.rigid + in_band);
}

/// With the weight 1/‖H(ω)‖_F and ports in their own units the Gramian measures what eq.
/// (17) does: the error of H is the square of what the basis misses of X.
Candidate weighted(const SecondStage& stage) {
  std::vector<BandWeight> bands;
  for (const auto& band : stage.bands) {
    BandWeight b;
    for (double omega : band_grid(band.omega.front(), band.omega.back(), 36, {})) {
      b.omega.push_back(omega);
      b.weight.push_back(band.at(omega) / frobenius_norm(stage.medium.at(omega).H));
    }
    const double largest = *std::max_element(b.weight.begin(), b.weight.end());
    for (double& w : b.weight) w /= largest;
    bands.push_back(std::move(b));
  }
  SecondStage relative = stage;
  relative.equal_ports = false;
  return gramian("weighted", relative, bands);
}

Candidate whole_axis(const SecondStage& stage) {
  const Elastic e(stage);
  const WeightedSvd svd =
      weighted_svd(whole_axis_factor(e.response, stage.equal_ports), e.gram);
  Candidate c = nested("whole_axis", after_rigid(svd.vectors, e.rigid, e.N), e.rigid + 1);
  c.sigma = svd.sigma;
  return c;
}

/// Pairs of right and left vectors of Z_CᵀM Z_B, taken together so that the small body
/// stays symmetric.
Candidate balanced(const SecondStage& stage) {
  if (stage.medium.system.outputs_are_inputs) {
    Candidate c = whole_axis(stage);
    c.name = "balanced";
    c.remark = "equal to whole_axis in the mass inner product, since C = Bᵀ";
    return c;
  }
  const Elastic e(stage);
  DenseSystem dual = e.system;
  std::swap(dual.B, dual.C);
  const Dense Z_B = whole_axis_factor(e.response, stage.equal_ports);
  const Dense Z_C =
      whole_axis_factor(DenseResponse(dual, stage.medium.tau), stage.equal_ports);
  const Dense product = multiply_transposed(Z_C, multiply(e.system.M, Z_B));
  const LeftSvd left = left_svd(product), right = left_svd(transpose(product));
  const Dense T_B = multiply(Z_B, right.vectors), T_C = multiply(Z_C, left.vectors);
  Dense pairs(e.count, 0);
  for (int j = 0; j < std::min(T_B.columns, T_C.columns) && pairs.columns + 2 <= e.count;
       ++j) {
    for (const Dense* T : {&T_B, &T_C}) {
      Dense column = part_of(*T, 0, e.count, j, 1);
      const double size = frobenius_norm(column);
      for (double& x : column.data) x /= size > 0 ? size : 1;
      pairs = beside(pairs, column);
    }
  }
  Candidate c =
      nested("balanced", after_rigid(orthonormal_columns(std::move(pairs)), e.rigid, e.N),
             e.rigid + 1);
  for (double s : left.values) c.sigma.push_back(s);
  return c;
}

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
      const double l = std::max(modes.lambda()[static_cast<std::size_t>(i)], 0.0);
      const double omega = std::sqrt(l);
      double d = full.damping.alpha + full.damping.beta * l + full.damping.eta * omega;
      if (full.has_extra_damping()) {
        const Dense u = part_of(modes.U(), 0, m, i, 1);
        d += multiply_transposed(u, multiply(small.D, u))(0, 0) /
             modes.mu()[static_cast<std::size_t>(i)];
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
        const double m_k = mu[static_cast<std::size_t>(k)],
                     k_k = 1 - e.response.tau() * m_k;
        const Complex a = s * s * m_k +
                          s * (full.damping.alpha * m_k + full.damping.beta * k_k) +
                          k_k * Complex(1, full.damping.eta);
        v.push_back(load / (a == 0.0 ? Complex(1e-300) : a));
        square += m_k * v.back() * v.back();
      }
      const Complex turn = std::exp(Complex(0, -0.5 * std::arg(square)));
      double size = 0;
      for (int k = 0; k < e.count; ++k) {
        vector(k, 0) = (v[static_cast<std::size_t>(k)] * turn).real();
        size += vector(k, 0) * vector(k, 0);
      }
      for (double& x : vector.data) x /= size > 0 ? std::sqrt(size) : 1;
      set_part(next, 0, i, vector);
    }
    basis = orthonormal_columns(multiply(e.response.U(), next));
  }
  return basis;
}

Candidate irka(const SecondStage& stage) {
  const auto e = std::make_shared<Elastic>(stage);
  const Dense start =
      weighted_svd(gramian_factor(e->response, stage.bands, stage.equal_ports), e->gram)
          .vectors;
  Candidate c;
  c.name = "irka";
  c.least = e->rigid + 1;
  c.most = e->N;
  c.basis = [e, start](int m) {
    return after_rigid(irka_basis(*e, first_columns(start, m - e->rigid)), e->rigid,
                       e->N);
  };
  return c;
}

Candidate modal(const SecondStage& stage) {
  // The Ritz vectors of the whole medium space are better than those the search ended
  // with.
  const Elastic e(stage);
  const Dense modes =
      first_columns(e.response.U(), static_cast<int>(stage.medium.lambda.size()));
  return nested("modal", after_rigid(orthonormal_columns(modes), e.rigid, e.N),
                std::max(1, e.rigid));
}

/// Orthonormal columns spanning those of A, dropping what adds less than 1e-10 (modified
/// Gram-Schmidt, twice): the span of the first columns stays nested.
Dense nested_span(const Dense& A) {
  Dense Q(A.rows, 0);
  for (int j = 0; j < A.columns && Q.columns < A.rows; ++j) {
    Dense v = part_of(A, 0, A.rows, j, 1);
    const double before = frobenius_norm(v);
    for (int pass = 0; pass < 2 && Q.columns > 0; ++pass) {
      const Dense c = multiply(Q, multiply_transposed(Q, v));
      for (std::size_t i = 0; i < v.data.size(); ++i) v.data[i] -= c.data[i];
    }
    const double after = frobenius_norm(v);
    if (!(after > 1e-10 * before)) continue;
    for (double& x : v.data) x /= after;
    Q = beside(Q, v);
  }
  return Q;
}

/// Statics of a free body under port loads in equilibrium.
Dense free_statics(const Elastic& e, const Dense& elastic_ports, const Dense& all_ports) {
  Dense statics = multiply_transposed(e.response.U(), elastic_ports);
  for (int j = 0; j < statics.columns; ++j)
    for (int i = 0; i < e.count; ++i) // in modal coordinates K is 1 − τμ
      statics(i, j) /= std::max(
          1 - e.response.tau() * e.response.mu()[static_cast<std::size_t>(i)], 1e-12);
  const Dense resultants = part_of(all_ports, 0, e.rigid, 0, all_ports.columns);
  const SymmetricEigen eigen =
      symmetric_eigen(multiply_transposed(resultants, resultants));
  const double floor = 1e-12 * std::max(eigen.values.back(), 1e-300);
  int balanced_loads = 0;
  while (balanced_loads < eigen.vectors.columns &&
         eigen.values[static_cast<std::size_t>(balanced_loads)] <= floor)
    ++balanced_loads;
  return multiply(multiply(e.response.U(), statics),
                  first_columns(eigen.vectors, balanced_loads));
}

/// N − Z (ZᵀKZ)⁻¹ZᵀK N: the rest of the body follows unit motions N of the interfaces, by
/// the modes U of the body held there. The first `soft` of these, which may move without
/// stiffness, do not follow: they are to be basis vectors themselves, which spans the
/// same. (On soft mounts the inverse of K would show one motion only.)
Dense held_statics(const Dense& K, const Dense& N, const Dense& Z,
                   const DenseResponse& held, int soft) {
  if (Z.columns == soft) return N;
  const Dense modes =
      multiply(Z, part_of(held.U(), 0, Z.columns, soft, Z.columns - soft));
  Dense force = multiply_transposed(modes, multiply(K, N));
  for (int j = 0; j < force.columns; ++j)
    for (int i = 0; i < force.rows; ++i) // in modal coordinates K is 1 − τμ
      force(i, j) /= 1 - held.tau() * held.mu()[static_cast<std::size_t>(soft + i)];
  const Dense follows = multiply(modes, force);
  Dense statics = N;
  for (std::size_t i = 0; i < statics.data.size(); ++i)
    statics.data[i] -= follows.data[i];
  return statics;
}

/// Constraint modes (statics under unit motion of the interfaces, rigid modes among
/// them), then the modes of the body whose interfaces are held. All of it is response to
/// port loads, so the medium space holds it as exactly as H.
Candidate craig_bampton(const SecondStage& stage) {
  const Elastic e(stage);
  const DenseSystem& all = stage.medium.system;
  const Dense all_ports = all.outputs_are_inputs ? all.B : beside(all.B, all.C);
  const Dense span = nested_span(all_ports);

  // Coordinates without motion of the ports.
  const SymmetricEigen eigen = symmetric_eigen(multiply(span, transpose(span)));
  int held = 0; // projector onto the ports' span: eigenvalues 0 and 1
  while (held < e.N && eigen.values[static_cast<std::size_t>(held)] < 0.5) ++held;
  const Dense Z = first_columns(eigen.vectors, held);
  const DenseResponse fixed(all.project(Z), stage.medium.tau);
  const Dense fixed_interface_modes = multiply(Z, fixed.U());

  // Modes of the held body without stiffness, or so little that it could be rounding:
  // which of them is counted as soft does not change the span.
  int soft = 0;
  while (e.rigid == 0 && soft < held &&
         1 - fixed.tau() * fixed.mu()[static_cast<std::size_t>(soft)] < 1e-6)
    ++soft;
  const Dense constraint = nested_span(
      e.rigid == 0 ? held_statics(all.K, span, Z, fixed, soft)
                   : after_rigid(free_statics(e,
                                              e.system.outputs_are_inputs
                                                  ? e.system.B
                                                  : beside(e.system.B, e.system.C),
                                              all_ports),
                                 e.rigid, e.N));
  Candidate c =
      nested("craig_bampton", nested_span(beside(constraint, fixed_interface_modes)),
             constraint.columns + soft);
  int below = 0;
  const double cutoff = stage.medium.cutoff * stage.medium.cutoff;
  for (double l : fixed.lambda()) below += l < cutoff;
  c.remark = text("%d constraint modes, %d fixed-interface modes below the cutoff",
                  constraint.columns, below);
  return c;
}

/// (K − s_k M)⁻¹[M(K − s_k M)⁻¹]^j B, j = 0 … moments − 1, for all shifts: moment after
/// moment.
Candidate krylov(const SecondStage& stage) {
  const Elastic e(stage);
  const bool apart = stage.keep_rigid && e.rigid > 0;
  const DenseResponse all(stage.medium.system, stage.medium.tau);
  const DenseResponse& response = apart ? e.response : all;
  Dense columns(response.system().order(), 0);
  for (int j = 0; j < stage.moments; ++j)
    for (double omega : stage.shifts) {
      Dense block = response.modal_inputs();
      for (int i = 0; i < block.rows; ++i) {
        const double mu = response.mu()[static_cast<std::size_t>(i)];
        const double a = 1 - (response.tau() + omega * omega) * mu;
        const double factor = std::pow(mu / a, j) / a;
        for (int p = 0; p < block.columns; ++p) block(i, p) *= factor;
      }
      columns = beside(columns, multiply(response.U(), block));
    }
  const Dense span = nested_span(columns);
  Candidate c = apart ? nested("krylov", after_rigid(span, e.rigid, e.N), e.rigid + 1)
                      : nested("krylov", span);
  c.remark = text("%zu shifts, %d moments", stage.shifts.size(), stage.moments);
  return c;
}

} // namespace

const std::vector<std::string>& candidate_names() {
  static const std::vector<std::string> names{
      "gramian", "gramian_modes", "weighted",      "whole_axis", "balanced",
      "irka",    "modal",         "craig_bampton", "krylov",     "medium"};
  return names;
}

Candidate make_candidate(const std::string& name, const SecondStage& stage) {
  if (stage.medium.system.order() ==
      stage.medium.rigid) // nothing elastic is in the band's reach
    return nested(name, identity(stage.medium.rigid), stage.medium.rigid);
  if (name == "gramian_modes") return gramian_modes(stage);
  if (name == "weighted") return weighted(stage);
  if (name == "whole_axis") return whole_axis(stage);
  if (name == "balanced") return balanced(stage);
  if (name == "irka") return irka(stage);
  if (name == "modal") return modal(stage);
  if (name == "craig_bampton") return craig_bampton(stage);
  if (name == "krylov") return krylov(stage);
  if (name == "medium") {
    const int N = stage.medium.system.order();
    return nested("medium", identity(N), N);
  }
  return gramian("gramian", stage, stage.bands);
}

} // namespace flexgram
