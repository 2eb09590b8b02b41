#include "base/observer.hpp"
#include "basis/band_gramian.hpp"
#include "basis/cut.hpp"
#include "basis/method.hpp"
#include "examples.hpp"
#include "linalg/orthonormal.hpp"
#include "medium/mode_search.hpp"
#include "model/project.hpp"
#include "sampling/pod.hpp"

#include <algorithm>
#include <numbers>

using namespace flexgram;
using namespace flexgram::examples;

namespace {

constexpr PetscInt n = 120;
constexpr double hz = 1 / (2 * std::numbers::pi);
const Damping light{0.05, 1e-4, 0};

Observer& silent() {
  static Observer observer(world(), Observer::Level::silent);
  return observer;
}

/// The band of the tests, 0.5 to 12.3 rad/s: four modes of the rod.
struct Job {
  CertifySpec spec{.bands = {{0.5, 12.3}}};
  CutRequest request;
};

Job to_tolerance(double tolerance) {
  Job job;
  job.request.order.tolerance = tolerance;
  return job;
}

Medium certified(const SecondOrderModel& fom, Job job) {
  const Demand asked =
      demand_of(job.request.methods, job.request.order.order, job.request.shifts);
  job.spec.modes = asked.modes;
  job.spec.last_needed = asked.last_needed;
  if (job.spec.target == CertifySpec().target)
    job.spec.target = medium_target(job.request.order);
  job.spec.by_kind = job.request.order.by_kind();
  return certify(fom, false, job.spec, {}, silent());
}

ReducedModel reduce(const SecondOrderModel& fom, const Job& job) {
  return cut(certified(fom, job), job.request, silent());
}

/// Full solves at frequencies that no method knows, against the bound stored nearest
/// above.
void expect_certified(const SecondOrderModel& fom, const ReducedModel& rom, double first,
                      double last) {
  FrequencySolves solves(fom.share(), 0, {}, 1, 0.0, silent());
  const auto H = solves.transfer(rom.omega, "test");
  for (std::size_t l = 0; l < H.size(); ++l) {
    if (rom.omega[l] < first || rom.omega[l] > last) continue;
    const double truth = relative_error(H[l], dense_transfer(rom.model, rom.omega[l]));
    EXPECT_LE(truth, rom.bound[l]) << "at " << rom.omega[l];
    if (truth > rom.floor[l]) {
      EXPECT_LE(rom.bound[l], 30 * truth) << "at " << rom.omega[l];
    }
  }
}

/// A chain of n equal masses and springs between two walls, doubled: every eigenvalue
/// twice.
SecondOrderModel twin_chains(PetscInt half) {
  SecondOrderModel fom;
  fom.comm = world();
  fom.n = 2 * half;
  fom.rows = even_rows(world(), fom.n);
  fom.K = sparse(
      fom.n,
      [half](PetscInt i, PetscInt j) {
        if (i == j) return 2.0;
        return std::min(i, j) == half - 1 ? 0.0 : -1.0;
      },
      1);
  fom.M = sparse(
      fom.n, [](PetscInt i, PetscInt j) { return i == j ? 1.0 : 0.0; }, 0);
  fom.damping = {1e-3, 0, 0};
  fom.B = block(fom.n, 1, [](PetscInt i, PetscInt) { return i == 1 ? 1.0 : 0.0; });
  fom.C = fom.B.share();
  fom.inputs = fom.outputs = {"f"};
  return fom;
}

DenseSystem dense_rod(PetscInt order, Damping damping) {
  const SecondOrderModel fom = rod(order, damping);
  DenseSystem system;
  system.M = whole(fom.M);
  system.K = whole(fom.K);
  system.B = whole(fom.B);
  system.C = system.B;
  system.damping = damping;
  return system;
}

} // namespace

