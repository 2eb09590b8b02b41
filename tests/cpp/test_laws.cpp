/// Terms g(ω)T: the series of g, and the response to it, against values in long double.

#include "linalg/decompositions.hpp"
#include "medium/response_series.hpp"
#include "model/parameters.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

using namespace flexgram;

namespace {

using Long = long double;
using LongComplex = std::complex<Long>;

const LawNumbers series{{"g", {0.7, 20, 1e-3, 0}}, {"tau", {1e-3, 0.4, 50, 1e9}}};
const LawNumbers points{{"omega", {0, 3, 10, 11, 400}},
                        {"storage", {0, 0.2, 5, 2, 2.5}},
                        {"loss", {0.1, 0, 3, 3, 0.5}}};
const LawNumbers between{{"least", {1}},   {"most", {5}},   {"value", {3}},
                         {"slope", {0.5}}, {"loss", {0.1}}, {"eta", {0.02}},
                         {"beta", {1e-3}}};

/// Three times two: of a product.
const LawNumbers times{{"least", {1}}, {"most", {5}}, {"value", {3}}, {"slope", {2}}};
LawNumbers product(LawNumbers numbers = {}) {
  numbers.insert(times.begin(), times.end());
  return numbers;
}

std::vector<Law> laws() {
  return {Law(),
          Law(Law::Kind::structural),
          Law("rubber", "prony", series),
          Law("foam", "table", points),
          Law("bolt", "parameter", between),
          Law("damper", "parameter*viscous", product()),
          Law("loss", "parameter*structural", product()),
          Law("E:relaxation", "parameter*prony", product(series)),
          Law("E:table", "parameter*table", product(points))};
}

/// g by its definition.
LongComplex value(const Law& law, double omega) {
  const LongComplex i(0, 1);
  const auto w = static_cast<Long>(omega);
  if (law.is_product()) {
    const std::string of = law.kind_name().substr(10);
    if (of == "viscous" || of == "structural")
      return static_cast<Long>(6) * (of == "viscous" ? i * w : i);
    return static_cast<Long>(6) *
           value(of == "prony" ? Law("x", of, series) : Law("x", of, points), omega);
  }
  if (law.is_viscous()) return i * w;
  if (law.is_structural()) return i;
  if (law.is_parameter()) // (3 − 1)/2 of the stiffness, with its losses
    return LongComplex(1) + i * (static_cast<Long>(0.1) + static_cast<Long>(0.02) +
                                 w * static_cast<Long>(1e-3));
  LongComplex sum = 0;
  if (law.kind_name() == "prony") {
    for (std::size_t k = 0; k < series.at("g").size(); ++k) {
      const LongComplex z = i * w * static_cast<Long>(series.at("tau")[k]);
      sum += static_cast<Long>(series.at("g")[k]) * z / (LongComplex(1) + z);
    }
    return sum;
  }
  const auto &at = points.at("omega"), &storage = points.at("storage"),
             &loss = points.at("loss");
  if (omega >= at.back())
    return {static_cast<Long>(storage.back()), static_cast<Long>(loss.back())};
  std::size_t k = 0;
  while (at[k + 1] <= omega) ++k;
  const Long t = (w - static_cast<Long>(at[k])) / static_cast<Long>(at[k + 1] - at[k]);
  const auto interpolated = [&](const std::vector<double>& y) {
    return (1 - t) * static_cast<Long>(y[k]) + t * static_cast<Long>(y[k + 1]);
  };
  return {interpolated(storage), interpolated(loss)};
}

std::vector<Interval> intervals() {
  std::vector<Interval> all{{0, 5},  {0, 0.3},   {2, 2},   {3, 10},
                            {9, 12}, {300, 500}, {0, 1000}};
  std::mt19937 random(7);
  std::uniform_real_distribution<double> uniform(0, 1);
  for (int k = 0; k < 200; ++k) {
    const double first = 600 * std::pow(uniform(random), 3);
    all.push_back({first, first + 50 * std::pow(uniform(random), 4)});
  }
  return all;
}

} // namespace

TEST(Law, SeriesHoldTheFactorEverywhere) {
  for (const Law& law : laws())
    for (const Interval& interval : intervals())
      for (int degree : {2, 5, 12}) {
        const LawSeries s = law.series(interval, degree);
        ASSERT_GE(s.coefficients.size(), 2U);
        double largest = 0, moved = 0, sizes = 0;
        for (const auto& x : s.coefficients) sizes += std::abs(x);
        for (int l = -10; l <= 10; ++l) {
          const double t = 0.1 * l, omega = interval.centre() + t * interval.half();
          std::complex<double> sum = 0;
          for (std::size_t k = s.coefficients.size(); k-- > 0;)
            sum = sum * t + s.coefficients[k];
          const std::complex<double> exact(value(law, omega));
          largest = std::max(largest, std::abs(exact));
          const std::complex<double> at_centre(value(law, interval.centre()));
          moved = std::max(moved, std::abs(exact - at_centre));
          EXPECT_LE(std::abs(sum - s.coefficients[0] - (exact - at_centre)),
                    s.rest + 1e-14 * (std::abs(exact) + std::abs(at_centre)));
          // Coefficients are rounded to doubles, one by one.
          EXPECT_LE(std::abs(sum - exact),
                    s.rest + 1e-14 * std::abs(exact) + 4e-16 * sizes)
              << law.name() << " at " << omega << ", degree " << degree;
          EXPECT_GE(exact.real(), 0);
          EXPECT_GE(exact.imag(), 0);
        }
        EXPECT_LE(moved, s.moved() + 1e-14 * largest);
        EXPECT_LE(largest, law.largest(interval.last) * (1 + 1e-14));
      }
}

