#include "base/observer.hpp"
#include "examples.hpp"
#include "linalg/sparse_product.hpp"
#include "medium/certificate.hpp"
#include "medium/error_over_band.hpp"
#include "medium/model.hpp"
#include "sampling/pod.hpp"

#include <algorithm>

using namespace flexgram;
using namespace flexgram::examples;

namespace {

constexpr PetscInt n = 120;

/// D of material damping in the right half only.
Matrix half_damped() {
  return sparse(
      n,
      [](PetscInt i, PetscInt j) {
        if (std::min(i, j) < n / 2) return 0.0;
        const double ends = i == n / 2 || i == n - 1 ? 1.0 : 2.0;
        return 4e-4 * n * (i == j ? ends : -1.0);
      },
      1);
}

/// The imaginary part of the stiffness of a last quarter with a loss factor of 0.2.
Matrix lossy_end() {
  const PetscInt first = n - n / 4;
  return sparse(
      n,
      [=](PetscInt i, PetscInt j) {
        if (std::min(i, j) < first) return 0.0;
        const double ends = i == first || i == n - 1 ? 1.0 : 2.0;
        return 0.2 * n * (i == j ? ends : -1.0);
      },
      1);
}

/// Differences of neighbours as outputs, beside the rod's few inputs.
SecondOrderModel rod_with_strains(PetscInt rows, PetscInt count) {
  SecondOrderModel body = rod(rows, {0.05, 1e-4, 0});
  const PetscInt step = rows / count;
  body.C = block(rows, count, [&](PetscInt i, PetscInt j) {
    return i == step * j ? -1.0 : i == step * j + 1 ? 1.0 : 0.0;
  });
  body.outputs_are_inputs = false;
  body.outputs.clear();
  for (PetscInt j = 0; j < count; ++j) body.outputs.push_back(std::to_string(j));
  return body;
}

struct Case {
  const char* name;
  SecondOrderModel body;
  bool mass_is_singular = false;
};

/// Every form of damping; M singular, so that the inner product is M + κK; outputs of
/// their own; a body that floats (its rigid mode has no coordinates to be known by).
std::vector<Case> cases() {
  std::vector<Case> all;
  all.push_back({"mass", rod(n, {0.05, 0, 0})});
  all.push_back({"stiffness", rod(n, {0, 1e-4, 0})});
  all.push_back({"structural", rod(n, {0, 0, 0.03})});
  all.push_back({"all", rod(n, {0.05, 1e-4, 0.01})});
  SecondOrderModel dashpot = rod(n, {0.02, 0, 0});
  dampers(dashpot) = sparse(
      n, [](PetscInt i, PetscInt j) { return i == j && i == n - 7 ? 0.3 : 0.0; }, 0);
  all.push_back({"dashpot", std::move(dashpot)});
  SecondOrderModel half = rod(n, {0.02, 0, 0});
  dampers(half) = half_damped();
  SecondOrderModel both = half.share();
  both.terms.push_back({Law::Kind::structural, lossy_end()});
  all.push_back({"half", std::move(half)});
  all.push_back({"half and a loss factor", std::move(both)});
  SecondOrderModel relaxing = rod(n, {0.02, 0, 0}), tabled = rod(n, {0.02, 0, 0});
  relaxing.terms.push_back(
      {Law("end", "prony", {{"g", {8, 3}}, {"tau", {0.02, 0.5}}}), lossy_end()});
  dampers(relaxing) = half_damped();
  tabled.terms.push_back({Law("end", "table",
                              {{"omega", {0, 2, 7, 40}},
                               {"storage", {0, 2, 3, 6}},
                               {"loss", {0.1, 1, 0.7, 2}}}),
                          lossy_end()});
  all.push_back({"half and relaxation", std::move(relaxing)});
  all.push_back({"a table", std::move(tabled)});
  for (bool damped : {false, true}) {
    SecondOrderModel light = rod(n, {0.05, 1e-4, 0});
    light.M = sparse(
        n,
        [](PetscInt i, PetscInt j) {
          return i == j && i % 3 > 0 ? 1.5 / static_cast<double>(n) : 0.0;
        },
        0);
    if (damped) dampers(light) = half_damped();
    all.push_back({damped ? "massless and damped" : "massless", std::move(light), true});
  }
  SecondOrderModel outputs = rod(n, {0.05, 1e-4, 0});
  outputs.C =
      block(n, 3, [](PetscInt i, PetscInt j) { return i == 20 * (j + 1) ? 1.0 : 0.0; });
  outputs.outputs_are_inputs = false;
  outputs.outputs = {"a", "b", "c"};
  all.push_back({"outputs", std::move(outputs)});
  for (bool same : {true, false}) {
    SecondOrderModel many = rod(n, {0.05, 1e-4, 0});
    many.B =
        block(n, 36, [](PetscInt i, PetscInt j) { return i == 3 * j + 5 ? 1.0 : 0.0; });
    many.C = copy(many.B);
    many.inputs.clear();
    for (int j = 0; j < 36; ++j) many.inputs.push_back(std::to_string(j));
    many.outputs = many.inputs;
    if (!same) {
      many.C = block(n, 30,
                     [](PetscInt i, PetscInt j) { return i == 2 * j + 40 ? 2.0 : 0.0; });
      many.outputs_are_inputs = false;
      many.outputs.resize(30);
    }
    all.push_back({same ? "many ports" : "many ports and outputs", std::move(many)});
  }
  all.push_back({"outputs by the sixty", rod_with_strains(n, 60)});
  SecondOrderModel floating = rod(n, {0, 1e-4, 0});
  floating.K = sparse(
      n,
      [](PetscInt i, PetscInt j) {
        const double k = static_cast<double>(n);
        return i == j ? (i == 0 || i == n - 1 ? k : 2 * k) : -k;
      },
      1);
  all.push_back({"floating", std::move(floating)});
  return all;
}

} // namespace