TEST(Orthonormal, NewVectorsAreOrthonormalAndDependentOnesAreDropped) {
  const SecondOrderModel fom = rod(n);
  const InnerProduct mass{fom.M, fom.K, 0};
  const Block none;
  const Orthonormalised first =
      orthonormalise(random_block(fom.B, 5, 1), none, mass, 1e-8);
  ASSERT_EQ(first.vectors.columns(), 5);
  // Three new columns, two that V holds, one twice.
  Block x = concatenate(
      random_block(fom.B, 3, 2),
      concatenate(select_columns(first.vectors, {0, 3}), random_block(fom.B, 1, 2)));
  const Orthonormalised next = orthonormalise(std::move(x), first.vectors, mass, 1e-8);
  EXPECT_EQ(next.vectors.columns(), 3);
  const Block V = concatenate(first.vectors, next.vectors);
  EXPECT_LT(loss_of_orthogonality(V, mass), 1e-13);
  EXPECT_LT(next.outside[3], 1e-12);
  EXPECT_GT(next.outside[0], 1e-3);
}

TEST(ModeSearch, FindsAllModesBelowTheCutoffAlsoThoseThatNoPortMoves) {
  const SecondOrderModel fom = twin_chains(40);
  const double sigma = 0.3; // λ_k = 2 − 2 cos(kπ/41): seven below, each twice
  ShiftedSolver factor(fom.K, fom.M, nullptr, {}, {});
  factor.count_pivots(true);
  factor.factorise({1.0, -sigma, 0.0});
  EXPECT_EQ(factor.negative_pivots(), 14);
  MediumSpace space(fom, 0, 0.01);
  space.append(factor.solve(fom.B).x, 1e-8); // excites one chain only
  find_modes(space, factor, sigma, 14, 1e-6, 1e-13, silent());
  const RitzPairs pairs = ritz_pairs(space);
  for (int k = 0; k < 14; ++k)
    EXPECT_NEAR(pairs.lambda[static_cast<std::size_t>(k)],
                2 - 2 * std::cos((k / 2 + 1) * std::numbers::pi / 41), 1e-9);
  EXPECT_GT(pairs.lambda[14], sigma);
}

TEST(ModeSearch, RefusesWhatContradictsTheInertia) {
  const SecondOrderModel fom = rod(n, light);
  ShiftedSolver factor(fom.K, fom.M, nullptr, {}, {});
  factor.count_pivots(true);
  factor.factorise({1.0, -100.0, 0.0}); // 1.57², 4.71², 7.86²: three
  MediumSpace space(fom, 0, 10);
  space.append(factor.solve(fom.B).x, 1e-8);
  EXPECT_THROW(find_modes(space, factor, 100, 2, 0.1, 1e-9, silent()), Error);
}

TEST(BandGramian, EqualsTheClosedFormOfAModalSystem) {
  // P_jk = b_j b_kᵀ (1/π) ∫ Re(1/(a_j ā_k)) dω in modal coordinates; each entry by its
  // poles: the antiderivative of a rational function, here by a very fine rule (Simpson,
  // 400,000 points).
  const Damping damping{0.05, 2e-3, 0};
  const DenseResponse response(dense_rod(12, damping), 1.0);
  const Dense F = gramian_factor(response, {BandWeight::flat(0.5, 6)}, false);
  const Dense P = multiply(F, transpose(F));
  const int steps = 400000;
  Dense exact(12, 12);
  const Dense& B = response.modal_inputs();
  for (int l = 0; l <= steps; ++l) {
    const double omega = 0.5 + 5.5 * l / steps;
    const double weight = (l == 0 || l == steps ? 1 : l % 2 ? 4 : 2) * 5.5 / steps / 3;
    const auto a = response.diagonal(omega);
    for (int j = 0; j < 12; ++j)
      for (int k = 0; k < 12; ++k) {
        double loads = 0;
        for (int p = 0; p < B.columns; ++p) loads += B(j, p) * B(k, p);
        exact(j, k) += weight / std::numbers::pi * loads *
                       (1.0 / (a[static_cast<std::size_t>(j)] *
                               std::conj(a[static_cast<std::size_t>(k)])))
                           .real();
      }
  }
  exact = multiply(multiply(response.U(), exact), transpose(response.U()));
  for (std::size_t i = 0; i < P.data.size(); ++i)
    EXPECT_NEAR(P.data[i], exact.data[i], 1e-10 * frobenius_norm(exact));
}

