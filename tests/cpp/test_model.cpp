#include "base/index.hpp"
#include "base/observer.hpp"
#include "base/text.hpp"
#include "examples.hpp"
#include "io/body_io.hpp"
#include "linalg/decompositions.hpp"
#include "model/checks.hpp"

#include <algorithm>
#include <cstdio>
#include <unistd.h>

using namespace flexgram;
using namespace flexgram::examples;

namespace {

std::string scratch(const char* name) {
  int id = static_cast<int>(getpid());
  MPI_Bcast(&id, 1, MPI_INT, 0, world());
  return text("/tmp/flexgram_%d_%s", id, name);
}

/// Deletes a file at the end of the test.
struct Scratch {
  explicit Scratch(const char* name) : path(scratch(name)) {}
  ~Scratch() {
    MPI_Barrier(world());
    if (comm_rank(world()) == 0) std::remove(path.c_str());
  }
  std::string path;
};

double difference(const Dense& a, const Dense& b) {
  double worst = a.rows == b.rows && a.columns == b.columns ? 0 : 1e300;
  for (std::size_t i = 0; worst == 0 && i < a.data.size(); ++i)
    worst = std::max(worst, std::abs(a.data[i] - b.data[i]));
  return worst;
}

std::string refusal(const SecondOrderModel& model) {
  Observer silent(world(), Observer::Level::silent);
  try {
    check_body(model, false, true, {}, silent);
  } catch (const Error& error) {
    return error.what();
  }
  return "";
}

} // namespace

TEST(Model, DiscreteEigenvaluesOfTheRodAreTheClosedForm) {
  const PetscInt n = 30;
  const SecondOrderModel model = rod(n);
  const auto eigen = symmetric_eigen(whole(model.K), whole(model.M));
  for (PetscInt k = 1; k <= n; ++k)
    // Rounding of K moves each eigenvalue by about ε λ_max.
    EXPECT_NEAR(eigen.values[as_size(k - 1)], rod_eigenvalue(n, k),
                1e-14 * rod_eigenvalue(n, n));
}

TEST(Model, ThreeMassChainByHand) {
  // m = 1, k = 1, fixed-free: det of (K − ω²M) at ω² = 1 is 2·... solved by hand below.
  SecondOrderModel model;
  model.comm = PETSC_COMM_SELF;
  model.n = 3;
  model.rows = {0, 3};
  Dense K(3, 3);
  const double k[9] = {2, -1, 0, -1, 2, -1, 0, -1, 1};
  std::copy(k, k + 9, K.data.begin());
  model.K = make_dense(K);
  model.M = make_dense(identity(3));
  model.B = Block(PETSC_COMM_SELF, {0, 3}, 3, 1);
  Block::Access(model.B).column(0)[2] = 1;
  model.C = model.B.share();
  // ω² = 1: rows (1 −1 0), (−1 1 −1), (0 −1 0) with right side e3: x2 = −1, x1 = −1, x3 =
  // 0.
  EXPECT_NEAR(std::abs(dense_transfer(model, 1.0)(0, 0)), 0, 1e-15);
  // ω = 0: the tip of three springs in a row under a unit force moves by 3.
  EXPECT_NEAR(dense_transfer(model, 0.0)(0, 0).real(), 3, 1e-14);
  // ω² = 2: rows (0 −1 0), (−1 0 −1), (0 −1 −1), right side e3: x2 = 0, x3 = −1, x1 = 1.
  EXPECT_NEAR(dense_transfer(model, std::sqrt(2.0))(0, 0).real(), -1, 1e-14);
  // Structural damping: K(1 + iη) at ω = 0 divides by 1 + iη.
  model.damping.eta = 0.5;
  EXPECT_NEAR(
      std::abs(dense_transfer(model, 0.0)(0, 0) - 3.0 / std::complex<double>(1, 0.5)), 0,
      1e-14);
}

TEST(Model, ABodyFileReadsBackAsWritten) {
  const Scratch file("body.h5");
  SecondOrderModel model = rod(40, {0.3, 1e-4, 0.02});
  model.outputs_are_inputs = false;
  model.C = select_columns(model.B, {1});
  model.outputs = {"middle.fx"};
  write_body(model, file.path);
  const SecondOrderModel back = read_body(Hdf5File::open(world(), file.path));
  EXPECT_EQ(difference(whole(model.K), whole(back.K)), 0);
  EXPECT_EQ(difference(whole(model.M), whole(back.M)), 0);
  EXPECT_EQ(difference(whole(model.B), whole(back.B)), 0);
  EXPECT_EQ(difference(whole(model.C), whole(back.C)), 0);
  EXPECT_EQ(back.inputs, model.inputs);
  EXPECT_EQ(back.outputs, model.outputs);
  EXPECT_EQ(back.damping.alpha, 0.3);
  EXPECT_EQ(back.damping.beta, 1e-4);
  EXPECT_EQ(back.damping.eta, 0.02);
}