TEST(Certificate, KnowsTheResidualOfEveryResponseHoweverTheSpaceGrew) {
  const SecondOrderModel fom = rod(n);
  MediumSpace space(fom, 0, 1.0);
  space.append(random_block(fom.B, 6, 1), 1e-7);
  space.track_residual(fom.B);
  for (unsigned step = 2; step < 4; ++step) {
    DenseSystem system;
    system.M = space.M();
    system.K = space.K();
    system.B = inner(space.V(), fom.B);
    system.C = system.B;
    const DenseResponse response(std::move(system), space.tau());
    // One frequency shows few of the directions that residuals can take: cut to them, a
    // basis must not forget the others.
    const int few = static_cast<int>(fom.B.columns());
    orthonormalise_residual(space);
    const ResidualBasis basis = residual_basis(space, response, {1.0}, {}, 0, 2.0, few);
    EXPECT_EQ(basis.cut.columns, few);
    EXPECT_FALSE(basis.complete);
    space.append(random_block(fom.B, 4, step), 1e-7);
  }
  const Block V = combine(space.V(), identity(space.columns()));
  Block expected = multiply(fom.K, V), found;
  add_product(expected, -1.0, multiply(fom.M, V), inner(V, expected));
  found = combine(space.residual().S, space.residual().K);
  space.unscale(found);
  const Dense a = whole(expected), b = whole(found);
  for (std::size_t i = 0; i < a.data.size(); ++i)
    EXPECT_NEAR(a.data[i], b.data[i], 1e-6 * frobenius_norm(a));
}

