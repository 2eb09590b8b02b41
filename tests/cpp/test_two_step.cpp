#include "base/index.hpp"
#include "base/observer.hpp"
#include "basis/cut.hpp"
#include "basis/method.hpp"
#include "examples.hpp"
#include "model/project.hpp"
#include "sampling/pod.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

using namespace flexgram;
using namespace flexgram::examples;

namespace {

constexpr PetscInt n = 120;
constexpr double hz = 1 / (2 * std::numbers::pi);
const Damping light{0.05, 1e-4, 0};

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
  job.spec.kinds = job.request.order.kinds();
  return certify(fom, false, job.spec, {}, silent());
}

ReducedModel reduce(const SecondOrderModel& fom, const Job& job) {
  return cut(certified(fom, job), job.request, silent());
}

/// The referee at frequencies that no method knows, against the claim; and at those of the
/// curve, against the curve, which is to be sharp.
void expect_certified(const SecondOrderModel& fom, const ReducedModel& rom, double first,
                      double last) {
  const Referee full(fom), reduced(rom.system);
  std::vector<double> between;
  for (int l = 0; l < 29; ++l)
    between.push_back(first + (last - first) * (l + 0.37) / 29);
  const auto error = [&](double omega) {
    return relative_error(full.transfer(omega), reduced.transfer(omega));
  };
  for (double omega : between)
    EXPECT_LE(error(omega), rom.claim.supremum->whole) << "at " << omega;
  for (std::size_t l = 0; l < rom.claim.curve.omega.size(); ++l) {
    if (rom.claim.curve.omega[l] < first || rom.claim.curve.omega[l] > last) continue;
    const double truth = error(rom.claim.curve.omega[l]);
    EXPECT_LE(truth, rom.claim.curve.bound[l]) << "at " << rom.claim.curve.omega[l];
    if (truth > rom.claim.curve.floor[l]) {
      EXPECT_LE(rom.claim.curve.bound[l], 30 * truth)
          << "at " << rom.claim.curve.omega[l];
    }
  }
}

} // namespace

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
      EXPECT_EQ(rom.claim.kind, undamped ? "certified outside" : "certified");
      EXPECT_EQ(rom.claim.supremum->excluded.size(), undamped ? 4u : 0u);
      for (std::size_t k = 0; k < rom.claim.supremum->excluded.size(); ++k) {
        const auto [from, to] = rom.claim.supremum->excluded[k];
        const double pole = std::sqrt(rod_eigenvalue(n, static_cast<PetscInt>(k + 1)));
        EXPECT_TRUE(from < pole && pole < to && to - from < 2.1e-4 * pole) << k;
      }
      EXPECT_EQ(rom.provenance.factorisations, 1);
      EXPECT_TRUE(rom.claim.supremum->met);
      EXPECT_LE(rom.claim.supremum->worst, tolerance);
      EXPECT_LE(
          *std::max_element(rom.claim.curve.bound.begin(), rom.claim.curve.bound.end()),
          rom.claim.supremum->worst);
      expect_certified(fom, rom, 0.5, 12.3);
    }
  }
}

TEST(TwoStep, CertifiesDashpotsAndGeneralDamping) {
  for (const bool local : {true, false}) {
    SecondOrderModel fom = rod(n, Damping{0.02, 0, 0});
    // One dashpot near the tip; or material damping in the right half only.
    dampers(fom) =
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
    EXPECT_EQ(rom.claim.kind, "certified");
    EXPECT_EQ(rom.provenance.factorisations, 1);
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
    EXPECT_EQ(rom.claim.kind, "certified") << name;
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
    EXPECT_NEAR(modal.modes[as_size(k - 1)], std::sqrt(rod_eigenvalue(n, k)), 1e-9);
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
    EXPECT_LT(relative_error(H[l], dense_transfer(krylov.system, at[l])), 1e-7);
}

TEST(TwoStep, TheOrderFoundIsMinimalForItsBasis) {
  const SecondOrderModel fom = rod(n, light);
  for (const char* stage : {"gramian", "weighted"}) {
    Job job = to_tolerance(1e-4);
    job.request.methods = {stage};
    const int m = static_cast<int>(reduce(fom, job).system.n);
    job.request.order.tolerance.reset();
    job.request.order.order = m - 1;
    const auto less = reduce(fom, job);
    EXPECT_GT(less.claim.supremum->worst, 1e-4);
  }
}

TEST(TwoStep, GivesTheBestBodyWhereAToleranceCannotBeMet) {
  const SecondOrderModel fom = rod(n, light);
  Job job = to_tolerance(1e-4);
  job.request.methods = {"modal"};
  const ReducedModel modal = reduce(fom, job);
  EXPECT_EQ(modal.claim.kind, "certified");
  EXPECT_FALSE(modal.claim.supremum->met);
  EXPECT_GT(modal.claim.supremum->worst, 1e-4);
  expect_certified(fom, modal, 0.5, 12.3);
  job = to_tolerance(1e-9);
  job.spec.limit = 9; // the modes below the cutoff alone fill it
  const ReducedModel limited = reduce(fom, job);
  EXPECT_FALSE(limited.claim.supremum->met);
  EXPECT_GE(limited.claim.supremum->worst, limited.claim.supremum->attained);
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
      dampers(fom) = sparse(
          n, [](PetscInt i, PetscInt j) { return i == j && i == n - 7 ? 0.03 : 0.0; }, 0);
    Job tight = to_tolerance(1e-9);
    const Medium medium = certified(fom, tight);
    EXPECT_GT(medium.levels.size(), 1u);
    for (const double tolerance : {1e-1, 1e-2, 1e-3, 1e-5, 1e-7, 1e-9}) {
      const Job job = to_tolerance(tolerance);
      const ReducedModel one = reduce(fom, job),
                         other = cut(medium, job.request, silent());
      ASSERT_EQ(one.system.n, other.system.n) << tolerance;
      EXPECT_EQ(one.provenance.medium_order, other.provenance.medium_order) << tolerance;
      // The levels that end a growth are summed with more digits than those on the way.
      const double floor = std::max(
          *std::max_element(one.claim.curve.floor.begin(), one.claim.curve.floor.end()),
          *std::max_element(other.claim.curve.floor.begin(),
                            other.claim.curve.floor.end()));
      EXPECT_NEAR(one.claim.supremum->worst, other.claim.supremum->worst,
                  1e-5 * one.claim.supremum->worst + floor)
          << tolerance;
      for (double omega : {0.7, 3.1, 9.9})
        EXPECT_LT(relative_error(dense_transfer(one.system, omega),
                                 dense_transfer(other.system, omega)),
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
  EXPECT_FALSE(cut(medium, request, silent()).claim.supremum->met);
}