TEST(Model, AProportionalDampingMatrixIsRecognised) {
  SecondOrderModel model = rod(25);
  FG_CALL(MatDuplicate(model.K, MAT_COPY_VALUES, dampers(model).out()));
  FG_CALL(MatScale(model.term({}), 2e-4));
  FG_CALL(MatAXPY(model.term({}), 0.7, model.M, SAME_NONZERO_PATTERN));
  classify_damping(model);
  EXPECT_TRUE(model.terms.empty());
  EXPECT_NEAR(model.damping.alpha, 0.7, 1e-10);
  EXPECT_NEAR(model.damping.beta, 2e-4, 1e-14);
}

TEST(Model, ADashpotIsNotProportional) {
  SecondOrderModel model = rod(25);
  dampers(model) = sparse(
      25, [](PetscInt i, PetscInt j) { return i == 24 && j == 24 ? 3.0 : 0.0; }, 0);
  classify_damping(model);
  EXPECT_EQ(model.terms.size(), 1u);
  EXPECT_EQ(model.damping.alpha, 0);
}

TEST(Model, GroupsHoldTheWholeBody) {
  const SecondOrderModel model = rod(33, {0.1, 0, 0});
  const Dense K = whole(model.K), B = whole(model.B);
  const Groups groups(world(), comm_size(world()));
  const SecondOrderModel mine = move_to_group(model.share(), groups);
  EXPECT_EQ(mine.rows.size(), 33); // every group is one rank
  const Block::Access access(mine.B);
  for (int i = 0; i < 33; ++i) {
    for (int j = 0; j < 2; ++j) EXPECT_EQ(access.column(j)[i], B(i, j));
    PetscInt count = 0;
    const PetscInt* columns = nullptr;
    const PetscScalar* values = nullptr;
    FG_CALL(MatGetRow(mine.K, i, &count, &columns, &values));
    for (PetscInt k = 0; k < count; ++k) EXPECT_EQ(values[k], K(i, columns[k]));
    FG_CALL(MatRestoreRow(mine.K, i, &count, &columns, &values));
  }
}

TEST(Model, PortsAreChosenByNameOrInterface) {
  SecondOrderModel model = rod(10);
  select_ports(model, {"middle"}, {});
  EXPECT_EQ(model.inputs, std::vector<std::string>{"middle.fx"});
  EXPECT_TRUE(model.outputs_are_inputs);
  SecondOrderModel other = rod(10);
  select_ports(other, {"tip.fx"}, {"middle.fx"});
  EXPECT_FALSE(other.outputs_are_inputs);
  EXPECT_EQ(other.C.columns(), 1);
  SecondOrderModel wrong = rod(10);
  try {
    select_ports(wrong, {"tipp"}, {});
    FAIL();
  } catch (const Error& error) {
    EXPECT_NE(std::string(error.what()).find("did you mean tip?"), std::string::npos);
  }
}

TEST(Model, ChecksPassASoundBodyAndCountItsRigidModes) {
  Observer silent(world(), Observer::Level::silent);
  EXPECT_EQ(check_body(rod(40), false, true, {}, silent).rigid_modes, 0);
  SecondOrderModel free = rod(40); // let go of the fixed end
  free.K = sparse(
      40,
      [](PetscInt i, PetscInt j) {
        return i != j ? -1.0 : (i == 0 || i == 39 ? 1.0 : 2.0);
      },
      1);
  EXPECT_EQ(check_body(free, false, true, {}, silent).rigid_modes, 1);
}

