#include "reduce/gramian_basis.hpp"

#include "base/text.hpp"
#include "linalg/sparse_product.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

namespace flexgram {

void GramianOptions::describe(Options& options) {
  options.section("Reduction (reduce, plan)");
  options.add("-mor_band_hz", band_hz, "Hz",
              "frequency band, first,last; or one frequency; or several bands, "
              "first,last,first,last");
  options.add(
      "-mor_order", order, "",
      "order m of the reduced body; 0: smallest m with sigma_(m+1)/sigma_1 < sqrt(eps) "
      "= 1.5e-8, the paper's rule");
  options.add(
      "-mor_tol", tolerance, "",
      "smallest order whose relative error over the band is below this: the certified "
      "error, or with -mor_method pod the one at the samples and the check frequencies");
  options.add_choice(
      "-mor_tol_of", tolerance_of, {"each_kind", "whole"},
      "what -mor_tol bounds: the error of H as a whole (eq. 17), which adds m/N and "
      "rad/(N "
      "m) so that the larger number hides the other, or also those of displacements from "
      "forces and of rotations from moments by themselves (ports named x.fx ... x.mz)");
  options.add_choice("-mor_port_scaling", port_scaling, {"none", "equal"},
                     "weight of the ports in the Gramian: all the same, so that forces "
                     "and moments (in N m or "
                     "N mm) count alike, or as their units have it (the paper)");
  options.add_choice(
      "-mor_inner_product", inner_product, {"mass", "euclidean", "energy"},
      "in which the modes are orthonormal: mass (independent of units; M + "
      "K/omega_max^2 where M is singular), euclidean (the paper), energy (M + "
      "K/omega_max^2)");
}

void GramianOptions::describe_samples(Options& options) {
  options.add("-mor_samples", samples, "",
              "frequencies at which the response is sampled");
  options.add_choice("-mor_quadrature", quadrature,
                     {"midpoint", "gauss", "clenshaw_curtis"},
                     "rule for the integral of the Gramian over the band");
  options.add_choice("-mor_spacing", spacing, {"linear", "log"},
                     "nodes of the rule in the frequency or in its logarithm");
  options.add_choice(
      "-mor_svd", svd, {"tsqr", "snapshots"},
      "tsqr: singular values of the samples by a QR factorisation, to working "
      "accuracy. snapshots: Sirovich's method, eigenvalues of Z'Z; faster, but "
      "squares the condition: directions with sigma_j/sigma_1 below about 1e-16 "
      "(singular values below 1e-8) are lost, so high orders gain nothing");
}

std::vector<std::pair<double, double>> GramianOptions::bands() const {
  std::string words;
  for (double f : band_hz) words += text("%s%g", words.empty() ? "" : ",", f);
  require_option(band_hz.size() == 1 || (band_hz.size() > 1 && band_hz.size() % 2 == 0),
                 "-mor_band_hz", words,
                 "first,last, or one frequency, or several bands in pairs");
  require_option(band_hz.front() >= 0, "-mor_band_hz", words, "zero or more");
  for (std::size_t i = 1; i < band_hz.size(); ++i)
    require_option(band_hz[i - 1] <= band_hz[i], "-mor_band_hz", words,
                   "first,last with first <= last");
  const double to_rad = 2 * std::numbers::pi;
  if (band_hz.size() == 1) return {{band_hz[0] * to_rad, band_hz[0] * to_rad}};
  std::vector<std::pair<double, double>> bands;
  for (std::size_t i = 0; i < band_hz.size(); i += 2)
    bands.emplace_back(band_hz[i] * to_rad, band_hz[i + 1] * to_rad);
  return bands;
}

std::pair<double, double> GramianOptions::band() const {
  const auto all = bands();
  require_option(all.size() == 1, "-mor_band_hz", text("with %zu bands", all.size()),
                 "one band with -mor_method pod");
  return all.front();
}

void GramianOptions::check() const {
  bands();
  require_option(samples >= 1, "-mor_samples", std::to_string(samples), "1 or more");
  if (tolerance)
    require_option(*tolerance > 0 && *tolerance < 1, "-mor_tol", text("%g", *tolerance),
                   "above 0 and below 1");
  require_option(!tolerance || order == 0, "-mor_tol", "with -mor_order",
                 "given without the other: the tolerance chooses the order");
  require_option(order >= 0, "-mor_order", std::to_string(order),
                 "0 (by the rule) or more");
}

Quadrature GramianOptions::nodes() const {
  const auto [first, last] = band();
  return band_quadrature(first, last, samples, quadrature, spacing);
}

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
    h[l] = output_of(model.C, x, model.B.columns());
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
    const std::span<const double> sample(
        from.column(each * (offered > 0 ? round : 0)),
        static_cast<std::size_t>(offered * model.rows.size()));
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
  std::vector<double> squares(static_cast<std::size_t>(ports), 0.0);
  std::vector<int> part(static_cast<std::size_t>(ports));
  for (PetscInt first = 0; first < Z.columns();
       first += ports) { // little memory at a time
    for (std::size_t p = 0; p < part.size(); ++p)
      part[p] = static_cast<int>(first) + static_cast<int>(p);
    const Block x = select_columns(Z, part);
    const Block Mx = multiply(M, x);
    const Block::Access a(x), b(Mx);
    for (PetscInt p = 0; p < ports; ++p)
      for (PetscInt i = 0; i < Z.local_rows().size(); ++i)
        squares[static_cast<std::size_t>(p)] += a.column(p)[i] * b.column(p)[i];
  }
  MPI_Allreduce(MPI_IN_PLACE, squares.data(), static_cast<int>(ports), MPI_DOUBLE,
                MPI_SUM, Z.comm());
  std::vector<double> inverse;
  for (PetscInt j = 0; j < Z.columns(); ++j) {
    const double square = squares[static_cast<std::size_t>(j % ports)];
    inverse.push_back(square > 0 ? 1 / std::sqrt(square) : 1.0);
  }
  scale_columns(Z, inverse);
}

