#include "reduce/mode_search.hpp"

#include "base/text.hpp"

#include <algorithm>
#include <cmath>

namespace flexgram {
namespace {

constexpr double acceptable_angle = 1e-3; // where rounding lets it come no closer
constexpr int most_columns = 48, most_rounds = 60;

/// Rotates the space to the Ritz vectors of (K, M), rigid modes first; returns the
/// eigenvalues of the others, ascending.
std::vector<double> rayleigh_ritz(MediumSpace& space) {
  const int rigid = space.rigid(), count = space.columns() - rigid;
  const Dense K = part_of(space.K(), rigid, count, rigid, count);
  const Dense M = part_of(space.M(), rigid, count, rigid, count);
  Dense E = K;
  for (std::size_t i = 0; i < E.data.size(); ++i) E.data[i] += space.tau() * M.data[i];
  // M u = μ (K + τM) u: the small λ = 1/μ − τ get all the digits.
  const SymmetricEigen eigen = symmetric_eigen(M, E);
  Dense vectors(count, count);
  std::vector<double> lambda;
  for (int j = 0; j < count; ++j) {
    const double mu = eigen.values[static_cast<std::size_t>(count - 1 - j)];
    lambda.push_back(mu > 0 ? 1 / mu - space.tau() : HUGE_VAL);
    std::copy_n(eigen.vectors.column(count - 1 - j), count, vectors.column(j));
  }
  vectors = orthonormal_columns(std::move(vectors));
  share_from_first(space.V().comm(), lambda);
  share_from_first(space.V().comm(), vectors.data);
  Dense Q = identity(space.columns());
  set_part(Q, rigid, rigid, vectors);
  space.rotate(Q);
  return lambda;
}

/// Norms of the columns in K + τM.
std::vector<double> energy_norms(const MediumSpace& space, const Block& x) {
  const InnerProduct energy{space.fom().M, space.fom().K, 1 / space.tau()};
  const Block Ex = energy.apply(x);
  std::vector<double> squares(static_cast<std::size_t>(x.columns()));
  {
    const Block::Access a(x), b(Ex);
    for (PetscInt j = 0; j < x.columns(); ++j)
      for (PetscInt i = 0; i < x.local_rows().size(); ++i)
        squares[static_cast<std::size_t>(j)] += a.column(j)[i] * b.column(j)[i];
  }
  MPI_Allreduce(MPI_IN_PLACE, squares.data(), static_cast<int>(squares.size()),
                MPI_DOUBLE, MPI_SUM, x.comm());
  for (double& s : squares) s = std::sqrt(std::max(s, 0.0) * space.tau());
  return squares;
}

/// What is known about a Ritz value whose vector was good enough when it was last
/// checked.
struct Checked {
  double lambda, angle;
};

/// Angles of the Ritz values that were found good; infinite for new ones, and for the
/// neighbours of new ones, whose vectors may have turned into each other.
std::vector<double> known_angles(const std::vector<double>& lambda,
                                 const std::vector<Checked>& good, double tau) {
  std::vector<double> angle(lambda.size(), HUGE_VAL);
  std::vector<bool> taken(good.size(), false);
  for (std::size_t j = 0; j < lambda.size(); ++j)
    for (std::size_t g = 0; g < good.size(); ++g)
      if (!taken[g] &&
          std::abs(lambda[j] - good[g].lambda) <= 1e-9 * (good[g].lambda + tau)) {
        taken[g] = true;
        angle[j] = good[g].angle;
        break;
      }
  const std::vector<double> known = angle;
  for (std::size_t j = 0; j < lambda.size(); ++j)
    for (std::size_t i = 0; i < lambda.size(); ++i)
      if (known[i] == HUGE_VAL &&
          std::abs(lambda[i] - lambda[j]) <= 1e-5 * (lambda[j] + tau))
        angle[j] = HUGE_VAL;
  return angle;
}

} // namespace

FoundModes find_modes(MediumSpace& space, ShiftedSolver& factor, double sigma,
                      int expected, const std::function<double(double)>& allowed,
                      Monitor& monitor) {
  FoundModes found;
  std::vector<Checked> good;
  for (int round = 0;; ++round) {
    const std::vector<double> lambda = rayleigh_ritz(space);
    const int below = static_cast<int>(
        std::lower_bound(lambda.begin(), lambda.end(), sigma) - lambda.begin());
    if (below > expected)
      throw Error(
          text("%d modes were found below the cutoff, the inertia of K - s M counts %d: "
               "the factorisation is not to be trusted (try -mor_mumps_cntl_1 0.1)",
               below, expected));

    found.lambda.assign(lambda.begin(), lambda.begin() + below);
    found.angle = known_angles(found.lambda, good, space.tau());
    std::vector<int> block;
    for (int j = 0; j < below; ++j)
      if (found.angle[static_cast<std::size_t>(j)] == HUGE_VAL) block.push_back(j);
    const int missing = expected - below;
    if (block.empty() && missing == 0) return found;
    if (round == most_rounds)
      throw Error(text("only %d of the %d modes below the cutoff were found in %d rounds",
                       below, expected, most_rounds));
    if (static_cast<int>(block.size()) > most_columns) block.resize(most_columns);
    const int checked = static_cast<int>(block.size());
    for (int j = below; j < static_cast<int>(lambda.size()) && j < below + missing &&
                        static_cast<int>(block.size()) < most_columns;
         ++j)
      block.push_back(j);

    // D = Φ − S Φ (Λ − σ)
    for (int& j : block) j += space.rigid();
    Block phi = select_columns(space.V(), block);
    Block images = multiply(space.fom().M, phi);
    const int guards = missing > 0 ? 2 + missing / 4 : 0;
    if (guards > 0) {
      Block random = random_block(space.V(), guards, static_cast<unsigned>(round));
      images = concatenate(images, multiply(space.fom().M, random));
    }
    Block step = factor.solve(images).x;
    found.solves += static_cast<int>(step.columns());
    const std::vector<double> sizes = energy_norms(space, phi);
    {
      const Block::Access f(phi);
      Block::Access d(step);
      for (std::size_t c = 0; c < block.size(); ++c) {
        const double factor_of =
            lambda[static_cast<std::size_t>(block[c] - space.rigid())] - sigma;
        const auto j = static_cast<PetscInt>(c);
        for (PetscInt i = 0; i < phi.local_rows().size(); ++i)
          d.column(j)[i] = f.column(j)[i] - factor_of * d.column(j)[i];
      }
    }
    const std::vector<double> norms = energy_norms(space, step);
    std::vector<int> keep;
    double worst = 0;
    good.clear();
    for (std::size_t j = 0; j < found.angle.size(); ++j)
      if (found.angle[j] != HUGE_VAL) good.push_back({found.lambda[j], found.angle[j]});
    const bool stalls = round > 8 && missing == 0;
    for (int c = 0; c < static_cast<int>(step.columns()); ++c) {
      const auto i = static_cast<std::size_t>(c);
      if (c < checked) {
        const double angle = norms[i] / sizes[i];
        worst = std::max(worst, angle);
        const double l = lambda[static_cast<std::size_t>(block[i] - space.rigid())];
        if (angle <= allowed(l) || (stalls && angle <= acceptable_angle)) {
          good.push_back({l, angle});
          continue;
        }
      }
      keep.push_back(c);
    }
    monitor.detail(text("  modes: %d of %d below the cutoff, largest angle %.1e", below,
                        expected, worst));
    if (keep.empty()) {
      if (missing == 0) continue; // every mode is good now
      throw Error("the search for modes has run dry");
    }
    if (space.append(select_columns(step, keep), 1e-7) == 0 && missing == 0)
      for (int c : keep) { // rounding: what is left lies in the space already
        const auto i = static_cast<std::size_t>(c);
        if (norms[i] / sizes[i] > acceptable_angle)
          throw Error(
              text("a mode near %g rad/s converges to an angle of %.1e only",
                   std::sqrt(std::max(
                       lambda[static_cast<std::size_t>(block[i] - space.rigid())], 0.0)),
                   norms[i] / sizes[i]));
        good.push_back({lambda[static_cast<std::size_t>(block[i] - space.rigid())],
                        norms[i] / sizes[i]});
      }
  }
}

} // namespace flexgram
