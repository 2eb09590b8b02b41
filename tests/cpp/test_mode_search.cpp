#include "base/index.hpp"
#include "base/observer.hpp"
#include "examples.hpp"
#include "linalg/orthonormal.hpp"
#include "medium/mode_search.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

using namespace flexgram;
using namespace flexgram::examples;

namespace {

constexpr PetscInt n = 120;

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
  EXPECT_LT(loss_of_orthogonality(V, mass, 1000), 1e-13);
  EXPECT_LT(next.outside[3], 1e-12);
  EXPECT_GT(next.outside[0], 1e-3);
}

TEST(ModeSearch, FindsAllModesBelowTheCutoffAlsoThoseThatNoPortMoves) {
  const SecondOrderModel fom = twin_chains(40);
  const double sigma = 0.3; // λ_k = 2 − 2 cos(kπ/41): seven below, each twice
  RealFactors factor(fom, {}, silent());
  factor.hold(-sigma);
  EXPECT_EQ(factor.negative(), 14);
  MediumSpace space(fom, 0, 0.01);
  space.append(factor.solve(fom.B), 1e-8); // excites one chain only
  find_modes(space, factor, sigma, 14, 1e-6, 1e-13, silent());
  const RitzPairs pairs = ritz_pairs(space);
  for (int k = 0; k < 14; ++k)
    EXPECT_NEAR(pairs.lambda[as_size(k)],
                2 - 2 * std::cos((k / 2 + 1) * std::numbers::pi / 41), 1e-9);
  EXPECT_GT(pairs.lambda[14], sigma);
}

TEST(ModeSearch, RefusesWhatContradictsTheInertia) {
  const SecondOrderModel fom = rod(n, {0.05, 1e-4, 0});
  RealFactors factor(fom, {}, silent());
  factor.hold(-100.0); // 1.57², 4.71², 7.86²: three
  MediumSpace space(fom, 0, 10);
  space.append(factor.solve(fom.B), 1e-8);
  EXPECT_THROW(find_modes(space, factor, 100, 2, 0.1, 1e-9, silent()), Error);
}
