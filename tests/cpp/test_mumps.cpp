#include "base/index.hpp"
#include "base/text.hpp"
#include "examples.hpp"
#include "linalg/ordering.hpp"

#include <algorithm>
#include <numeric>

using namespace flexgram;
using namespace flexgram::examples;

namespace {

constexpr int side = 14, n = side * side;

/// Five-point stencil on a square grid minus `shift`, lower triangle of this rank's rows.
/// Eigenvalues: 4 − 2cos(iπ/(s+1)) − 2cos(jπ/(s+1)) − shift.
struct Grid {
  Pattern pattern;
  std::vector<double> values;
  RowRange rows;
  std::vector<std::int64_t> node; ///< of each row, where there are nodes
};

double stencil(int i, int j) {
  if (i == j) return 4;
  const int high = std::max(i, j), low = std::min(i, j);
  return (high - low == side || (high - low == 1 && high % side != 0)) ? -1 : 0;
}

Grid grid(double shift) {
  Grid g;
  g.pattern.n = n;
  g.rows = even_rows(world(), n);
  for (int i = static_cast<int>(g.rows.begin); i < g.rows.end; ++i)
    for (int j = 0; j <= i; ++j)
      if (const double value = stencil(i, j); value != 0) {
        g.pattern.row.push_back(i + 1);
        g.pattern.column.push_back(j + 1);
        g.values.push_back(i == j ? value - shift : value);
      }
  return g;
}

/// Three directions at each node of the grid, which know each other by `coupling`.
Grid nodal_grid(double coupling) {
  Grid g;
  g.pattern.n = 3 * n;
  g.rows = even_rows(world(), g.pattern.n);
  for (int i = static_cast<int>(g.rows.begin); i < g.rows.end; ++i) {
    g.node.push_back(i / 3);
    for (int j = 0; j <= i; ++j)
      if (const double value = stencil(i / 3, j / 3) * (i % 3 == j % 3 ? 4 : coupling);
          value != 0) {
        g.pattern.row.push_back(i + 1);
        g.pattern.column.push_back(j + 1);
        g.values.push_back(value);
      }
  }
  return g;
}

/// A matrix without zeros: some megabytes of factors.
Grid full_matrix(int order) {
  Grid g;
  g.pattern.n = order;
  g.rows = even_rows(world(), order);
  for (int i = static_cast<int>(g.rows.begin); i < g.rows.end; ++i)
    for (int j = 0; j <= i; ++j) {
      g.pattern.row.push_back(i + 1);
      g.pattern.column.push_back(j + 1);
      g.values.push_back(i == j ? 1000.0 : 1.0);
    }
  return g;
}

double eigenvalue(int i, int j) {
  return 4 - 2 * std::cos(i * M_PI / (side + 1)) - 2 * std::cos(j * M_PI / (side + 1));
}

/// Solves with right-hand sides e_0 and e_1 of all ranks and returns max |A x − b|.
template <class Scalar>
double residual(Scalar factor) {
  const Grid g = grid(0.25);
  Mumps<Scalar> mumps(world(), {});
  mumps.analyse(g.pattern, {});
  std::vector<Scalar> values;
  for (double v : g.values) values.push_back(factor * Scalar(static_cast<float>(v)));
  mumps.factorise(g.pattern, values);
  const auto local = as_size(g.rows.size());
  std::vector<Scalar> x(2 * local);
  for (int j = 0; j < 2; ++j)
    if (j >= g.rows.begin && j < g.rows.end)
      x[as_size(j - g.rows.begin) + as_size(j) * local] = 1;
  mumps.solve(g.rows, x, 2);
  // Gather x and multiply by the stencil.
  std::vector<std::complex<double>> all(2 * n);
  for (int j = 0; j < 2; ++j)
    for (std::size_t i = 0; i < local; ++i)
      all[as_size(g.rows.begin) + i + as_size(j * n)] =
          std::complex<double>(x[i + as_size(j) * local]);
  MPI_Allreduce(MPI_IN_PLACE, all.data(), 4 * n, MPI_DOUBLE, MPI_SUM, world());
  double worst = 0;
  for (int j = 0; j < 2; ++j)
    for (int i = 0; i < n; ++i) {
      std::complex<double> r = i == j ? -1.0 : 0.0;
      for (int k = 0; k < n; ++k)
        r += std::complex<double>(factor) * (stencil(i, k) - (i == k ? 0.25 : 0.0)) *
             all[as_size(k + j * n)];
      worst = std::max(worst, std::abs(r));
    }
  return worst;
}

} // namespace

TEST(Mumps, FourArithmeticsSolveTheSameMatrix) {
  // ‖A‖‖x‖ is about 10, so residuals are some ten units of rounding.
  const std::complex<double> turn(0.6, 0.8);
  EXPECT_LT(residual<double>(1.0), 1e-13);
  EXPECT_LT(residual<std::complex<double>>(turn), 1e-13);
  EXPECT_LT(residual<float>(1.0F), 5e-5);
  EXPECT_LT(residual<std::complex<float>>(std::complex<float>(turn)), 5e-5);
}

TEST(Mumps, InertiaCountsTheEigenvaluesBelowTheShift) {
  for (const double shift : {0.05, 0.3, 2.1, 7.0}) {
    int below = 0;
    for (int i = 1; i <= side; ++i)
      for (int j = 1; j <= side; ++j) below += eigenvalue(i, j) < shift;
    const Grid g = grid(shift);
    Mumps<double> mumps(world(), {});
    mumps.tolerate_null_pivots(true);
    mumps.analyse(g.pattern, {});
    mumps.factorise(g.pattern, g.values);
    EXPECT_EQ(mumps.negative_pivots(), below) << "shift " << shift;
  }
}