TEST(BandGramian, OverTheWholeAxisSolvesTheLyapunovEquation) {
  // First-order form x' = A x + B u, A X + X Aᵀ + B Bᵀ = 0; P is its position block (eq.
  // 5).
  const Damping damping{0.3, 1e-2, 0};
  constexpr int m = 6;
  const DenseSystem system = dense_rod(m, damping);
  const Dense F = whole_axis_factor(DenseResponse(system, 1.0), false);
  const Dense P = multiply(F, transpose(F));
  // By modes: x'' + d_j x' + λ_j x = b_j; the Lyapunov equation of two modes has a closed
  // solution.
  const DenseResponse modes(system, 1.0);
  Dense exact(m, m);
  const Dense& B = modes.modal_inputs();
  for (int j = 0; j < m; ++j)
    for (int k = 0; k < m; ++k) {
      const double l_j = modes.lambda()[static_cast<std::size_t>(j)],
                   l_k = modes.lambda()[static_cast<std::size_t>(k)],
                   d_j = damping.alpha + damping.beta * l_j,
                   d_k = damping.alpha + damping.beta * l_k,
                   mu = std::sqrt(modes.mu()[static_cast<std::size_t>(j)] *
                                  modes.mu()[static_cast<std::size_t>(k)]);
      double loads = 0;
      for (int p = 0; p < B.columns; ++p) loads += B(j, p) * B(k, p) / mu;
      // ∫_0^∞ h_j h_k dt of two impulse responses.
      const double s = d_j + d_k, g = l_j - l_k;
      exact(j, k) = loads * s / (g * g + s * (d_j * l_k + d_k * l_j)) / mu * mu;
    }
  // U is normalised in K + τM: modal coordinates in M are U/√μ.
  Dense phi = modes.U();
  for (int j = 0; j < m; ++j)
    for (int i = 0; i < m; ++i)
      phi(i, j) /= std::sqrt(modes.mu()[static_cast<std::size_t>(j)]);
  exact = multiply(multiply(phi, exact), transpose(phi));
  for (std::size_t i = 0; i < P.data.size(); ++i)
    EXPECT_NEAR(P.data[i], exact.data[i], 1e-9 * frobenius_norm(exact));
}

TEST(TwoStep, CertifiesEveryKindOfDamping) {
  for (const Damping& damping :
       {Damping{}, light, Damping{0, 0, 0.02}, Damping{1e-6, 0, 0}}) {
    const SecondOrderModel fom = rod(n, damping);
    for (const double tolerance : {1e-2, 1e-4, 1e-6}) {
      // On a peak of damping ratio 1e-7 the rounding of K alone is 2e-5 of H.
      if (damping.alpha == 1e-6 && tolerance < 1e-4) continue;
      const ReducedModel rom = reduce(fom, to_tolerance(tolerance));
      // Undamped: nothing is claimed beside the four resonances, and the intervals say
      // so.
      const bool undamped = damping.alpha + damping.beta + damping.eta == 0;
      EXPECT_EQ(rom.kind, undamped ? "certified outside" : "certified");
      EXPECT_EQ(rom.claim->excluded.size(), undamped ? 4u : 0u);
      for (std::size_t k = 0; k < rom.claim->excluded.size(); ++k) {
        const auto [from, to] = rom.claim->excluded[k];
        const double pole = std::sqrt(rod_eigenvalue(n, static_cast<PetscInt>(k + 1)));
        EXPECT_TRUE(from < pole && pole < to && to - from < 2.1e-4 * pole) << k;
      }
      EXPECT_EQ(rom.factorisations, 1);
      EXPECT_TRUE(rom.claim->met);
      EXPECT_LE(rom.claim->worst, tolerance);
      EXPECT_LE(*std::max_element(rom.bound.begin(), rom.bound.end()), rom.claim->worst);
      expect_certified(fom, rom, 0.5, 12.3);
    }
  }
}