TEST(Law, IsExactBetweenTheFrequenciesOfATable) {
  const Law law("foam", "table", points);
  EXPECT_EQ(law.series({3, 10}, 12).rest, 0);
  EXPECT_GT(law.series({9, 12}, 12).rest, 0.1);
  EXPECT_EQ(law.kind().breaks(), points.at("omega"));
  EXPECT_EQ(law.kind().known(), (Interval{0, 400}));
  EXPECT_EQ(law.path(), "/terms/foam");
}

TEST(Law, OfAParameterHasAValueOfItsRange) {
  const Law law("bolt", "parameter", between);
  EXPECT_TRUE(law.is_parameter());
  EXPECT_EQ(law.number("most"), 5);
  EXPECT_EQ(law.with("value", 1).at(7), std::complex<double>(0));
  EXPECT_DOUBLE_EQ(law.with("value", 5).at(0).real(), 2);
  EXPECT_THROW(law.with("value", 0.9), Error);
  EXPECT_THROW(law.with("most", 2), Error);
}

TEST(Law, OfAProductDependsOnTheParameterThatItsTermIsNamedAfter) {
  const Law damper("a.damper", "parameter*viscous", product()),
      relaxation("a.E:relaxation", "parameter*prony", product(series));
  EXPECT_EQ(damper.parameter(), "a.damper");
  EXPECT_EQ(relaxation.parameter(), "a.E");
  EXPECT_EQ(damper.path(), "/terms/a.damper");
  EXPECT_TRUE(damper.is_of_rates() && damper.is_product() && !damper.is_viscous());
  EXPECT_EQ(damper.with("value", 5).at(2), std::complex<double>(0, 20));
  EXPECT_DOUBLE_EQ(damper.shares({2, 4}).front(), 3.0 / 5);
  EXPECT_DOUBLE_EQ(damper.shares({2, 4}).back(), 1.0 / 5);
  EXPECT_EQ(numbers_of_law("parameter*prony"),
            (std::vector<std::string>{"least", "most", "value", "slope", "g", "tau"}));
  std::vector<Law> one;
  const Law E("a.E", "parameter", between);
  EXPECT_EQ(place_among(one, E), 0U);
  EXPECT_EQ(place_among(one, relaxation), 0U);
  EXPECT_THROW(place_among(one, relaxation.with("value", 4)), Error);
}

TEST(Parameters, ShowTheirBox) {
  LawNumbers other = between;
  other["least"] = {0};
  const std::vector<Law> both{Law("a", "parameter", between),
                              Law("b", "parameter", other)};
  const std::vector<Law> one(both.begin(), both.begin() + 1);
  EXPECT_TRUE(values_that_show({}, 0).empty());
  EXPECT_EQ(values_that_show(one, 1), (std::vector<ParameterValues>{{3}}));
  const auto five = values_that_show(one, 0);
  ASSERT_EQ(five.size(), 6U); // and the present one
  EXPECT_EQ(five.front(), ParameterValues{3});
  EXPECT_EQ(five[1], ParameterValues{1});
  EXPECT_DOUBLE_EQ(five[3].front(), std::sqrt(5.0)); // on a logarithmic scale
  EXPECT_EQ(five.back(), ParameterValues{5});
  const auto nine = values_that_show(both, 0);
  EXPECT_EQ(nine.size(), 10U);
  EXPECT_DOUBLE_EQ(nine[4].back(), 2.5); // linear from zero
  EXPECT_EQ(values_between(both, 0).size(), 4U);
  EXPECT_EQ(values_between(both, 3), values_between(both, 0));
  EXPECT_TRUE(values_between(both, 1).empty());
  EXPECT_EQ(words_of(both, {2, 2.5}), "a = 2, b = 2.5");
}