TEST(Model, ChecksHandOnTheOrderThatTheyFound) {
  Observer silent(world(), Observer::Level::silent);
  const SecondOrderModel model = rod(400);
  SolverOptions options;
  EXPECT_EQ(check_body(model, false, true, options, silent).order, nullptr); // small
  options.mumps.ordering = Ordering::nested_dissection;
  const BodyFacts facts = check_body(model, false, true, options, silent);
  ASSERT_NE(facts.order, nullptr);
  EXPECT_EQ(facts.order->position.size(), comm_rank(world()) == 0 ? 400U : 0U);
  std::vector<int> sorted = facts.order->position;
  std::sort(sorted.begin(), sorted.end());
  for (std::size_t i = 0; i < sorted.size(); ++i)
    EXPECT_EQ(sorted[i], static_cast<int>(i) + 1);
  EXPECT_EQ(check_body(model, true, false, options, silent).order, nullptr); // no need

  options.order = facts.order;
  ShiftedSolver solver(model.K, model.M, {}, {}, options);
  solver.count_pivots(true);
  solver.factorise({1.0, -0.5 * (rod_eigenvalue(400, 3) + rod_eigenvalue(400, 4))});
  EXPECT_EQ(solver.negative_pivots(), 3);
  EXPECT_EQ(solver.ordering(), "nested dissection");
}

TEST(Model, ALightDofIsNoRigidMode) {
  Observer silent(world(), Observer::Level::silent);
  SecondOrderModel model = rod(40);
  FG_CALL(MatDuplicate(rod(40).K, MAT_COPY_VALUES, model.K.out()));
  model.M = sparse(
      40, [](PetscInt i, PetscInt) { return i == 11 ? 1e-12 : 1.0; }, 0);
  EXPECT_EQ(check_body(model, false, true, {}, silent).rigid_modes, 0);
}

TEST(Model, ChecksRefuseWhatCannotBeReduced) {
  SecondOrderModel negative_mass = rod(20);
  // Diagonal 0.2, neighbours 0.15: eigenvalues 0.2 + 0.3 cos θ, some negative.
  negative_mass.M = sparse(
      20, [](PetscInt i, PetscInt j) { return i == j ? 0.2 : 0.15; }, 1);
  EXPECT_NE(refusal(negative_mass).find("M has"), std::string::npos);

  SecondOrderModel negative_diagonal = rod(20);
  negative_diagonal.M = sparse(
      20, [](PetscInt i, PetscInt) { return i == 7 ? -1.0 : 1.0; }, 0);
  EXPECT_NE(refusal(negative_diagonal).find("M(7, 7)"), std::string::npos);

  SecondOrderModel loose = rod(20); // dof 5 has neither mass nor stiffness
  const auto without = [](PetscInt i, PetscInt j, double value) {
    return i == 5 || j == 5 ? 0.0 : value;
  };
  loose.K = sparse(
      20, [&](PetscInt i, PetscInt j) { return without(i, j, i == j ? 2.0 : -1.0); }, 1);
  loose.M = sparse(
      20, [&](PetscInt i, PetscInt j) { return without(i, j, i == j ? 1.0 : 0.0); }, 1);
  EXPECT_NE(refusal(loose).find("row 5"), std::string::npos);
  for (PetscInt row = loose.rows.begin; row < loose.rows.end; ++row) {
    loose.node.push_back(row / 6);
    loose.label.push_back(100 + row / 6);
    loose.component.push_back(row % 6);
  }
  EXPECT_NE(refusal(loose).find("rz of node 100"), std::string::npos);

  // A massless pair of dofs joined to each other only: K and M share the vector (1, 1).
  SecondOrderModel hinge = rod(20);
  hinge.K = sparse(
      20,
      [](PetscInt i, PetscInt j) {
        if (i >= 18 || j >= 18) return i < 18 || j < 18 ? 0.0 : (i == j ? 1.0 : -1.0);
        return i == j ? 2.0 : -1.0;
      },
      1);
  hinge.M = sparse(
      20, [](PetscInt i, PetscInt) { return i >= 18 ? 0.0 : 1.0; }, 0);
  EXPECT_NE(refusal(hinge).find("null vector"), std::string::npos);

  SecondOrderModel idle = rod(20);
  idle.B =
      block(20, 2, [](PetscInt i, PetscInt j) { return i == 3 && j == 0 ? 1.0 : 0.0; });
  idle.C = idle.B.share();
  EXPECT_NE(refusal(idle).find("middle.fx"), std::string::npos);
}

TEST(Model, ParallelPortsOnlyWarn) {
  Observer silent(world(), Observer::Level::silent);
  SecondOrderModel model = rod(20);
  model.B = block(20, 2, [](PetscInt i, PetscInt j) {
    return i == 3 ? 1.0 + static_cast<double>(j) : 0.0;
  });
  model.C = model.B.share();
  check_body(model, false, true, {}, silent);
  ASSERT_EQ(silent.warnings().size(), 1U);
  EXPECT_NE(silent.warnings()[0].find("tip.fx"), std::string::npos);
}
