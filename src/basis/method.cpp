#include "basis/method.hpp"

#include "base/index.hpp"
#include "base/text.hpp"
#include "linalg/decompositions.hpp"

#include <algorithm>
#include <cmath>

namespace flexgram {

Dense unit_vectors(int N, int first) {
  Dense e(N, N - first);
  for (int j = 0; j < e.columns; ++j) e(first + j, j) = 1;
  return e;
}

Dense after_rigid(const Dense& a, int rigid, int N) {
  Dense result(N, rigid + a.columns);
  for (int j = 0; j < rigid; ++j) result(j, j) = 1;
  for (int j = 0; j < a.columns; ++j)
    std::copy_n(a.column(j), a.rows, result.column(rigid + j) + (N - a.rows));
  return result;
}

namespace {

/// L with G = LLᵀ.
Dense factor_of(Dense G) {
  if (cholesky(G) != 0)
    throw Error("the inner product is not positive on the medium space");
  return G;
}

} // namespace

WeightedSvd weighted_svd(const Dense& F, const Dense& G) {
  const Dense L = factor_of(G);
  const LeftSvd svd = left_svd(compressed(multiply_transposed(L, F)));
  WeightedSvd result;
  for (double s : svd.values) result.sigma.push_back(s * s);
  result.vectors = multiply(inverse_transposed(L), svd.vectors);
  return result;
}

Dense all_ports(const DenseSystem& system) {
  return system.outputs_are_inputs ? system.B : beside(system.B, system.C);
}

Candidate nested(Dense all, int least) {
  Candidate c;
  c.least = least;
  c.most = all.columns;
  c.nested = true;
  c.basis = [all = std::move(all)](int m) { return first_columns(all, m); };
  return c;
}

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

Elastic::Elastic(const SecondStage& stage)
    : rigid(stage.medium.rigid), N(stage.medium.system.order()), count(N - rigid),
      system(stage.medium.system.project(unit_vectors(N, rigid))),
      gram(part_of(stage.gram, rigid, count, rigid, count)),
      response(system, stage.medium.tau) {}

Dense Elastic::statics() const {
  Dense modal = multiply_transposed(response.U(), all_ports(system));
  for (int j = 0; j < modal.columns; ++j)
    for (int i = 0; i < modal.rows; ++i) { // in modal coordinates K is 1 − τμ
      const double k = 1 - response.tau() * response.mu()[as_size(i)];
      modal(i, j) /= std::abs(k) > 1e-12 ? k : 1e-12;
    }
  return multiply(response.U(), modal);
}

Candidate gramian_candidate(const SecondStage& stage,
                            const std::vector<std::vector<BandWeight>>& bands) {
  // With many ports, unless the tolerance needs small eigenvalues.
  const bool squares = stage.medium.has_many_ports() && stage.tolerance >= 1e-5;
  const auto factor = [&](const MediumModel& medium, std::size_t k) {
    const DenseResponse response(medium.system, medium.tau);
    Dense F = gramian_factor(response, bands[k], stage.equal_ports, squares);
    if (is_symmetric(medium.system.terms)) return F;
    return beside(
        F, gramian_factor(response.transposed(), bands[k], stage.equal_ports, squares));
  };
  Dense F = factor(stage.medium, 0);
  for (std::size_t k = 0; k < stage.others.size(); ++k)
    F = beside(F, factor(*stage.others[k], k + 1));
  const WeightedSvd all = weighted_svd(F, stage.gram);
  Candidate c;
  if (stage.medium.rigid > 0 && stage.keep_rigid) {
    const int N = F.rows, rigid = stage.medium.rigid, count = N - rigid;
    const Dense elastic = weighted_svd(part_of(F, rigid, count, 0, F.columns),
                                       part_of(stage.gram, rigid, count, rigid, count))
                              .vectors;
    c = nested(after_rigid(elastic, rigid, N), rigid + 1);
  } else {
    c = nested(all.vectors);
    c.rigid_first = false;
  }
  c.sigma = all.sigma;
  return c;
}

Candidate whole_axis_candidate(const SecondStage& stage) {
  const Elastic e(stage);
  const WeightedSvd svd =
      weighted_svd(whole_axis_factor(e.response, stage.equal_ports), e.gram);
  Candidate c = nested(after_rigid(svd.vectors, e.rigid, e.N), e.rigid + 1);
  c.sigma = svd.sigma;
  return c;
}

namespace {

/// The candidate's vectors after those of the static responses, orthonormal in the inner
/// product G.
Candidate after_statics(const Candidate& own, const Dense& statics, const Dense& G) {
  const Dense L = factor_of(G);
  const auto span = [L = transpose(L), inverse = inverse_transposed(L),
                     statics](const Dense& vectors) {
    return multiply(inverse, nested_span(multiply(L, beside(statics, vectors))));
  };
  const int least = span(Dense(statics.rows, 0)).columns;
  Candidate c = own;
  if (own.nested) {
    const Candidate all = nested(span(own.basis(own.most)), least);
    c.basis = all.basis;
    c.most = all.most;
  } else {
    c.basis = [span, basis = own.basis](int m) {
      return first_columns(span(basis(m)), m);
    };
  }
  c.least = std::max(least, own.least);
  c.most = std::max(c.most, c.least);
  if (own.no_fewer)
    c.no_fewer =
        std::make_shared<const Candidate>(after_statics(*own.no_fewer, statics, G));
  return c;
}

} // namespace

const Method& method(const std::string& name) {
  std::vector<std::string> names;
  for (const auto& [known, method] : methods()) {
    if (known == name) return *method;
    names.push_back(known);
  }
  throw Error(text("there is no method %s: must be one of %s", name.c_str(),
                   join(names).c_str()));
}

Candidate make_candidate(const std::string& name, const SecondStage& stage) {
  const int rigid = stage.medium.rigid;
  const Method& chosen = method(name);
  Candidate candidate = stage.medium.system.order() == rigid // nothing elastic in reach
                            ? nested(identity(rigid), rigid)
                            : chosen.make(stage);
  if (stage.statics && stage.medium.system.order() > rigid) {
    const Elastic e(stage);
    candidate =
        after_statics(candidate, after_rigid(e.statics(), e.rigid, e.N), stage.gram);
  }
  candidate.name = name;
  return candidate;
}

Demand demand_of(const std::vector<std::string>& names, int order,
                 const std::vector<double>& shifts) {
  Demand all;
  for (const auto& name : names)
    if (const auto demand = method(name).demand) {
      const Demand one = demand(order, shifts);
      all.modes = std::max(all.modes, one.modes);
      all.last_needed = std::max(all.last_needed, one.last_needed);
    }
  return all;
}

} // namespace flexgram
