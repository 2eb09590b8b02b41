#include "sampling/gramian_basis.hpp"

#include "base/index.hpp"
#include "base/text.hpp"
#include "linalg/decompositions.hpp"
#include "linalg/sparse_product.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

namespace flexgram {

Snapshots sample_band(FrequencySolves& solves, const Quadrature& nodes) {
  const SecondOrderModel& model = solves.model();
  const Groups& groups = solves.groups();
  const PetscInt each = model.B.columns() * (model.undamped() ? 1 : 2);
  const auto count_of = [&](int group) {
    const auto total = static_cast<PetscInt>(nodes.omega.size());
    return (total - group + groups.count - 1) / groups.count;
  };
  Snapshots result;
  result.omega = nodes.omega;
  std::vector<ComplexDense> h(nodes.omega.size());
  Block mine(groups.comm, model.rows, model.n, each * count_of(groups.mine));
  PetscInt next = 0;
  solves.for_each(nodes.omega, "sample", [&](std::size_t l, const Block& x) {
    h[l] = transfer_of(model, x, nodes.omega[l]);
    const double scale = std::sqrt(nodes.weight[l] / std::numbers::pi);
    const Block::Access from(x);
    Block::Access to(mine);
    const double* source = from.column(0);
    double* target = to.column(next);
    for (PetscInt i = 0; i < each * model.rows.size(); ++i) target[i] = scale * source[i];
    next += each;
  });
  result.H = solves.share_transfer(std::move(h));
  if (groups.count == 1) {
    result.Z = std::move(mine);
    return result;
  }
  // Frequency by frequency, so that only one sample of each group is held twice.
  const PetscInt total = each * static_cast<PetscInt>(nodes.omega.size());
  const PetscInt local = solves.world_rows().size();
  result.Z = Block(groups.world, solves.world_rows(), model.n, total);
  for (PetscInt round = 0; round < count_of(0); ++round) {
    const PetscInt offered = round < count_of(groups.mine) ? each : 0;
    const Block::Access from(mine);
    const std::span<const double> sample(from.column(each * (offered > 0 ? round : 0)),
                                         as_size(offered * model.rows.size()));
    const std::vector<double> rows = exchange_rows<double>(
        groups.world, model.rows, sample, offered, each * groups.mine,
        solves.world_rows(), each * groups.count);
    PetscInt present = 0;
    for (int group = 0; group < groups.count; ++group) present += round < count_of(group);
    Block::Access to(result.Z);
    std::copy_n(rows.data(), local * each * present,
                to.column(each * groups.count * round));
  }
  return result;
}

void scale_ports(Block& Z, Mat M, PetscInt ports) {
  std::vector<double> squares(as_size(ports), 0.0);
  std::vector<int> part(as_size(ports));
  for (PetscInt first = 0; first < Z.columns();
       first += ports) { // little memory at a time
    for (std::size_t p = 0; p < part.size(); ++p)
      part[p] = static_cast<int>(first) + static_cast<int>(p);
    const Block x = select_columns(Z, part);
    const Block Mx = multiply(M, x);
    const Block::Access a(x), b(Mx);
    for (PetscInt p = 0; p < ports; ++p)
      for (PetscInt i = 0; i < Z.local_rows().size(); ++i)
        squares[as_size(p)] += a.column(p)[i] * b.column(p)[i];
  }
  MPI_Allreduce(MPI_IN_PLACE, squares.data(), static_cast<int>(ports), MPI_DOUBLE,
                MPI_SUM, Z.comm());
  std::vector<double> inverse;
  for (PetscInt j = 0; j < Z.columns(); ++j) {
    const double square = squares[as_size(j % ports)];
    inverse.push_back(square > 0 ? 1 / std::sqrt(square) : 1.0);
  }
  scale_columns(Z, inverse);
}

namespace {

/// W X for W = M, or M + K/ω_max².
Block weigh(const Block& x, Mat M, Mat K, bool with_energy, double omega_max) {
  Block w = multiply(M, x);
  if (with_energy) {
    const Block k = multiply(K, x);
    const Block::Access from(k);
    Block::Access to(w);
    const double scale = 1 / (omega_max * omega_max);
    for (std::size_t i = 0; i < to.all().size(); ++i)
      to.all()[i] += scale * from.column(0)[i];
  }
  return w;
}

/// Smallest eigenvalue of G scaled to unit diagonal; G is a Gram matrix.
double relative_definiteness(Dense g) {
  std::vector<double> scale;
  for (int i = 0; i < g.rows; ++i)
    scale.push_back(g(i, i) > 0 ? 1 / std::sqrt(g(i, i)) : 0.0);
  for (int j = 0; j < g.columns; ++j)
    for (int i = 0; i < g.rows; ++i) g(i, j) *= scale[as_size(i)] * scale[as_size(j)];
  return symmetric_eigen(std::move(g)).values.front();
}

struct Weight {
  bool euclidean, energy;
  std::string name;
};

/// Gram matrix of U in the inner product; falls back from M to M + K/ω_max² where M is
/// singular on the span of U.
Dense gram_matrix(const Block& U, Mat M, Mat K, double omega_max, Weight& weight) {
  Dense g = inner(U, weigh(U, M, K, weight.energy, omega_max));
  symmetrise(g);
  if (!weight.energy && relative_definiteness(g) < 1e-13) {
    weight = {false, true, "M + K/ω_max², because M is singular on the samples"};
    return gram_matrix(U, M, K, omega_max, weight);
  }
  return g;
}

int choose_order(const SamplingSpec& spec, bool all, const std::vector<double>& sigma,
                 int available) {
  const int order = spec.order.order;
  if (all) return available;
  if (order == 0) return std::min(order_by_rule(sigma), available);
  if (order > available)
    throw Error(text("{order} %d: the %d samples span only %d directions to working "
                     "accuracy; use more {samples} or a smaller order",
                     order, spec.samples, available));
  return order;
}

std::vector<double> squares(std::vector<double> values) {
  for (double& value : values) value *= value;
  return values;
}

/// Second pass of Cholesky-QR: V is orthonormal to the accuracy of one Gram matrix, then
/// to rounding.
Block reorthonormalise(Block V, Mat M, Mat K, double omega_max, const Weight& weight) {
  Dense g = inner(V, weigh(V, M, K, weight.energy, omega_max));
  symmetrise(g);
  if (cholesky(g) != 0)
    throw Error("the basis cannot be orthonormalised in " + weight.name +
                ": take {inner_product} energy");
  return combine(V, inverse_transposed(g));
}

GramianBasis by_method_of_snapshots(const Block& Z, Mat M, Mat K, double omega_max,
                                    const SamplingSpec& spec, bool all, Weight weight) {
  Dense g =
      weight.euclidean ? inner(Z, Z) : inner(Z, weigh(Z, M, K, weight.energy, omega_max));
  symmetrise(g);
  SymmetricEigen eigen = symmetric_eigen(std::move(g));
  share_from_first(Z.comm(), eigen.values);
  share_from_first(Z.comm(), eigen.vectors.data);
  GramianBasis basis;
  basis.sigma.assign(eigen.values.rbegin(), eigen.values.rend());
  const int columns = static_cast<int>(basis.sigma.size());
  const int available = static_cast<int>(
      std::count_if(basis.sigma.begin(), basis.sigma.end(), [&](double s) {
        return s > columns * std::numeric_limits<double>::epsilon() * basis.sigma.front();
      }));
  basis.order = choose_order(spec, all, basis.sigma, available);
  Dense q(columns, basis.order);
  for (int j = 0; j < basis.order; ++j)
    for (int i = 0; i < columns; ++i)
      q(i, j) = eigen.vectors(i, columns - 1 - j) / std::sqrt(basis.sigma[as_size(j)]);
  basis.V = combine(Z, q);
  if (!weight.euclidean)
    basis.V = reorthonormalise(std::move(basis.V), M, K, omega_max, weight);
  for (double& s : basis.sigma) s = std::max(s, 0.0);
  basis.inner_product = weight.name;
  return basis;
}

} // namespace

GramianBasis gramian_basis(Block Z, Mat M, Mat K, double omega_max,
                           const SamplingSpec& spec, bool all, Observer& observer) {
  Stage stage(observer, "svd");
  const auto maxima = column_maxima(Z);
  if (*std::max_element(maxima.begin(), maxima.end()) == 0)
    throw Error("all samples are zero: the ports do not load the body");
  Weight weight{spec.metric == Metric::euclidean, spec.metric == Metric::energy, "M"};
  if (weight.euclidean) weight.name = "I";
  if (weight.energy) weight.name = "M + K/ω_max²";
  if (omega_max == 0 && !weight.euclidean) weight = {true, false, "I (the band is 0 Hz)"};
  if (spec.snapshots)
    return by_method_of_snapshots(Z, M, K, omega_max, spec, all, weight);

  GramianBasis basis;
  BlockSvd svd = left_svd(std::move(Z), 1e-15);
  const int available = static_cast<int>(svd.left.columns());
  if (weight.euclidean) {
    basis.sigma = squares(svd.values);
    basis.order = choose_order(spec, all, basis.sigma, available);
    std::vector<int> first(as_size(basis.order));
    for (int j = 0; j < basis.order; ++j) first[as_size(j)] = j;
    basis.V = select_columns(svd.left, first);
  } else {
    // Z = U S Wᵀ; with UᵀWU = L Lᵀ the singular values in W are those of Lᵀ S.
    Dense l = gram_matrix(svd.left, M, K, omega_max, weight);
    if (cholesky(l) != 0)
      throw Error("the inner product " + weight.name + " is not positive on the samples");
    Dense weighted = transpose(l);
    for (int j = 0; j < available; ++j)
      for (int i = 0; i < available; ++i) weighted(i, j) *= svd.values[as_size(j)];
    LeftSvd inner_svd = left_svd(weighted);
    share_from_first(svd.left.comm(), inner_svd.values);
    share_from_first(svd.left.comm(), inner_svd.vectors.data);
    basis.sigma = squares(inner_svd.values);
    basis.order = choose_order(spec, all, basis.sigma, available);
    basis.V =
        combine(svd.left, multiply(inverse_transposed(l), // V = U L⁻ᵀ (left vectors)
                                   first_columns(inner_svd.vectors, basis.order)));
    basis.V = reorthonormalise(std::move(basis.V), M, K, omega_max, weight);
  }
  basis.inner_product = weight.name;
  return basis;
}

} // namespace flexgram
