#include "model/rigid_body_modes.hpp"

#include "base/index.hpp"
#include "base/text.hpp"
#include "linalg/decompositions.hpp"
#include "linalg/orthonormal.hpp"
#include "linalg/sparse.hpp"
#include "linalg/sparse_product.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

namespace flexgram {

double eigenvalue_scale(const SecondOrderModel& model) {
  double trace = 0;
  for (double m : diagonal(model.M)) trace += m;
  trace = sum_over(model.comm, trace);
  PetscReal norm = 0;
  FG_CALL(MatNorm(model.K, NORM_INFINITY, &norm));
  if (!(trace > 0)) throw Error("M is zero: the body has no mass");
  return norm * static_cast<double>(model.n) / trace;
}

double rigid_threshold(const SecondOrderModel& model) {
  return std::max(1e3 * std::numeric_limits<double>::epsilon(), 8 * model.rounding) *
         eigenvalue_scale(model);
}

namespace {

/// What the rows of K show of its rounding when it moves a vector rigidly.
struct RowRounding {
  double relative = 0; ///< median of |Kφ|_i / √Σ_j(K_ij φ_j)²; 0: nothing is shown
  /// |φᵀKφ| is no more than a random sum of its terms, and these are not mostly of one sign.
  bool of_random_sign = true;
};

/// The median is of bins of a quarter of a decade: it must not depend on the ranks.
std::vector<RowRounding> rounding_of_rows(const Block& x, const AccurateProduct& image) {
  constexpr int bins = 81, fewest_rows = 100;
  constexpr double coarsest = 1e-4, random = 8, one_sign = 0.5;
  const Block::Access vector(x), force(image.product), size(image.row_spread);
  std::vector<RowRounding> result;
  for (PetscInt j = 0; j < x.columns(); ++j) {
    // Rows by bin; φᵀKφ; squares of its terms; their sizes.
    std::vector<double> sums(bins + 3, 0.0);
    for (PetscInt i = 0; i < x.local_rows().size(); ++i) {
      const double f = force.column(j)[i], s = size.column(j)[i],
                   work = vector.column(j)[i] * f;
      sums[bins] += work;
      sums[bins + 1] += work * work;
      sums[bins + 2] += std::abs(work);
      if (!(s > 0)) continue;
      const double decades = std::log10(std::max(std::abs(f) / s, 1e-20)) + 20;
      ++sums[std::min<std::size_t>(bins - 1, static_cast<std::size_t>(4 * decades))];
    }
    MPI_Allreduce(MPI_IN_PLACE, sums.data(), bins + 3, MPI_DOUBLE, MPI_SUM, x.comm());
    double rows = 0, passed = 0;
    for (std::size_t bin = 0; bin < bins; ++bin) rows += sums[bin];
    std::size_t median = 0;
    while (median + 1 < bins && (passed += sums[median]) < 0.5 * rows) ++median;
    const double relative =
        median == 0 ? 0.0 : std::pow(10.0, (static_cast<double>(median) + 0.5) / 4 - 20);
    RowRounding rounding;
    rounding.of_random_sign =
        std::abs(sums[bins]) <= random * std::sqrt(sums[bins + 1]) &&
        std::abs(sums[bins]) <= one_sign * sums[bins + 2];
    if (rows >= fewest_rows && relative < coarsest) rounding.relative = relative;
    result.push_back(rounding);
  }
  return result;
}

} // namespace

RigidSplit split_rigid(const SecondOrderModel& model, const Block& vectors,
                       bool computed) {
  constexpr double epsilon = std::numeric_limits<double>::epsilon();
  const int count = static_cast<int>(vectors.columns());
  RigidSplit split;
  split.rotation = identity(count);
  if (count == 0) return split;
  const auto stiffness = [](const Block& x, const Block& image) {
    Dense k = inner(x, image);
    symmetrise(k);
    return k;
  };
  Block chosen = copy(vectors);
  SymmetricEigen eigen =
      symmetric_eigen(stiffness(chosen, multiply_accurately(model.K, chosen).product));
  share_from_first(model.comm, eigen.values);
  share_from_first(model.comm, eigen.vectors.data);
  chosen = combine(chosen, eigen.vectors);
  const AccurateProduct image =
      multiply_accurately(model.K, chosen, {.row_spread = true});
  const std::vector<RowRounding> of_rows = rounding_of_rows(chosen, image);
  const Dense turned = stiffness(chosen, image.product);
  const auto k = diagonal(model.K);
  std::vector<double> sizes(as_size(count), 0.0); // φᵀdiag(K)φ
  {
    const Block::Access x(chosen);
    for (int j = 0; j < count; ++j)
      for (std::size_t i = 0; i < k.size(); ++i)
        sizes[as_size(j)] += std::abs(k[i]) * x.column(j)[i] * x.column(j)[i];
  }
  MPI_Allreduce(MPI_IN_PLACE, sizes.data(), count, MPI_DOUBLE, MPI_SUM, model.comm);
  // Of a body that may be unstable, negative energies are no rounding.
  const double relative = 16 * std::max(epsilon, 0.25 * model.rounding),
               negative = model.may_be_unstable() ? 0.0 : std::max(0.0, -turned(0, 0));
  // What roundings in all entries of a vector cost, where K holds none of the mass that it moves.
  const double of_entries =
      computed ? std::pow(4 * epsilon, 2) * eigenvalue_scale(model) : 0.0;
  std::vector<int> order, rest;
  for (int j = 0; j < count; ++j) {
    const auto at = as_size(j);
    const double lambda = turned(j, j);
    // Eigenvectors take rounding in; those of slow elastic motions leave as little in each row.
    const double shown = computed || !of_rows[at].of_random_sign
                             ? 0.0
                             : 24 * of_rows[at].relative,
                 noise = std::max({std::max(relative, shown) * image.spread[at],
                                   4 * epsilon * sizes[at], 3 * negative,
                                   computed ? 16 * epsilon * sizes[at] : 0.0}),
                 most = std::max({256 * epsilon, 4 * model.rounding, shown}) * sizes[at];
    const double rounding = std::max(std::min(noise, most), of_entries);
    const bool is_rigid =
        lambda <= rounding && (!model.may_be_unstable() || lambda >= -rounding);
    (is_rigid ? order : rest).push_back(j);
  }
  split.count = static_cast<int>(order.size());
  split.stiffness = Dense(split.count, split.count);
  for (int j = 0; j < split.count; ++j)
    for (int i = 0; i < split.count; ++i)
      split.stiffness(i, j) = turned(order[as_size(i)], order[as_size(j)]);
  order.insert(order.end(), rest.begin(), rest.end());
  for (int j = 0; j < count; ++j)
    set_part(split.rotation, 0, j,
             part_of(eigen.vectors, 0, count, order[as_size(j)], 1));
  return split;
}

namespace {

Block rigid_part(const SecondOrderModel& model, const Block& vectors, bool computed,
                 RigidSplit* found) {
  RigidSplit split = split_rigid(model, vectors, computed);
  Block rigid = combine(vectors, first_columns(split.rotation, split.count));
  if (found) *found = std::move(split);
  return rigid;
}

/// The mean position of the rows, and the mean distance from it.
double mean_radius(const SecondOrderModel& model, std::array<double, 3>& centre) {
  const auto rows = as_size(model.rows.size());
  std::array<double, 4> sums{}; // Σx, Σy, Σz, number of rows
  for (std::size_t i = 0; i < rows; ++i)
    for (std::size_t c = 0; c < 3; ++c) sums[c] += model.position[3 * i + c];
  sums[3] = static_cast<double>(rows);
  MPI_Allreduce(MPI_IN_PLACE, sums.data(), 4, MPI_DOUBLE, MPI_SUM, model.comm);
  centre = {sums[0] / sums[3], sums[1] / sums[3], sums[2] / sums[3]};
  double radius = 0;
  for (std::size_t i = 0; i < rows; ++i)
    for (std::size_t c = 0; c < 3; ++c)
      radius += std::pow(model.position[3 * i + c] - centre[c], 2);
  radius = std::sqrt(sum_over(model.comm, radius) / sums[3]);
  return radius == 0 ? 1 : radius;
}

} // namespace

Block rigid_motions(const SecondOrderModel& model, const std::array<double, 3>& centre,
                    double radius) {
  const auto rows = as_size(model.rows.size());
  Block motions(model.comm, model.rows, model.n, 6);
  Block::Access access(motions);
  for (std::size_t i = 0; i < rows; ++i) {
    const auto component = static_cast<PetscInt>(model.component[i]);
    const auto row = static_cast<std::ptrdiff_t>(i);
    for (PetscInt j = 0; j < 6; ++j) access.column(j)[row] = 0;
    access.column(component)[row] = component < 3 ? 1 : 1 / radius;
    if (component >= 3) continue;
    for (PetscInt axis = 0; axis < 3; ++axis) { // (e_axis × r) of this component
      if (axis == component) continue;
      const PetscInt other = 3 - axis - component;
      const double sign = (axis + 1) % 3 == component ? -1 : 1;
      const auto o = as_size(other);
      access.column(3 + axis)[row] =
          sign * (model.position[3 * i + o] - centre[o]) / radius;
    }
  }
  return motions;
}

bool has_coordinates(const SecondOrderModel& model) {
  const auto missing = static_cast<std::int64_t>(
      (model.position.empty() || model.component.empty()) && model.rows.size() > 0);
  return sum_over(model.comm, missing) == 0;
}

Block null_space_modes(const SecondOrderModel& model, SolverOptions options) {
  ShiftedSolver solver(model.K, model.M, {}, model.node, counting(std::move(options)));
  solver.count_pivots(true);
  solver.factorise({1.0, -rigid_threshold(model)});
  const int count = solver.negative_pivots();
  Block x(model.comm, model.rows, model.n, 0);
  if (count == 0) return x;
  const InnerProduct mass{model.M, model.K, 0};
  const Block none;
  x = orthonormalise(random_block(x, count, 1), none, mass, 1e-12).vectors;
  double last = HUGE_VAL;
  for (int step = 0; step < 30; ++step) { // each divides the rest by λ_1/s₀
    const Block Mx = multiply(model.M, x);
    const Orthonormalised next = orthonormalise(solver.solve(Mx).x, none, mass, 1e-12);
    // What the new vectors have outside the old ones.
    const Dense overlap = inner(Mx, next.vectors);
    double outside = 0;
    for (int j = 0; j < overlap.columns; ++j) {
      double inside = 0;
      for (int i = 0; i < overlap.rows; ++i) inside += overlap(i, j) * overlap(i, j);
      outside = std::max(outside, 1 - inside);
    }
    x = next.vectors.share();
    if (step > 2 && !(outside < 0.5 * last))
      break; // the square of the change is rounding
    last = outside;
  }
  if (x.columns() < count)
    throw Error(text("only %ld of the %d vectors of K's null space were found",
                     static_cast<long>(x.columns()), count));
  return rigid_part(model, x, true, nullptr);
}

double misfit_of_positions(const SecondOrderModel& model) {
  std::array<double, 3> centre{};
  const double radius = mean_radius(model, centre);
  const Block motions = rigid_motions(model, centre, radius);
  const Dense energy = inner(motions, multiply(model.K, motions));
  const auto stiffness = diagonal(model.K);
  const Block::Access access(motions);
  double worst = 0;
  for (int j = 0; j < 6; ++j) {
    double weight = 0;
    for (std::size_t i = 0; i < stiffness.size(); ++i)
      weight += std::abs(stiffness[i]) * std::pow(access.column(j)[i], 2);
    weight = sum_over(model.comm, weight);
    if (weight > 0) worst = std::max(worst, std::abs(energy(j, j)) / weight);
  }
  return worst;
}

Block rigid_body_modes(const SecondOrderModel& model, RigidSplit* split) {
  if (!has_coordinates(model)) return Block(model.comm, model.rows, model.n, 0);
  const InnerProduct mass{model.M, model.K, 0};
  const Block none;
  std::array<double, 3> centre{};
  const double radius = mean_radius(model, centre);
  const Block motions =
      orthonormalise(rigid_motions(model, centre, radius), none, mass, 1e-6).vectors;
  return rigid_part(model, motions, false, split);
}

} // namespace flexgram
