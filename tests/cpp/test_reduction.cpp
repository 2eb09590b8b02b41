#include "base/observer.hpp"
#include "examples.hpp"
#include "model/project.hpp"
#include "sampling/pod.hpp"

#include <algorithm>
#include <numbers>

using namespace flexgram;
using namespace flexgram::examples;

namespace {

constexpr PetscInt n = 80;
constexpr double hz = 1 / (2 * std::numbers::pi);
const Damping light{0.05, 1e-4, 0};

/// Band from 0.5 to 12 rad/s: four modes of the rod (1.57, 4.7, 7.9, 11).
SamplingSpec options() {
  SamplingSpec o;
  o.band = {0.5, 12};
  o.samples = 24;
  return o;
}

ReducedModel pod(const SecondOrderModel& fom, const SamplingSpec& gramian, int groups = 1,
                 double tolerance = 0) {
  Observer silent(world(), Observer::Level::silent);
  FrequencySolves solves(fom.share(), groups, {}, gramian.samples, 1.0, silent);
  SamplingSpec all = gramian;
  if (tolerance > 0) all.order.tolerance = tolerance;
  return reduce_pod(fom, solves, all, 0, silent);
}

std::vector<ComplexDense> full_transfer(const SecondOrderModel& fom,
                                        const std::vector<double>& omega) {
  Observer silent(world(), Observer::Level::silent);
  FrequencySolves solves(fom.share(), 0, {}, 1, 0.0, silent);
  return solves.transfer(omega, "test");
}

double worst_error(const SecondOrderModel& fom, const SecondOrderModel& rom) {
  std::vector<double> omega;
  for (int l = 0; l < 60; ++l) omega.push_back(0.5 + 11.5 * l / 59.0);
  const auto H = full_transfer(fom, omega);
  double worst = 0;
  for (std::size_t l = 0; l < omega.size(); ++l)
    worst = std::max(worst, relative_error(H[l], dense_transfer(rom, omega[l])));
  return worst;
}

double distance_from_identity(Dense g) {
  for (int i = 0; i < g.rows; ++i) g(i, i) -= 1;
  return frobenius_norm(g);
}

} // namespace

TEST(Reduction, QuadratureIsExactWhereItShouldBe) {
  const auto integral = [](const Quadrature& q, int power) {
    double sum = 0;
    for (std::size_t l = 0; l < q.omega.size(); ++l)
      sum += q.weight[l] * std::pow(q.omega[l], power);
    return sum;
  };
  const auto exact = [](double a, double b, int power) {
    return (std::pow(b, power + 1) - std::pow(a, power + 1)) / (power + 1);
  };
  for (int power = 0; power <= 9; ++power) {
    EXPECT_NEAR(integral(band_quadrature(1, 3, 5, QuadratureRule::gauss), power) /
                    exact(1, 3, power),
                1, 1e-14);
    if (power <= 5) {
      const Quadrature q = band_quadrature(1, 3, 6, QuadratureRule::clenshaw_curtis);
      EXPECT_NEAR(integral(q, power) / exact(1, 3, power), 1, 1e-14);
    }
  }
  EXPECT_NEAR(integral(band_quadrature(1, 3, 7, QuadratureRule::midpoint), 1), 4, 1e-14);
  EXPECT_NEAR(integral(band_quadrature(1, 3, 30, QuadratureRule::gauss, true), 2),
              exact(1, 3, 2), 1e-12);
  EXPECT_EQ(band_quadrature(2, 2, 9, QuadratureRule::gauss).omega,
            std::vector<double>{2});
  EXPECT_THROW(band_quadrature(0, 2, 9, QuadratureRule::gauss, true), Error);
}

TEST(Reduction, OrderRuleStopsAtTheFirstSmallEigenvalue) {
  EXPECT_EQ(order_by_rule({1, 1e-3, 2e-8, 1e-8, 1e-9}), 3);
  EXPECT_EQ(order_by_rule({1}), 1);
}

