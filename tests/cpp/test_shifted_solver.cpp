#include "examples.hpp"
#include "linalg/shifted_solver.hpp"

using namespace flexgram;
using namespace flexgram::examples;

namespace {

constexpr PetscInt n = 60;

/// max |A x − b| with A = k K + m M over max |b|, computed densely.
double residual(const SecondOrderModel& model, const ShiftCoefficients& c,
                const Block& x) {
  const Dense K = whole(model.K), M = whole(model.M), X = whole(x), B = whole(model.B);
  const int p = B.columns;
  double worst = 0;
  for (int j = 0; j < p; ++j)
    for (int i = 0; i < n; ++i) {
      std::complex<double> r = -B(i, j);
      for (int k = 0; k < n; ++k)
        r += (c.k * K(i, k) + c.m * M(i, k)) *
             std::complex<double>(X(k, j), X.columns > p ? X(k, j + p) : 0.0);
      worst = std::max(worst, std::abs(r));
    }
  return worst;
}

} // namespace

TEST(ShiftedSolver, RealShiftsStayRealAndComplexOnesAreSolved) {
  const SecondOrderModel model = rod(n);
  ShiftedSolver solver(model.K, model.M, {}, {}, {});
  for (const ShiftCoefficients& c :
       {ShiftCoefficients{1.0, -30.0}, ShiftCoefficients{{1.0, 0.01}, {-30.0, 0.2}}}) {
    solver.factorise(c);
    const auto solution = solver.solve(model.B);
    EXPECT_EQ(solution.x.columns(), c.real() ? 2 : 4);
    EXPECT_LT(solution.backward_error, 1e-15);
    // ‖A‖‖x‖ ≈ 2 · 60 · 2: the residual is that times rounding.
    EXPECT_LT(residual(model, c, solution.x), 1e-12);
  }
  EXPECT_EQ(solver.factorisations(), 2);
}

TEST(ShiftedSolver, SinglePrecisionIsRefinedToDouble) {
  const SecondOrderModel model = rod(n);
  SolverOptions options;
  options.precision = Precision::single_precision;
  ShiftedSolver solver(model.K, model.M, {}, {}, options);
  const ShiftCoefficients c{{1.0, 0.05}, {-30.0, 0.2}};
  solver.factorise(c);
  const auto solution = solver.solve(model.B);
  EXPECT_GT(solution.refinements, 0);
  EXPECT_LE(solution.backward_error, options.backward_error);
  EXPECT_LT(residual(model, c, solution.x), 1e-9);
}

TEST(ShiftedSolver, SinglePrecisionFallsBackToDoubleBesideAResonance) {
  const SecondOrderModel model = rod(n);
  SolverOptions options;
  options.precision = Precision::single_precision;
  ShiftedSolver solver(model.K, model.M, {}, {}, options);
  solver.factorise({1.0, -rod_eigenvalue(n, 3) * (1 + 1e-9)});
  const auto solution = solver.solve(model.B);
  EXPECT_LE(solution.backward_error, options.backward_error);
  EXPECT_EQ(solver.factorisations(), 2); // one single, one double
}

TEST(ShiftedSolver, FactorsInSinglePrecisionAreCountedInDouble) {
  const SecondOrderModel model = rod(n);
  SolverOptions options;
  options.precision = Precision::single_precision;
  for (PetscInt k : {1, 4}) { // between the k-th eigenvalue and the next, close to it
    ShiftedSolver solver(model.K, model.M, {}, {}, options);
    solver.count_pivots(true);
    const ShiftCoefficients c{1.0, -rod_eigenvalue(n, k) * (1 + 1e-6)};
    solver.factorise(c);
    EXPECT_EQ(solver.negative_pivots(), k);
    EXPECT_EQ(solver.null_pivots(), 0);
    solver.forget_pattern();
    EXPECT_LE(solver.solve(model.B).backward_error, options.backward_error);
    EXPECT_EQ(solver.negative_pivots(), k); // after a fall-back, too
    EXPECT_EQ(solver.factorisations(), solver.fell_back() ? 3 : 2); // one only counts
  }
}

TEST(ShiftedSolver, FactorsOnDiskSolveAsThoseInMemory) {
  const SecondOrderModel model = rod(n);
  ShiftedSolver solver(model.K, model.M, {}, {}, {});
  solver.analyse(true);
  solver.use(true, true);
  const ShiftCoefficients c{1.0, -30.0};
  solver.factorise(c);
  const auto solution = solver.solve(model.B);
  EXPECT_LE(solution.backward_error, 1e-13);
  EXPECT_LT(residual(model, c, solution.x), 1e-9);
}

TEST(ShiftedSolver, AnExactResonanceIsAShiftError) {
  const SecondOrderModel model = rod(1);
  ShiftedSolver solver(model.K, model.M, {}, {}, {});
  // One dof: K = 1, M = 1/3, so K − 3M is exactly zero.
  EXPECT_THROW(
      {
        solver.factorise({1.0, -3.0});
        solver.solve(model.B);
      },
      ShiftError);
}

TEST(ShiftedSolver, AnAntiresonanceIsNotSingular) {
  // K = [2 −1; −1 1], M = I, ω = 1: H_11 = 0 although det A = −1.
  const Matrix K = sparse(
      2, [](PetscInt i, PetscInt j) { return i != j ? -1.0 : (i == 0 ? 2.0 : 1.0); }, 1);
  const Matrix M = sparse(
      2, [](PetscInt, PetscInt) { return 1.0; }, 0);
  ShiftedSolver solver(K, M, {}, {}, {});
  solver.factorise({1.0, -1.0});
  const Block b = block(2, 1, [](PetscInt i, PetscInt) { return i == 0 ? 1.0 : 0.0; });
  const Dense x = whole(solver.solve(b).x);
  EXPECT_NEAR(x(0, 0), 0, 1e-15);
  EXPECT_NEAR(x(1, 0), -1, 1e-15);
}

TEST(ShiftedSolver, InertiaIsTheModeCount) {
  const SecondOrderModel model = rod(n);
  ShiftedSolver solver(model.K, model.M, {}, {}, {});
  solver.count_pivots(true);
  for (const int k : {1, 4, 9}) {
    solver.factorise({1.0, -0.5 * (rod_eigenvalue(n, k) + rod_eigenvalue(n, k + 1))});
    EXPECT_EQ(solver.negative_pivots(), k);
  }
}

TEST(ShiftedSolver, EveryOrderingGivesTheSameSolution) {
  const SecondOrderModel model = rod(3000);
  std::vector<Dense> solutions;
  for (const Ordering ordering : {Ordering::automatic, Ordering::best,
                                  Ordering::nested_dissection, Ordering::mumps}) {
    SolverOptions options;
    options.mumps.ordering = ordering;
    ShiftedSolver solver(model.K, model.M, {}, {}, options);
    solver.factorise({1.0, -30.0});
    solutions.push_back(inner(model.B, solver.solve(model.B).x));
  }
  for (const auto& h : solutions)
    // Condition of K − 30 M is some 1e7, times rounding.
    for (std::size_t i = 0; i < h.data.size(); ++i)
      EXPECT_NEAR(h.data[i], solutions[0].data[i], 1e-8);
}
