#include "model/checks.hpp"

#include "base/index.hpp"
#include "base/text.hpp"
#include "linalg/sparse.hpp"
#include "model/rigid_body_modes.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

namespace flexgram {
namespace {

/// Eigenvalues of the unit-diagonal M below this are no rounding: exports print 14
/// digits.
constexpr double negative_floor = 1e-9;

/// The largest size in each row of this rank, infinity where a number is not finite.
std::vector<double> row_maxima(Mat a) {
  const RowRange rows = owned_rows(a);
  std::vector<double> maxima;
  for (PetscInt row = rows.begin; row < rows.end; ++row) {
    PetscInt count = 0;
    const PetscScalar* values = nullptr;
    FG_CALL(MatGetRow(a, row, &count, nullptr, &values));
    double largest = 0;
    for (PetscInt k = 0; k < count; ++k)
      largest = std::max(largest, std::isfinite(values[k])
                                      ? std::abs(values[k])
                                      : std::numeric_limits<double>::infinity());
    maxima.push_back(largest);
    FG_CALL(MatRestoreRow(a, row, &count, nullptr, &values));
  }
  return maxima;
}

/// Doubles cannot square what is larger.
constexpr double largest_entry = 1e120;

void check_size(const char* name, const std::vector<double>& row_maxima,
                const SecondOrderModel& model) {
  agree(model.comm, [&] {
    for (std::size_t i = 0; i < row_maxima.size(); ++i) {
      const long row = static_cast<long>(model.rows.begin) + static_cast<long>(i);
      if (std::isinf(row_maxima[i]))
        throw Error(
            text("%s has an entry in row %ld (0-based) that is not a finite number", name,
                 row));
      if (row_maxima[i] > largest_entry)
        throw Error(text("%s has an entry of %.0e in row %ld, which doubles cannot "
                         "square: are its units right?",
                         name, row_maxima[i], row));
    }
  });
}

void check_damping(const Damping& damping) {
  const auto check = [](const char* name, double value, const char* unit) {
    if (value > 1e30)
      throw Error(text("%s = %g%s is no damping of a body: are its units right?", name,
                       value, unit));
  };
  check("alpha", damping.alpha, " 1/s");
  check("beta", damping.beta, " s");
  check("eta", damping.eta, "");
}

/// "row 12 (0-based)", and of a body with a dof map ", uz of node 3,".
std::string name_row(const SecondOrderModel& model, std::size_t i) {
  static constexpr const char* directions[6] = {"ux", "uy", "uz", "rx", "ry", "rz"};
  const std::string row = text("row %ld (0-based)", static_cast<long>(model.rows.begin) +
                                                        static_cast<long>(i));
  const std::vector<std::int64_t>& nodes = model.label.empty() ? model.node : model.label;
  if (nodes.empty() || model.component.empty()) return row;
  const auto direction = static_cast<std::size_t>(model.component[i]);
  if (direction >= std::size(directions)) return row;
  return text("%s, %s of node %ld,", row.c_str(), directions[direction],
              static_cast<long>(nodes[i]));
}

/// K and M diagonals and rows: cheap, and they name the row.
void check_rows(const SecondOrderModel& model, BodyFacts& facts) {
  const auto k_rows = row_maxima(model.K), m_rows = row_maxima(model.M);
  const auto k_diagonal = diagonal(model.K), m_diagonal = diagonal(model.M);
  check_size("K", k_rows, model);
  check_size("M", m_rows, model);
  for (const auto& [law, matrix] : model.terms)
    check_size(law.name().c_str(), row_maxima(matrix), model);
  std::int64_t massless = 0;
  agree(model.comm, [&] {
    for (std::size_t i = 0; i < k_rows.size(); ++i) {
      const long row = static_cast<long>(model.rows.begin) + static_cast<long>(i);
      if (k_rows[i] == 0 && m_rows[i] == 0)
        throw Error(
            text("%s is zero in both K and M: remove this dof (ANSYS leaves constrained "
                 "dofs in the matrices) or hold it (a rigid set of nodes on a straight "
                 "line can turn about that line)",
                 name_row(model, i).c_str()));
      const auto check = [&](const char* name, double d, double largest) {
        if (model.may_be_unstable() && name[0] == 'K') return;
        if (d < 0)
          throw Error(
              text("%s(%ld, %ld) = %g is negative: %s must be positive semidefinite",
                   name, row, row, d, name));
        if (d == 0 && largest > 0)
          throw Error(text("%s(%ld, %ld) is zero in a row that is not: %s is indefinite",
                           name, row, row, name));
      };
      check("M", m_diagonal[i], m_rows[i]);
      check("K", k_diagonal[i], k_rows[i]);
      massless += m_rows[i] == 0;
    }
  });
  facts.mass_is_singular = sum_over(model.comm, massless) > 0;
}

void check_semidefinite(Mat a, const char* name, const char* consequence,
                        const SecondOrderModel& model, SolverOptions options,
                        BodyFacts& facts) {
  if (is_diagonal(a)) {
    const auto d = diagonal(a);
    const PetscInt first = owned_rows(a).begin;
    agree(PetscObjectComm(reinterpret_cast<PetscObject>(a)), [&] {
      for (std::size_t i = 0; i < d.size(); ++i)
        if (d[i] < 0) {
          const long row = static_cast<long>(first) + static_cast<long>(i);
          throw Error(
              text("%s(%ld, %ld) = %g is negative: %s must be positive semidefinite, %s",
                   name, row, row, d[i], name, consequence));
        }
    });
    facts.skipped.push_back(text("factorisation of %s: it is diagonal", name));
    return;
  }
  if (!facts.order) facts.order = shared_order(model.K, model.M, model.node, options);
  if (facts.order) // M's directions may be strangers to each other, K's never are
    options.order = std::make_shared<PivotOrder>(PivotOrder{facts.order->position, {}});
  const int negative = count_negative_eigenvalues(a, negative_floor, options);
  if (negative > 0)
    throw Error(text(
        "%s has %d negative eigenvalue%s (scaled to unit diagonal, below %g): "
        "%s must be positive semidefinite, %s",
        name, negative, negative == 1 ? "" : "s", -negative_floor, name, consequence));
}

/// K + τM is positive definite unless K and M share a null vector or one of them is
/// indefinite.
void check_mechanism(ShiftedSolver& solver, double scale) {
  solver.factorise({1.0, 1e-6 * scale});
  if (solver.null_pivots() > 0)
    throw Error(words_of_shared_null_vectors(solver.null_pivots()));
  if (solver.negative_pivots() > 0)
    throw Error(text("K has %d negative eigenvalue%s: it must be positive semidefinite "
                     "(a buckled state, or K and M swapped?) unless D has a skew part, "
                     "gyroscopic forces, that may hold the body",
                     solver.negative_pivots(), solver.negative_pivots() == 1 ? "" : "s"));
}

/// Sylvester: K − s₀M has as many negative eigenvalues as (K, M) has below s₀.
int count_below(ShiftedSolver& solver, double shift) {
  solver.factorise({1.0, -shift});
  return solver.negative_pivots();
}

void check_ports(const Block& ports, const std::vector<std::string>& names,
                 bool are_outputs, Observer& observer) {
  const char* const map = are_outputs ? "C" : "B";
  const Dense gram = inner(ports, ports);
  for (int i = 0; i < gram.rows; ++i) {
    if (!(gram(i, i) > 0))
      throw Error(
          text("port %s: its column of %s is zero", names[as_size(i)].c_str(), map));
    if (gram(i, i) > 1e120)
      throw Error(
          text("port %s: its column of %s is as large as %.0e, which doubles cannot "
               "square: are its units right?",
               names[as_size(i)].c_str(), map, std::sqrt(gram(i, i))));
    for (int j = 0; j < i; ++j)
      if (gram(i, j) * gram(i, j) >= (1 - 1e-14) * gram(i, i) * gram(j, j))
        observer.warn(
            text(are_outputs ? "outputs %s and %s are the same but for a factor: one of "
                               "the two is enough"
                             : "ports %s and %s load the body in the same way: one of "
                               "the two is enough",
                 names[as_size(j)].c_str(), names[as_size(i)].c_str()));
  }
}

} // namespace

BodyFacts check_body(const SecondOrderModel& model, bool assembled, bool stiffness,
                     const SolverOptions& options, Observer& observer) {
  BodyFacts facts;
  check_damping(model.damping);
  check_ports(model.B, model.inputs, false, observer);
  if (!model.outputs_are_inputs) check_ports(model.C, model.outputs, true, observer);
  check_rows(model, facts);
  if (assembled) {
    facts.skipped.emplace_back(
        "definiteness of M and D: assembled here, so by construction");
  } else {
    check_semidefinite(model.M, "M", "a body has no negative mass", model, options,
                       facts);
    for (const auto& [law, matrix] : model.terms)
      if (law.is_semidefinite() && !law.is_skew())
        check_semidefinite(matrix, law.name().c_str(),
                           law.is_viscous() || law.is_structural()
                               ? "a body does not gain energy from its damping"
                               : "which the proof needs",
                           model, options, facts);
  }
  if (!stiffness) return facts;
  SolverOptions ordered = counting(options);
  ordered.order = facts.order;
  ShiftedSolver solver(model.K, model.M, {}, model.node, ordered);
  solver.count_pivots(true);
  const double scale = eigenvalue_scale(model);
  check_mechanism(solver, scale);
  facts.rigid_modes = count_below(solver, rigid_threshold(model));
  return facts;
}

std::string words_of_shared_null_vectors(int count) {
  return text(
      "K and M share %d null vector%s: the body has a mechanism without mass and "
      "stiffness (an unconnected node, a massless hinge, a rigid set of nodes on a line, "
      "hourglasses of elements of reduced integration where a part is one such element "
      "thick: C3D20 instead of C3D20R)",
      count, count == 1 ? "" : "s");
}

} // namespace flexgram