TEST(Law, RefusesNumbersThatMakeNone) {
  const auto refusal = [](const std::string& kind, const LawNumbers& numbers) {
    try {
      Law("x", kind, numbers);
    } catch (const Error& error) {
      return std::string(error.what());
    }
    return std::string();
  };
  EXPECT_NE(refusal("pronny", {}).find("did you mean prony"), std::string::npos);
  EXPECT_NE(refusal("prony", {{"g", {1}}}).find("has no tau"), std::string::npos);
  EXPECT_NE(refusal("prony", {{"g", {1}}, {"tau", {1, 2}}}).find("2 numbers"),
            std::string::npos);
  EXPECT_NE(refusal("prony", {{"g", {-1}}, {"tau", {1}}}).find("negative"),
            std::string::npos);
  EXPECT_NE(refusal("prony", {{"g", {NAN}}, {"tau", {1}}}).find("holds"),
            std::string::npos);
  EXPECT_NE(refusal("table", {{"omega", {2, 1}}, {"storage", {0, 1}}, {"loss", {0, 0}}})
                .find("rise"),
            std::string::npos);
  EXPECT_NE(refusal("parameter*gyroscopic", product()).find("multiplies"),
            std::string::npos);
  EXPECT_NE(refusal("parameter*parameter", product(between)).find("multiplies"),
            std::string::npos);
  EXPECT_NE(refusal("parameter*pronny", product()).find("did you mean prony"),
            std::string::npos);
  LawNumbers negative = product();
  negative["least"] = {-1};
  EXPECT_NE(refusal("parameter*viscous", negative).find("rise from 0"),
            std::string::npos);
}

/// A small system of each law, two of them at once: X of the series against elimination in long
/// double, nowhere farther than its tail.
TEST(ResponseSeries, HoldsTheResponseOfSystemsWithTerms) {
  constexpr int N = 12;
  std::mt19937 random(3);
  std::uniform_real_distribution<double> uniform(-1, 1);
  const auto gram = [&](int rank) {
    Dense F(N, rank);
    for (double& x : F.data) x = uniform(random);
    return multiply(F, transpose(F));
  };
  int known = 0;
  for (const Law& first : laws())
    for (const Law& second : laws()) {
      DenseSystem system;
      system.K = system.M = Dense(N, N);
      for (int i = 0; i < N; ++i) {
        system.K(i, i) = std::pow(1.5 + i, 2);
        system.M(i, i) = 1;
      }
      system.damping.alpha = 0.05;
      system.terms.push_back({first, gram(4)});
      if (!(first == second)) system.terms.push_back({second, gram(3)});
      system.B = Dense(N, 2);
      for (double& x : system.B.data) x = uniform(random);
      system.C = system.B;
      const DenseResponse response(system, 36);
      for (const Interval& interval : {Interval{0.5, 0.6},
                                       {2.9, 3.0},
                                       {2.95, 3.05},
                                       {5, 5},
                                       {5, 5.3},
                                       {9.99, 10.02},
                                       {10.5, 10.6}}) {
        const auto x = response_series(response, interval, 12);
        if (!x) continue;
        ++known;
        for (double t : {-1.0, -0.3, 0.0, 0.8, 1.0}) {
          const double omega = interval.centre() + t * interval.half();
          const auto w = static_cast<Long>(omega);
          DenseOf<LongComplex> A(N, N);
          for (std::size_t k = 0; k < A.data.size(); ++k) {
            A.data[k] = static_cast<Long>(system.K.data[k]) +
                        LongComplex(-w * w, w * static_cast<Long>(0.05)) *
                            static_cast<Long>(system.M.data[k]);
            for (const auto& [law, T] : system.terms)
              A.data[k] += value(law, omega) * static_cast<Long>(T.data[k]);
          }
          DenseOf<LongComplex> q(N, 2);
          for (std::size_t k = 0; k < q.data.size(); ++k)
            q.data[k] = static_cast<Long>(system.B.data[k]);
          for (int k = 0; k < N; ++k) // the real part is definite enough without pivots
            for (int i = k + 1; i < N; ++i) {
              const LongComplex f = A(i, k) / A(k, k);
              for (int j = k; j < N; ++j) A(i, j) -= f * A(k, j);
              for (int j = 0; j < 2; ++j) q(i, j) -= f * q(k, j);
            }
          for (int k = N; k-- > 0;)
            for (int j = 0; j < 2; ++j) {
              for (int l = k + 1; l < N; ++l) q(k, j) -= A(k, l) * q(l, j);
              q(k, j) /= A(k, k);
            }
          // In modal coordinates: q = U x.
          for (int j = 0; j < 2; ++j)
            for (int i = 0; i < N; ++i) {
              std::complex<double> sum = 0;
              double tail = 0;
              for (int l = 0; l < N; ++l) {
                std::complex<double> entry = 0;
                for (int k = x->x.degree(); k >= 0; --k)
                  entry = entry * t + std::complex<double>(x->x.real(k)[l + N * j],
                                                           x->x.imaginary(k)[l + N * j]);
                sum += response.U()(i, l) * entry;
                tail += std::abs(response.U()(i, l)) * x->x.tail(l, j);
              }
              EXPECT_LE(std::abs(sum - std::complex<double>(q(i, j))), tail)
                  << first.name() << " and " << second.name() << " at " << omega;
            }
        }
      }
    }
  EXPECT_GT(known, 60);
}