/// The bound against full solves at frequencies that it was not given, for each level of
/// the growth: the first has modes that are good to an angle of 0.3 only.
TEST(Certificate, BoundsTheErrorOfEveryLevel) {
  for (const Case& c : cases()) {
    CertifySpec spec;
    spec.bands = {{0.5, 12.3}};
    spec.target = 1e-9;
    const Medium medium = certify(c.body, c.mass_is_singular, spec, {}, silent());
    EXPECT_TRUE(medium.shortfall.empty()) << c.name << ": " << medium.shortfall;
    ASSERT_GE(medium.levels.size(), 2u) << c.name;
    EXPECT_TRUE(medium.levels.back().proved) << c.name;
    std::vector<double> omega;
    for (int l = 0; l < 37; ++l) omega.push_back(0.503 + (12.29 - 0.503) * l / 36);
    const auto H = Referee(c.body).transfer(omega);
    for (std::size_t k = 0; k < medium.levels.size(); ++k) {
      const MediumModel model(medium, k, find_ports(medium.body, {}, {}), {},
                              RelativeTo::pointwise);
      const std::string name = c.name;
      if (name.rfind("outputs by", 0) != 0) {
        EXPECT_EQ(model.has_many_ports(), name.rfind("many", 0) == 0);
      }
      double largest = 0, largest_bound = 0, floor = 0;
      for (std::size_t l = 0; l < omega.size(); ++l) {
        const MediumModel::Stretch value = model.at(omega[l]);
        const ComplexDense H_medium = model.transfer(omega[l]);
        ComplexDense difference = H[l];
        for (std::size_t i = 0; i < difference.data.size(); ++i)
          difference.data[i] -= H_medium.data[i];
        const double truth = frobenius_norm(difference);
        const Certificate::Bound& bound = value.bounds[0];
        if (bound.proved) {
          EXPECT_LE(truth, bound.error + bound.floor)
              << c.name << ", level " << k << " at " << omega[l];
        }
        largest = std::max(largest, truth);
        largest_bound = std::max(largest_bound, bound.error);
        floor = std::max(floor, bound.floor);
      }
      if (largest > 100 * floor && medium.levels[k].proved) { // and it is tight
        EXPECT_LE(largest_bound, 3 * largest) << c.name << ", level " << k;
      }
    }
  }
}

/// What sixty outputs leave in their residuals matters as much as the inputs' residuals are
/// along it: beside two inputs the space grows by some directions, not by another sixty.
TEST(Certificate, GrowsByTheInputsWhereOutputsAreMany) {
  CertifySpec spec;
  spec.bands = {{0.5, 12.3}};
  spec.target = 5e-6;
  const Medium medium = certify(rod_with_strains(600, 60), false, spec, {}, silent());
  EXPECT_TRUE(medium.shortfall.empty());
  EXPECT_GE(medium.levels.size(), 2u);
  EXPECT_LE(medium.levels.back().order(), 48); // 140 with the outputs' responses
}

/// Gram matrices know the response of many ports to the root of rounding only: a difference
/// far below the tolerance is not looked at until the intervals run out.
TEST(ErrorOverBand, LeavesErrorsOfManyPortsThatDoNotMatter) {
  for (const Case& c : cases()) {
    if (std::string(c.name).rfind("many", 0) != 0) continue;
    CertifySpec spec;
    spec.bands = {{0.5, 12.3}};
    spec.target = 1e-9;
    const Medium medium = certify(c.body, c.mass_is_singular, spec, {}, silent());
    MediumModel model(medium, medium.levels.size() - 1, find_ports(medium.body, {}, {}),
                      {}, RelativeTo::pointwise);
    const DenseSystem same = model.system.project(identity(model.system.order()));
    ASSERT_TRUE(model.has_many_ports());
    MediumOverBand over(std::move(model), spec.bands, {0.5, 3.0, 12.3});
    ErrorOverBand errors(over, RelativeTo::pointwise);
    const auto found = errors.supremum(same, 1e-3);
    EXPECT_TRUE(found.proved) << c.name;
    EXPECT_LE(found.worst, 1e-4) << c.name;
    EXPECT_LT(found.intervals, 1000) << c.name;
  }
}