TEST(TwoStep, CertifiesDashpotsAndGeneralDamping) {
  for (const bool local : {true, false}) {
    SecondOrderModel fom = rod(n, Damping{0.02, 0, 0});
    // One dashpot near the tip; or material damping in the right half only.
    fom.D =
        local
            ? sparse(
                  n,
                  [](PetscInt i, PetscInt j) { return i == j && i == n - 7 ? 0.3 : 0.0; },
                  0)
            : sparse(
                  n,
                  [](PetscInt i, PetscInt j) {
                    if (std::min(i, j) < n / 2) return 0.0;
                    const double ends = i == n / 2 || i == n - 1 ? 1.0 : 2.0;
                    return 4e-4 * n * (i == j ? ends : -1.0);
                  },
                  1);
    const ReducedModel rom = reduce(fom, to_tolerance(1e-5));
    EXPECT_EQ(rom.kind, "certified");
    EXPECT_EQ(rom.factorisations, 1);
    expect_certified(fom, rom, 0.5, 12.3);
  }
}

TEST(TwoStep, CertifiesOutputsThatDifferFromInputs) {
  SecondOrderModel fom = rod(n, light);
  fom.C =
      block(n, 3, [](PetscInt i, PetscInt j) { return i == 20 * (j + 1) ? 1.0 : 0.0; });
  fom.outputs_are_inputs = false;
  fom.outputs = {"a", "b", "c"};
  for (const char* stage : {"auto", "balanced", "medium"}) {
    Job job;
    if (std::string(stage) == "auto")
      job.request.order.tolerance = 1e-4;
    else
      job.request.methods = {stage};
    expect_certified(fom, reduce(fom, job), 0.5, 12.3);
  }
}

TEST(TwoStep, EveryMethodIsCertified) {
  const SecondOrderModel fom = rod(n, light);
  for (const auto& [name, how] : methods()) {
    Job job;
    job.request.methods = {name};
    const ReducedModel rom = reduce(fom, job);
    EXPECT_EQ(rom.kind, "certified") << name;
    expect_certified(fom, rom, 0.5, 12.3);
  }
}

TEST(TwoStep, ModalHoldsTheModesOfTheBandAndKrylovInterpolates) {
  const SecondOrderModel fom = rod(n, light);
  Job modes;
  modes.request.methods = {"modal"};
  const ReducedModel modal = reduce(fom, modes);
  ASSERT_EQ(modal.modes.size(), 4u);
  for (PetscInt k = 1; k <= 4; ++k)
    EXPECT_NEAR(modal.modes[static_cast<std::size_t>(k - 1)],
                std::sqrt(rod_eigenvalue(n, k)), 1e-9);
  modes.request.order.order = 20; // more than lie below the usual cutoff: it is raised
  EXPECT_NEAR(reduce(fom, modes).modes[19], std::sqrt(rod_eigenvalue(n, 20)), 1e-6);

  SecondOrderModel undamped = rod(n);
  Job moments;
  moments.request.methods = {"krylov"};
  moments.request.shifts = {2, 6};
  const ReducedModel krylov = reduce(undamped, moments);
  FrequencySolves solves(undamped.share(), 0, {}, 1, 0.0, silent());
  const std::vector<double> at{2, 6};
  const auto H = solves.transfer(at, "test");
  for (std::size_t l = 0; l < 2; ++l)
    EXPECT_LT(relative_error(H[l], dense_transfer(krylov.model, at[l])), 1e-7);
}

TEST(TwoStep, TheOrderFoundIsMinimalForItsBasis) {
  const SecondOrderModel fom = rod(n, light);
  for (const char* stage : {"gramian", "weighted"}) {
    Job job = to_tolerance(1e-4);
    job.request.methods = {stage};
    const int m = static_cast<int>(reduce(fom, job).model.n);
    job.request.order.tolerance.reset();
    job.request.order.order = m - 1;
    const auto less = reduce(fom, job);
    EXPECT_GT(less.claim->worst, 1e-4);
  }
}