int order_by_rule(const std::vector<double>& sigma) {
  const double threshold = std::sqrt(std::numeric_limits<double>::epsilon());
  int order = 1;
  while (order < static_cast<int>(sigma.size()) &&
         sigma[static_cast<std::size_t>(order)] >= threshold * sigma.front())
    ++order;
  return order;
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
    for (int i = 0; i < g.rows; ++i)
      g(i, j) *= scale[static_cast<std::size_t>(i)] * scale[static_cast<std::size_t>(j)];
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

int choose_order(const GramianOptions& options, bool all,
                 const std::vector<double>& sigma, int available) {
  if (all) return available;
  if (options.order == 0) return std::min(order_by_rule(sigma), available);
  if (options.order > available)
    throw Error(text("-mor_order %d: the %d samples span only %d directions to working "
                     "accuracy; use more -mor_samples or a smaller order",
                     options.order, options.samples, available));
  return options.order;
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
                ": take -mor_inner_product energy");
  Dense x = identity(g.rows);
  solve_right_transposed(g, x);
  return combine(V, x);
}

GramianBasis by_method_of_snapshots(const Block& Z, Mat M, Mat K, double omega_max,
                                    const GramianOptions& options, bool all,
                                    Weight weight) {
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
  basis.order = choose_order(options, all, basis.sigma, available);
  Dense q(columns, basis.order);
  for (int j = 0; j < basis.order; ++j)
    for (int i = 0; i < columns; ++i)
      q(i, j) = eigen.vectors(i, columns - 1 - j) /
                std::sqrt(basis.sigma[static_cast<std::size_t>(j)]);
  basis.V = combine(Z, q);
  if (!weight.euclidean)
    basis.V = reorthonormalise(std::move(basis.V), M, K, omega_max, weight);
  for (double& s : basis.sigma) s = std::max(s, 0.0);
  basis.inner_product = weight.name;
  return basis;
}

} // namespace

GramianBasis gramian_basis(Block Z, Mat M, Mat K, double omega_max,
                           const GramianOptions& options, bool all, Monitor& monitor) {
  Stage stage(monitor, "svd");
  const auto maxima = column_maxima(Z);
  if (*std::max_element(maxima.begin(), maxima.end()) == 0)
    throw Error("all samples are zero: the ports do not load the body");
  Weight weight{options.inner_product == "euclidean", options.inner_product == "energy",
                "M"};
  if (weight.euclidean) weight.name = "I";
  if (weight.energy) weight.name = "M + K/ω_max²";
  if (omega_max == 0 && !weight.euclidean) weight = {true, false, "I (the band is 0 Hz)"};
  if (options.svd == "snapshots")
    return by_method_of_snapshots(Z, M, K, omega_max, options, all, weight);

  GramianBasis basis;
  BlockSvd svd = left_svd(std::move(Z), 1e-15);
  const int available = static_cast<int>(svd.left.columns());
  if (weight.euclidean) {
    basis.sigma = squares(svd.values);
    basis.order = choose_order(options, all, basis.sigma, available);
    std::vector<int> first(static_cast<std::size_t>(basis.order));
    for (int j = 0; j < basis.order; ++j) first[static_cast<std::size_t>(j)] = j;
    basis.V = select_columns(svd.left, first);
  } else {
    // Z = U S Wᵀ; with UᵀWU = L Lᵀ the singular values in W are those of Lᵀ S.
    Dense l = gram_matrix(svd.left, M, K, omega_max, weight);
    if (cholesky(l) != 0)
      throw Error("the inner product " + weight.name + " is not positive on the samples");
    Dense weighted = transpose(l);
    for (int j = 0; j < available; ++j)
      for (int i = 0; i < available; ++i)
        weighted(i, j) *= svd.values[static_cast<std::size_t>(j)];
    LeftSvd inner_svd = left_svd(weighted);
    share_from_first(svd.left.comm(), inner_svd.values);
    share_from_first(svd.left.comm(), inner_svd.vectors.data);
    basis.sigma = squares(inner_svd.values);
    basis.order = choose_order(options, all, basis.sigma, available);
    // V = U L⁻ᵀ (left vectors): solve_right_transposed gives X L⁻ᵀ for X = I.
    Dense l_inverse_transposed = identity(available);
    solve_right_transposed(l, l_inverse_transposed);
    basis.V = combine(svd.left, multiply(l_inverse_transposed,
                                         first_columns(inner_svd.vectors, basis.order)));
    basis.V = reorthonormalise(std::move(basis.V), M, K, omega_max, weight);
  }
  basis.inner_product = weight.name;
  return basis;
}

} // namespace flexgram