TEST(Reduction, GramianOfASingleOscillatorIsTheIntegral) {
  // One dof: X = 1/(k − ω² m + iωd), P = (1/π) ∫ |X|² dω, and σ in the mass inner product
  // m P.
  SecondOrderModel fom;
  fom.comm = world();
  fom.n = 1;
  fom.rows = even_rows(world(), 1);
  const auto scalar = [](double value) {
    return sparse(
        1, [value](PetscInt, PetscInt) { return value; }, 0);
  };
  fom.K = scalar(4);
  fom.M = scalar(2);
  fom.damping.alpha = 0.6; // d = 1.2
  fom.B = block(1, 1, [](PetscInt, PetscInt) { return 1.0; });
  fom.C = fom.B.share();
  fom.inputs = fom.outputs = {"f"};
  double exact = 0; // Simpson with many points
  const int steps = 20000;
  for (int i = 0; i <= steps; ++i) {
    const double w = 0.5 + 2.5 * i / steps;
    const double f = 1 / std::norm(std::complex<double>(4 - 2 * w * w, 1.2 * w));
    exact += (i == 0 || i == steps ? 1 : i % 2 ? 4 : 2) * f * 2.5 / steps / 3;
  }
  SamplingSpec o;
  o.band = {0.5, 3};
  o.samples = 90; // the pole at Im ω = 0.3 gives Gauss about 1.28^(−2·90) = 1e-19
  o.rule = QuadratureRule::gauss;
  o.order.order = 1;
  o.equal_ports = false;
  EXPECT_NEAR(pod(fom, o).sigma[0], 2 * exact / std::numbers::pi, 1e-12);
  o.metric = Metric::euclidean;
  EXPECT_NEAR(pod(fom, o).sigma[0], exact / std::numbers::pi, 1e-12);
}

TEST(Reduction, BasisIsOrthonormalInEveryInnerProduct) {
  const SecondOrderModel fom = rod(n, light);
  for (const bool snapshots : {false, true})
    for (const Metric metric : {Metric::mass, Metric::euclidean, Metric::energy}) {
      SamplingSpec o = options();
      o.snapshots = snapshots;
      o.metric = metric;
      const ReducedModel rom = pod(fom, o);
      Dense gram = inner(rom.V, rom.V);
      if (metric != Metric::euclidean) {
        gram = to_dense(rom.system.M);
        if (metric == Metric::energy)
          for (std::size_t i = 0; i < gram.data.size(); ++i)
            gram.data[i] += to_dense(rom.system.K).data[i] / (12.0 * 12.0);
      }
      // Sirovich's method knows its last direction to 1e-16/1.5e-8 of the first only.
      EXPECT_LT(distance_from_identity(gram),
                !snapshots || metric != Metric::euclidean ? 1e-12 : 1e-6)
          << snapshots << " " << static_cast<int>(metric);
      EXPECT_GT(relative_smallest_eigenvalue(rom.system.M), 0);
      EXPECT_GT(relative_smallest_eigenvalue(rom.system.K), 0);
    }
}

TEST(Reduction, ErrorFallsWithTheOrderAndReciprocityHolds) {
  const SecondOrderModel fom = rod(n, light);
  double last = 1e300;
  for (const int order : {4, 6, 9, 13}) {
    SamplingSpec o = options();
    o.order.order = order;
    const ReducedModel rom = pod(fom, o);
    EXPECT_EQ(rom.system.n, order);
    const double error = worst_error(fom, rom.system);
    EXPECT_LT(error, 0.3 * last);
    last = error;
    const ComplexDense h = dense_transfer(rom.system, 5.0);
    EXPECT_LT(std::abs(h(0, 1) - h(1, 0)), 1e-14 * std::abs(h(0, 1)));
  }
  EXPECT_LT(last, 1e-6);
}

TEST(Reduction, ASampledFrequencyIsInterpolated) {
  // All directions of one sample, so that H_r(ω_l) = H(ω_l).
  const SecondOrderModel fom = rod(n, light);
  SamplingSpec o = options();
  o.band = {5, 5};
  o.order.order = 4;
  const ReducedModel rom = pod(fom, o);
  ASSERT_EQ(rom.claim.curve.error.size(), 1U);
  EXPECT_LT(rom.claim.curve.error[0],
            1e-11); // condition of A(5), about 1e4, times rounding
}

TEST(Reduction, EstimatedErrorIsTheErrorAtThoseFrequencies) {
  const SecondOrderModel fom = rod(n, light);
  const ReducedModel rom = pod(fom, options());
  const auto H = full_transfer(fom, rom.claim.curve.omega);
  EXPECT_EQ(rom.claim.curve.omega.size(),
            24U + 8U + 2U); // samples, between them, ends of the band
  for (std::size_t l = 0; l < H.size(); ++l)
    EXPECT_NEAR(
        rom.claim.curve.error[l],
        relative_error(H[l], dense_transfer(rom.system, rom.claim.curve.omega[l])),
        1e-12);
}