TEST(TwoStep, GivesTheBestBodyWhereAToleranceCannotBeMet) {
  const SecondOrderModel fom = rod(n, light);
  Job job = to_tolerance(1e-4);
  job.request.methods = {"modal"};
  const ReducedModel modal = reduce(fom, job);
  EXPECT_EQ(modal.kind, "certified");
  EXPECT_FALSE(modal.claim->met);
  EXPECT_GT(modal.claim->worst, 1e-4);
  expect_certified(fom, modal, 0.5, 12.3);
  job = to_tolerance(1e-9);
  job.spec.limit = 9; // the modes below the cutoff alone fill it
  const ReducedModel limited = reduce(fom, job);
  EXPECT_FALSE(limited.claim->met);
  EXPECT_GE(limited.claim->worst, limited.claim->attained);
  expect_certified(fom, limited, 0.5, 12.3);
}

TEST(TwoStep, SigmaAgreesWithTheSamplesOfTheFullBody) {
  const SecondOrderModel fom =
      rod(n, {0.6, 0, 0}); // poles far enough from the axis for one Gauss rule;
  SamplingSpec samples;
  samples.band = {0.5, 12.3};
  samples.samples = 400;
  samples.rule = QuadratureRule::gauss;
  samples.order.order = 4;
  FrequencySolves solves(fom.share(), 0, {}, samples.samples, 1.0, silent());
  const auto pod = reduce_pod(fom, solves, samples, 0, silent());
  Job job;
  job.request.order.order = 4;
  job.spec.target = 1e-12;
  job.request.medium_target = 1e-12;
  const auto two = reduce(fom, job);
  for (std::size_t j = 0; j < pod.sigma.size() && pod.sigma[j] > 1e-8 * pod.sigma[0]; ++j)
    EXPECT_NEAR(two.sigma[j] / pod.sigma[j], 1, 1e-6) << j;
}

TEST(TwoStep, CutsEqualReductionsWhateverElseTheMediumModelHolds) {
  for (const bool dashpot : {false, true}) {
    SecondOrderModel fom = rod(n, light);
    if (dashpot)
      fom.D = sparse(
          n, [](PetscInt i, PetscInt j) { return i == j && i == n - 7 ? 0.03 : 0.0; }, 0);
    Job tight = to_tolerance(1e-9);
    const Medium medium = certified(fom, tight);
    EXPECT_GT(medium.levels.size(), 1u);
    for (const double tolerance : {1e-1, 1e-2, 1e-3, 1e-5, 1e-7, 1e-9}) {
      const Job job = to_tolerance(tolerance);
      const ReducedModel one = reduce(fom, job),
                         other = cut(medium, job.request, silent());
      ASSERT_EQ(one.model.n, other.model.n) << tolerance;
      EXPECT_EQ(one.medium_order, other.medium_order) << tolerance;
      EXPECT_NEAR(one.claim->worst / other.claim->worst, 1, 1e-5) << tolerance;
      for (double omega : {0.7, 3.1, 9.9})
        EXPECT_LT(relative_error(dense_transfer(one.model, omega),
                                 dense_transfer(other.model, omega)),
                  1e-10)
            << tolerance;
    }
  }
}

TEST(TwoStep, CutsSayWhatTheMediumModelLacks) {
  const SecondOrderModel fom = rod(n, light);
  const Medium medium = certified(fom, to_tolerance(1e-4));
  const auto message = [&](const CutRequest& request) -> std::string {
    try {
      cut(medium, request, silent());
    } catch (const Error& error) {
      return error.what();
    }
    return "";
  };
  CutRequest request;
  request.bands = {{0.5, 20}};
  EXPECT_NE(message(request).find("{band_hz}"), std::string::npos);
  request = {};
  request.methods = {"modal"};
  request.order.order = 30;
  EXPECT_NE(message(request).find("{cutoff}"), std::string::npos);
  request = {};
  request.methods = {"krylov"};
  request.shifts = {30};
  EXPECT_NE(message(request).find("{shifts_hz}"), std::string::npos);
  request = {};
  request.inputs = {"nowhere"};
  EXPECT_NE(message(request).find("nowhere"), std::string::npos);
  request = {};
  request.order.tolerance = 1e-11; // more than was certified: unmet, and said
  EXPECT_FALSE(cut(medium, request, silent()).claim->met);
}