TEST(Mumps, ASingularMatrixIsAClearError) {
  Pattern p;
  p.n = 4;
  std::vector<double> values;
  if (comm_rank(world()) == 0)
    for (int i = 1; i <= 4; ++i) {
      p.row.push_back(i);
      p.column.push_back(i);
      values.push_back(i == 3 ? 0.0 : 1.0);
    }
  Mumps<double> mumps(world(), {});
  mumps.analyse(p, {});
  try {
    mumps.factorise(p, values);
    FAIL() << "no error";
  } catch (const ShiftError& error) {
    EXPECT_NE(std::string(error.what()).find("singular"), std::string::npos);
  }
}

TEST(Mumps, TooLittleMemoryNamesTheNeed) {
  MumpsOptions options;
  options.memory_limit_mb = 0.5;
  const Grid g = full_matrix(600);
  Mumps<double> mumps(world(), options);
  const FactorEstimate estimate = mumps.analyse(g.pattern, {});
  try {
    mumps.factorise(g.pattern, g.values);
    FAIL() << "no error";
  } catch (const MemoryError& error) {
    EXPECT_NE(std::string(error.what()).find(text("needs %.0f MB", estimate.mb_per_rank)),
              std::string::npos)
        << error.what();
  }
}

TEST(Mumps, MoreWorkspaceIsTriedUpToTheLimit) {
  // ICNTL(23) = 1 MB of working memory is too little for the fronts: MUMPS answers −9 or
  // −19.
  MumpsOptions options;
  options.icntl[23] = 1;
  options.workspace_percent = 5;
  options.workspace_limit = 20;
  const Grid g = full_matrix(600);
  Mumps<double> mumps(world(), options);
  mumps.analyse(g.pattern, {});
  EXPECT_THROW(mumps.factorise(g.pattern, g.values), MemoryError);
}

TEST(Mumps, NestedDissectionIsAPermutationThatKeepsNodesTogether) {
  const Grid g = nodal_grid(1.0);
  const PivotOrder order = nested_dissection(world(), g.pattern, g.node);
  if (comm_rank(world()) != 0) {
    EXPECT_TRUE(order.position.empty());
    EXPECT_TRUE(order.block_start.empty());
    return;
  }
  auto sorted = order.position;
  std::sort(sorted.begin(), sorted.end());
  std::vector<int> expected(sorted.size());
  std::iota(expected.begin(), expected.end(), 1);
  EXPECT_EQ(sorted, expected);
  for (std::size_t i = 0; i < order.position.size(); i += 3) {
    EXPECT_EQ(order.position[i] % 3, 1);
    EXPECT_EQ(order.position[i + 1], order.position[i] + 1);
    EXPECT_EQ(order.position[i + 2], order.position[i] + 2);
  }
  ASSERT_EQ(order.block_start.size(), as_size(n) + 1);
  for (std::size_t k = 0; k < order.block_start.size(); ++k)
    EXPECT_EQ(order.block_start[k], 3 * static_cast<int>(k));
}

TEST(Mumps, DirectionsThatAreStrangersAreNoBlocks) {
  const Grid g = nodal_grid(0.0); // each direction by itself, as in a mass matrix
  EXPECT_TRUE(nested_dissection(world(), g.pattern, g.node).block_start.empty());
}

TEST(Mumps, AnalysisByBlocksIsThatOfTheVariables) {
  const Grid g = nodal_grid(1.0);
  const PivotOrder blocks = nested_dissection(world(), g.pattern, g.node);
  const auto local = as_size(g.rows.size());
  std::vector<double> before;
  FactorEstimate estimate_before;
  for (const PivotOrder& order : {PivotOrder{blocks.position, {}}, blocks}) {
    Mumps<double> mumps(world(), {});
    const FactorEstimate estimate = mumps.analyse(g.pattern, order);
    mumps.factorise(g.pattern, g.values);
    EXPECT_EQ(mumps.negative_pivots(), 0);
    std::vector<double> x(local, 1.0);
    mumps.solve(g.rows, x, 1);
    if (!before.empty() || local == 0) {
      EXPECT_LE(estimate.factor_entries, 1.05 * estimate_before.factor_entries);
      for (std::size_t i = 0; i < local; ++i) EXPECT_NEAR(x[i], before[i], 1e-13);
    }
    before = x;
    estimate_before = estimate;
  }
}

TEST(Mumps, AnalysisServesManyFactorisations) {
  const Grid g = grid(0);
  Mumps<double> mumps(world(), {});
  mumps.analyse(g.pattern, {});
  for (double scale : {1.0, 10.0}) {
    std::vector<double> values = g.values;
    for (double& v : values) v *= scale;
    mumps.factorise(g.pattern, values);
    const auto local = as_size(g.rows.size());
    std::vector<double> x(local, scale);
    mumps.solve(g.rows, x, 1); // A x = scale · 1, the same x each time
    double sum = std::accumulate(x.begin(), x.end(), 0.0);
    sum = sum_over(world(), sum);
    static double first = sum;
    EXPECT_NEAR(sum, first, 1e-10 * std::abs(first));
  }
}