TEST(Reduction, ToleranceFindsTheSmallestOrder) {
  const SecondOrderModel fom = rod(n, light);
  const ReducedModel rom = pod(fom, options(), 1, 1e-5);
  EXPECT_LE(*std::max_element(rom.claim.curve.error.begin(), rom.claim.curve.error.end()),
            1e-5);
  SamplingSpec smaller = options();
  smaller.order.order = static_cast<int>(rom.system.n) - 1;
  const ReducedModel less = pod(fom, smaller);
  EXPECT_GT(
      *std::max_element(less.claim.curve.error.begin(), less.claim.curve.error.end()),
      1e-5);
}

TEST(Reduction, GroupsDoNotChangeTheResult) {
  const SecondOrderModel fom = rod(n, light);
  const ReducedModel one = pod(fom, options(), 1);
  const ReducedModel many = pod(fom, options(), comm_size(world()));
  ASSERT_EQ(one.system.n, many.system.n);
  for (std::size_t j = 0; j < std::min(one.sigma.size(), many.sigma.size()); ++j)
    if (one.sigma[j] > 1e-8 * one.sigma[0]) {
      EXPECT_NEAR(many.sigma[j] / one.sigma[j], 1, 1e-8);
    }
  for (const double omega : {0.7, 3.0, 9.0})
    EXPECT_LT(relative_error(dense_transfer(one.system, omega),
                             dense_transfer(many.system, omega)),
              1e-8);
}

TEST(Reduction, ScaledPortsForgetTheirUnits) {
  // The second port in other units: B's column times 1000. With equal weights nothing
  // changes.
  const SecondOrderModel fom = rod(n, light);
  SecondOrderModel other = fom.share();
  other.B = select_columns(fom.B, {0, 1});
  {
    Block::Access b(other.B);
    for (PetscInt i = 0; i < other.rows.size(); ++i) b.column(1)[i] *= 1000;
  }
  other.C = other.B.share();
  SamplingSpec o = options();
  o.equal_ports = true;
  const ReducedModel one = pod(fom, o), two = pod(other, o);
  ASSERT_EQ(one.system.n, two.system.n);
  EXPECT_NEAR(one.sigma[3] / two.sigma[3], 1, 1e-10);
  o.equal_ports = false;
  EXPECT_GT(std::abs(pod(other, o).sigma[3] / pod(fom, o).sigma[3] - 1), 1);
}

TEST(Reduction, UndampedBodiesAreSampledInRealArithmetic) {
  const SecondOrderModel fom = rod(n);
  SamplingSpec o = options();
  o.order.order = 12;
  const ReducedModel rom = pod(fom, o);
  EXPECT_TRUE(rom.system.terms.empty());
  EXPECT_LT(worst_error(fom, rom.system), 1e-3);
}

TEST(Reduction, ASingularMassMatrixIsNoObstacle) {
  SecondOrderModel fom = rod(n, {0, 1e-3, 0}); // mass on every other node only
  fom.M = sparse(
      n, [](PetscInt i, PetscInt) { return i % 2 ? 2.0 / n : 0.0; }, 0);
  const ReducedModel rom = pod(fom, options());
  EXPECT_LT(worst_error(fom, rom.system), 1e-2);
}

TEST(Reduction, StructuralDampingAndDashpotsKeepTheirForm) {
  SecondOrderModel fom = rod(n, {0, 0, 0.02});
  dampers(fom) = sparse(
      n, [](PetscInt i, PetscInt j) { return i == n - 1 && j == n - 1 ? 0.1 : 0.0; }, 0);
  const ReducedModel rom = pod(fom, options());
  EXPECT_EQ(rom.system.damping.eta, 0.02);
  EXPECT_TRUE(rom.system.term({}));
  EXPECT_LT(worst_error(fom, rom.system), 1e-3);
}

TEST(Reduction, ZeroFrequencyIsASampleLikeAnyOther) {
  // A damped body is real at ω = 0; its imaginary half must be zero, not what memory
  // holds.
  const SecondOrderModel fom = rod(n, light);
  SamplingSpec o = options();
  o.band = {0, 0};
  o.order.order = 2; // two ports: two directions
  EXPECT_LT(pod(fom, o).claim.curve.error[0], 1e-10);
  o.order.order = 3;
  EXPECT_THROW(pod(fom, o), Error);
  o.band = {0, 12};
  o.rule = QuadratureRule::clenshaw_curtis;
  o.order.order = 12;
  EXPECT_LT(worst_error(fom, pod(fom, o).system), 1e-3);
}

TEST(Reduction, AnOrderBeyondTheSamplesIsRefused) {
  const SecondOrderModel fom = rod(n, light);
  SamplingSpec o = options();
  o.samples = 2;
  o.order.order = 40;
  EXPECT_THROW(pod(fom, o), Error);
}
