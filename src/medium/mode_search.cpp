#include "medium/mode_search.hpp"

#include "base/index.hpp"
#include "base/text.hpp"
#include "linalg/decompositions.hpp"
#include "linalg/sparse_product.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

namespace flexgram {
namespace {

constexpr const char* semidefinite = "it must be positive semidefinite (a buckled state, "
                                     "or K and M swapped?) unless D has a skew part, "
                                     "gyroscopic forces, that may hold the body";

/// Of M u = μ (K + τM) u.
/// @throws Error where K is so indefinite that K + τM is.
SymmetricEigen modes_of_basis(const Dense& M, const Dense& E, double tau) {
  try {
    return symmetric_eigen(M, E);
  } catch (const IndefiniteError&) {
    throw Error(
        text("K has an eigenvalue below %.3g rad²/s² (of the pencil K, M), or its "
             "stiffnesses are too far apart for doubles: %s",
             -tau, semidefinite));
  }
}

constexpr int most_columns = wide_block, most_rounds = 60;

/// Which Ritz values are those of `good`, one to one: their vectors were good enough when
/// they were last checked.
std::vector<bool> which_are(const std::vector<double>& lambda, int count,
                            const std::vector<double>& good, double tau) {
  const auto n = as_size(count);
  std::vector<bool> result(n, false), taken(good.size(), false);
  for (std::size_t j = 0; j < n; ++j)
    for (std::size_t g = 0; g < good.size(); ++g)
      if (!taken[g] &&
          std::abs(lambda[j] - good[g]) <= 1e-3 * (std::abs(good[g]) + tau)) {
        taken[g] = result[j] = true;
        break;
      }
  return result;
}

} // namespace

RitzPairs ritz_pairs(const MediumSpace& space) {
  const int rigid = space.rigid(), N = space.columns(), count = N - rigid;
  const Dense M_all = space.M();
  const Dense M = part_of(M_all, rigid, count, rigid, count);
  Dense E = part_of(space.K(), rigid, count, rigid, count);
  add_to(E, M, space.tau());
  // M u = μ (K + τM) u: the small λ = 1/μ − τ get all the digits.
  const SymmetricEigen eigen = modes_of_basis(M, E, space.tau());
  RitzPairs pairs;
  pairs.vectors = Dense(N, count);
  for (int j = 0; j < count; ++j) {
    const double mu = eigen.values[as_size(count - 1 - j)];
    const double* u = eigen.vectors.column(count - 1 - j);
    pairs.lambda.push_back(mu > 0 ? 1 / mu - space.tau() : HUGE_VAL);
    double square = 0; // V is W-orthonormal
    for (int i = 0; i < count; ++i) square += u[i] * u[i];
    for (int i = 0; i < count; ++i)
      pairs.vectors(rigid + i, j) = u[i] / std::sqrt(square);
  }
  share_from_first(space.fom().comm, pairs.lambda);
  share_from_first(space.fom().comm, pairs.vectors.data);
  return pairs;
}

int find_modes(MediumSpace& space, RealFactors& factors, double sigma, int expected,
               double enough, double null, Observer& observer,
               std::optional<std::vector<double>> known) {
  // λ = 1/μ − τ is known to the rounding of τ.
  null = std::max(null, 64 * std::numeric_limits<double>::epsilon() * space.tau());
  std::vector<double> good = known.value_or(std::vector<double>());
  int solves = 0, before = -1;
  int newest = space.columns() > space.rigid() // vectors of the last block
                   ? static_cast<int>(space.V().pieces().back().columns())
                   : 0;
  bool krylov = !known;
  Progress progress(observer, "modes", expected);
  for (int round = 0;; ++round) {
    const RitzPairs pairs = ritz_pairs(space);
    const int below = static_cast<int>(
        std::lower_bound(pairs.lambda.begin(), pairs.lambda.end(), sigma) -
        pairs.lambda.begin());
    if (below > expected)
      throw MiscountError(
          text("%d modes were found below the cutoff, the inertia of K - s M counts "
               "%d: the factorisation is not to be trusted (try {mumps_cntl_1} 0.1)",
               below, expected));
    if (!pairs.lambda.empty() && !space.fom().may_be_unstable() &&
        pairs.lambda.front() < -null) { // a Rayleigh quotient: proof
      const auto negative =
          std::lower_bound(pairs.lambda.begin(), pairs.lambda.end(), -null) -
          pairs.lambda.begin();
      throw Error(text("K has %ld negative eigenvalue%s at least (%.3g rad²/s² of the "
                       "pencil K, M): %s",
                       static_cast<long>(negative), negative == 1 ? "" : "s",
                       pairs.lambda.front(), semidefinite));
    }
    const int missing = expected - below;
    const std::vector<bool> is_good = which_are(pairs.lambda, below, good, space.tau());
    std::vector<int> block;
    good.clear();
    for (int j = 0; j < below; ++j)
      if (is_good[as_size(j)])
        good.push_back(pairs.lambda[as_size(j)]);
      else
        block.push_back(j);
    if (block.empty() && missing == 0) return solves;
    if (round == most_rounds)
      throw MiscountError(
          text("only %d of the %d modes below the cutoff were found in %d rounds", below,
               expected, most_rounds));
    const bool stalled = below <= before;
    before = below;

    // S is applied to the last block of V as it is, a Krylov step, which serves all modes
    // at once: as long as each block before was, so that residuals are of the last alone.
    // `parts` are the shares of the modes in question in the loads.
    krylov = krylov && newest > 0 && newest <= most_columns;
    Dense parts;
    Block loads;
    if (krylov) {
      loads = space.mass_of_newest();
      parts = Dense(newest, static_cast<int>(block.size()));
      for (int j = 0; j < parts.columns; ++j)
        for (int i = 0; i < newest; ++i)
          parts(i, j) = pairs.vectors(space.columns() - newest + i, block[as_size(j)]);
    } else {
      if (static_cast<int>(block.size()) > most_columns) block.resize(most_columns);
      const auto checked = static_cast<int>(block.size());
      std::vector<int> chosen_modes = block;
      for (int j = below;
           j < static_cast<int>(pairs.lambda.size()) && j < below + missing &&
           static_cast<int>(chosen_modes.size()) < most_columns;
           ++j)
        chosen_modes.push_back(j);
      Dense chosen(pairs.vectors.rows, 0);
      for (int j : chosen_modes)
        chosen = beside(chosen, part_of(pairs.vectors, 0, pairs.vectors.rows, j, 1));
      loads = multiply(space.fom().M, combine(space.V(), chosen));
      parts = Dense(chosen.columns, checked);
      for (int j = 0; j < checked; ++j) parts(j, j) = 1;
    }
    if (missing > 0 && (stalled || !krylov))
      loads = concatenate(
          loads, multiply(space.fom().M, random_block(space.fom().B, 1 + missing / 8,
                                                      static_cast<unsigned>(round))));
    // A poor solution costs a round, not the proof; what is nearly in the space already
    // is only worth its products where angles must become tiny.
    const int columns = space.columns();
    const std::vector<double> outside = space.append(
        factors.solve(loads, ShiftedSolver::Verify::none), enough < 0.1 ? 1e-7 : 1e-5);
    newest = space.columns() - columns;
    solves += static_cast<int>(loads.columns());
    double worst = 0;
    for (int j = 0; j < parts.columns; ++j) {
      const double lambda = pairs.lambda[as_size(block[as_size(j)])];
      double angle = 0;
      for (int i = 0; i < parts.rows; ++i)
        angle += std::abs(lambda - sigma) * std::abs(parts(i, j)) * outside[as_size(i)];
      worst = std::max(worst, angle);
      if (angle <= enough) good.push_back(lambda);
    }
    progress.reach(static_cast<int>(good.size()),
                   text("below the cutoff, %d seen before%s", below,
                        parts.columns > 0
                            ? text(", largest angle of those checked %.1e", worst).c_str()
                            : ""));
  }
}

} // namespace flexgram
