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

/// All modes of twin chains below a cutoff, from there.
struct Search {
  explicit Search(PetscInt half, double kappa = 0) : fom(twin_chains(half)) {
    factors.hold(-cutoff);
    start = factors.solve(concatenate(fom.B, random_block(fom.B, 3, 5)));
    spec = {.product = {fom.M, fom.K, kappa},
            .shift = cutoff,
            .cutoff = cutoff,
            .expected = factors.negative(),
            .enough = 1e-6,
            .ports = 1,
            .most = 4 * static_cast<int>(fom.n)};
  }
  LanczosModes run(const Block& deflated = Block()) {
    factors.hold(-spec.shift);
    return lanczos_modes(spec, factors, deflated, copy(start), silent());
  }

  double cutoff = 0.3;
  SecondOrderModel fom;
  RealFactors factors{fom, {}, silent()};
  Block start; ///< (K − cutoff M)⁻¹ of the load and of random ones
  LanczosSpec spec;
};

} // namespace

TEST(Lanczos, FindsEveryModeBelowTheCutoffOnceAndNoOther) {
  constexpr PetscInt half = 150;
  for (const auto& [kappa, from] :
       {std::pair{0.0, 1.0}, {0.0, 0.35}, {2.0, 1.0}, {2.0, 0.35}}) {
    Search search(half, kappa);
    search.spec.shift = from * search.cutoff;
    search.spec.samples = {0.0, 0.2};
    LanczosModes found = search.run();
    EXPECT_TRUE(found.complete);
    ASSERT_EQ(found.modes.columns(), search.spec.expected);
    std::sort(found.lambda.begin(), found.lambda.end());
    for (int k = 0; k < search.spec.expected; ++k)
      EXPECT_NEAR(found.lambda[as_size(k)], of_chain(k / 2 + 1, half), 1e-9);
    EXPECT_LT(loss_of_orthogonality(found.modes, search.spec.product, 1000), 1e-12);
  }
}

TEST(Lanczos, DirectionsBesideTheModesHoldTheResponsesInTheBand) {
  Search search(150);
  for (int k = 0; k < 12; ++k) search.spec.samples.push_back(0.25 * k / 11);
  search.spec.negligible = 1e-6;
  const LanczosModes found = search.run();
  EXPECT_LT(found.beside.columns(), 12);
  const InnerProduct& mass = search.spec.product;
  const Block V =
      orthonormalise(concatenate(found.modes, found.beside), Block(), mass, 1e-10)
          .vectors;
  search.factors.hold(-0.137); // no sample
  const Block exact = search.factors.solve(search.fom.B);
  EXPECT_LT(orthonormalise(copy(exact), V, mass, 0).outside[0],
            1e-5 * std::sqrt(inner(exact, exact)(0, 0)));
}

TEST(Lanczos, KnownModesAreNotFoundAgain) {
  Search search(60);
  const LanczosModes first = search.run();
  const Block known = select_columns(first.modes, {0, 1, 2, 3});
  search.spec.expected -= 4;
  const LanczosModes others = search.run(known);
  EXPECT_TRUE(others.complete);
  EXPECT_EQ(others.modes.columns(), search.spec.expected);
  EXPECT_LT(
      loss_of_orthogonality(concatenate(known, others.modes), search.spec.product, 1000),
      1e-10);
}

TEST(Lanczos, AnExhaustedSpaceEndsWithAllModes) {
  Search search(20); // 40 dofs, of which blocks of four leave nothing after ten steps
  search.spec.enough = 0;
  const LanczosModes found = search.run();
  EXPECT_LE(found.columns, 40);
  EXPECT_EQ(found.modes.columns(), search.spec.expected);
  EXPECT_LT(loss_of_orthogonality(found.modes, search.spec.product, 1000), 1e-12);
}

TEST(Lanczos, AFullSpaceSaysThatModesAreMissing) {
  Search search(150);
  search.spec.most = 40;
  const LanczosModes found = search.run();
  EXPECT_FALSE(found.complete);
  EXPECT_LE(found.columns, 40);
  EXPECT_LT(found.modes.columns(), search.spec.expected);
}