TEST(TermNorms, AreThoseOfTheEntries) {
  DenseSystem system;
  const int N = 24;
  system.M = system.K = identity(N);
  for (int i = 0; i < N; ++i) system.K(i, i) = 3.0 + i * i;
  system.damping = {0.02, 1e-3, 0.01};
  system.B = system.C = Dense(N, 31);
  for (std::size_t i = 0; i < system.B.data.size(); ++i)
    system.B.data[i] = std::sin(3.0 * static_cast<double>(i) + 1);
  const DenseResponse response(std::move(system), 1.0);
  const auto x = response_series(response, {2.2, 2.25}, 12),
             factors = modal_factors(response, {2.2, 2.25}, 12);
  ASSERT_TRUE(x && factors);
  const Dense &C = response.modal_outputs(), &B = response.modal_inputs();
  PortView all{"all", {}, {}};
  for (int i = 0; i < 31; ++i) all.rows.push_back(i);
  all.columns = all.rows;
  const ViewNorms expected = view_norms(multiply_transposed(C, x->x), all);
  const TermNorms found = term_norms(TermGram(C, B), factors->x);
  for (std::size_t i = 0; i <= pieces; ++i)
    EXPECT_NEAR(found.norms.at[i], expected.at[i], 1e-12 * expected.at[i]);
  for (std::size_t i = 0; i < pieces; ++i) {
    EXPECT_NEAR(found.norms.above[i], expected.above[i], 1e-9 * expected.above[i]);
    EXPECT_NEAR(found.norms.below[i], expected.below[i], 1e-9 * expected.below[i]);
    EXPECT_GE(found.norms.above[i], found.norms.at[i]);
    EXPECT_LE(found.norms.below[i], found.norms.at[i]);
  }
  EXPECT_LT(found.rounding, 1e-5 * expected.at[0]);
  // Several at once, of different degrees, say the same of each.
  const auto point = modal_factors(response, {1.1, 1.1}, 0);
  const auto together = term_norms(TermGram(C, B), {point->x, factors->x, point->x});
  ASSERT_EQ(together.size(), 3u);
  const double alone = frobenius_norm(response.transfer(1.1));
  EXPECT_NEAR(together[0].norms.at[0], alone, 1e-12 * alone);
  EXPECT_NEAR(together[2].norms.at[0], alone, 1e-12 * alone);
  for (std::size_t i = 0; i < pieces; ++i)
    EXPECT_NEAR(together[1].norms.above[i], found.norms.above[i],
                1e-12 * found.norms.above[i]);
  // A difference of two equal responses: nothing but rounding, which is told.
  MatrixSeries negative = factors->x;
  for (double& f : negative.coefficients.data) f = -f;
  const TermGram one(C, B);
  const TermNorms zero =
      term_norms(TermGram(one, one.Q, one), stacked(factors->x, negative));
  EXPECT_LE(zero.norms.at[0], zero.rounding);
}

/// One port of many modes has zeros of H: there, doubles lose a share of the terms that is larger
/// than what is left of them.
TEST(TermNorms, ResponsesThatNearlyVanishHaveMoreDigits) {
  __extension__ typedef __float128 Quad;
  const int N = 40;
  DenseSystem system;
  system.K = system.M = Dense(N, N);
  system.B = Dense(N, 1);
  for (int j = 0; j < N; ++j) {
    system.M(j, j) = 1;
    system.K(j, j) = std::pow(1.0 + j, 2);
    system.B(j, 0) = 1 / (1.0 + 0.1 * j);
  }
  const auto exact = [&](double omega) {
    Quad sum = 0;
    for (int j = 0; j < N; ++j)
      sum += static_cast<Quad>(system.B(j, 0)) * system.B(j, 0) /
             (static_cast<Quad>(system.K(j, j)) - static_cast<Quad>(omega) * omega);
    return sum;
  };
  double low = 1.2, high = 1.9; // a zero between the first two modes
  for (int step = 0; step < 60; ++step) {
    const double middle = 0.5 * (low + high);
    (exact(middle) < 0 ? low : high) = middle;
  }
  const DenseResponse response(system, 1.0);
  const auto numbers = ModalNumbers::of(system);
  ASSERT_TRUE(numbers);
  for (const double half : {0.0, 1e-9, 1e-7}) {
    const Interval interval{low - half, low + half};
    const int degree = half > 0 ? 12 : 0;
    const auto x = response_series(response, interval, degree);
    ASSERT_TRUE(x);
    const MatrixSeries plain = transfer_series(response.modal_outputs(), *x, 0, nullptr),
                       finer =
                           transfer_series(response.modal_outputs(), *x, 0, &*numbers);
    EXPECT_LT(finer.tail(0, 0), 0.01 * plain.tail(0, 0));
    for (const double t : {-1.0, -0.3, 0.0, 0.8, 1.0}) {
      const double omega = interval.centre() + t * interval.half();
      double value = 0;
      for (int k = degree; k >= 0; --k) value = value * t + finer.real(k)[0];
      const auto expected = static_cast<double>(exact(omega));
      // ω itself is rounded: by that, H changes by its slope times ε.
      const double slope = 10 * 2.3e-16 * interval.last;
      EXPECT_NEAR(value, expected, finer.tail(0, 0) + (half > 0 ? slope : 0.0));
    }
  }
}
