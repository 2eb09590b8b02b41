#include "base/index.hpp"
#include "base/observer.hpp"
#include "examples.hpp"
#include "linalg/orthonormal.hpp"
#include "medium/lanczos.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <utility>

using namespace flexgram;
using namespace flexgram::examples;

namespace {

/// λ_k of a chain of equal masses and springs between two walls.
double of_chain(int k, PetscInt masses) {
  return 2 - 2 * std::cos(k * std::numbers::pi / static_cast<double>(masses + 1));
}

LanczosSpec below(const SecondOrderModel& fom, double cutoff, int expected,
                  double kappa = 0) {
  return {.product = {fom.M, fom.K, kappa},
          .shift = cutoff,
          .cutoff = cutoff,
          .expected = expected,
          .enough = 1e-6,
          .most = 4 * static_cast<int>(fom.n)};
}

/// (K − cutoff M)⁻¹ of the load and of some random ones.
Block start_of(const SecondOrderModel& fom, RealFactors& factors, double cutoff,
               int company) {
  factors.hold(-cutoff);
  return factors.solve(concatenate(fom.B, random_block(fom.B, company, 5)));
}

} // namespace

TEST(Lanczos, FindsEveryModeBelowTheCutoffOnceAndNoOther) {
  constexpr PetscInt half = 150;
  const SecondOrderModel fom = twin_chains(half);
  const double cutoff = 0.3;
  RealFactors factors(fom, {}, silent());
  for (const auto& [kappa, from] :
       {std::pair{0.0, 1.0}, {0.0, 0.35}, {2.0, 1.0}, {2.0, 0.35}}) {
    Block start = start_of(fom, factors, cutoff, 3);
    const int expected = factors.negative();
    LanczosSpec spec = below(fom, cutoff, expected, kappa);
    spec.shift = from * cutoff;
    spec.ports = 1;
    spec.samples = {0.0, 0.2};
    factors.hold(-spec.shift);
    LanczosModes found =
        lanczos_modes(spec, factors, Block(), std::move(start), silent());
    EXPECT_TRUE(found.complete);
    ASSERT_EQ(found.modes.columns(), expected);
    std::sort(found.lambda.begin(), found.lambda.end());
    for (int k = 0; k < expected; ++k)
      EXPECT_NEAR(found.lambda[as_size(k)], of_chain(k / 2 + 1, half), 1e-9);
    EXPECT_LT(loss_of_orthogonality(found.modes, spec.product), 1e-12);
  }
}

TEST(Lanczos, DirectionsBesideTheModesHoldTheResponsesInTheBand) {
  constexpr PetscInt half = 150;
  const SecondOrderModel fom = twin_chains(half);
  const double cutoff = 0.3;
  RealFactors factors(fom, {}, silent());
  Block start = start_of(fom, factors, cutoff, 3);
  LanczosSpec spec = below(fom, cutoff, factors.negative());
  spec.ports = 1;
  for (int k = 0; k < 12; ++k) spec.samples.push_back(0.25 * k / 11);
  spec.negligible = 1e-6;
  const LanczosModes found =
      lanczos_modes(spec, factors, Block(), std::move(start), silent());
  EXPECT_LT(found.beside.columns(), 12);
  const Block V =
      orthonormalise(concatenate(found.modes, found.beside), Block(), spec.product, 1e-10)
          .vectors;
  factors.hold(-0.137); // no sample
  const Block exact = factors.solve(fom.B);
  EXPECT_LT(orthonormalise(copy(exact), V, spec.product, 0).outside[0],
            1e-5 * std::sqrt(inner(exact, exact)(0, 0)));
}

TEST(Lanczos, KnownModesAreNotFoundAgain) {
  constexpr PetscInt half = 60;
  const SecondOrderModel fom = twin_chains(half);
  const double cutoff = 0.3;
  RealFactors factors(fom, {}, silent());
  Block start = start_of(fom, factors, cutoff, 3);
  const LanczosSpec all = below(fom, cutoff, factors.negative());
  const LanczosModes first = lanczos_modes(all, factors, Block(), copy(start), silent());
  LanczosSpec rest = all;
  rest.expected = all.expected - 4;
  const Block known = select_columns(first.modes, {0, 1, 2, 3});
  const LanczosModes others =
      lanczos_modes(rest, factors, known, std::move(start), silent());
  EXPECT_TRUE(others.complete);
  EXPECT_EQ(others.modes.columns(), rest.expected);
  EXPECT_LT(loss_of_orthogonality(concatenate(known, others.modes), rest.product), 1e-10);
}

TEST(Lanczos, AFullSpaceSaysThatModesAreMissing) {
  const SecondOrderModel fom = twin_chains(150);
  const double cutoff = 0.3;
  RealFactors factors(fom, {}, silent());
  Block start = start_of(fom, factors, cutoff, 3);
  LanczosSpec spec = below(fom, cutoff, factors.negative());
  spec.most = 40;
  const LanczosModes found =
      lanczos_modes(spec, factors, Block(), std::move(start), silent());
  EXPECT_FALSE(found.complete);
  EXPECT_LE(found.columns, 40);
  EXPECT_LT(found.modes.columns(), spec.expected);
}
