#include "linalg/shifted_solver.hpp"

#include "base/index.hpp"
#include "base/process.hpp"
#include "base/text.hpp"
#include "linalg/ordering.hpp"
#include "linalg/shifted_engine.hpp"
#include "linalg/sparse.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>
#include <utility>

namespace flexgram {

namespace {

/// Whether a body of this size is ordered by nested dissection, at least for comparison.
bool wants_dissection(const SolverOptions& options, PetscInt n) {
  // A user's own ICNTL(7) is no choice between orderings.
  const Ordering wish =
      options.mumps.icntl.count(7) ? Ordering::mumps : options.mumps.ordering;
  return wish == Ordering::nested_dissection || wish == Ordering::best ||
         (wish == Ordering::automatic && n >= 10000);
}

/// By the nodes, or by rows with the same columns where they are not known.
PivotOrder dissect(MPI_Comm comm, const Pattern& lower, std::vector<Mat> matrices,
                   const std::vector<std::int64_t>& node_of_row) {
  const bool missing = node_of_row.empty() && owned_rows(matrices.front()).size() > 0;
  if (sum_over(comm, static_cast<std::int64_t>(missing)) > 0)
    return nested_dissection(comm, lower, indistinguishable_rows(matrices));
  return nested_dissection(comm, lower, node_of_row);
}

} // namespace

std::shared_ptr<const PivotOrder>
shared_order(Mat K, Mat M, const std::vector<std::int64_t>& node_of_row,
             const SolverOptions& options) {
  PetscInt n = 0;
  FG_CALL(MatGetSize(K, &n, nullptr));
  if (!wants_dissection(options, n)) return nullptr;
  return std::make_shared<const PivotOrder>(
      dissect(PetscObjectComm(reinterpret_cast<PetscObject>(K)),
              common_pattern(K, M, {}).entries, {K, M}, node_of_row));
}

SolverOptions counting(SolverOptions options) {
  options.mumps.cntl.try_emplace(3, 1e-13);
  return options;
}

struct ShiftedSolver::State {
  ShiftedMatrix A;
  SolverOptions options;
  std::vector<std::int64_t> node_of_row;
  MatrixKind kind;
  std::optional<CommonPattern> common; ///< while factorisations may come

  const CommonPattern& pattern() {
    if (!common) common = common_pattern(A.K, A.M, A.terms, kind);
    return *common;
  }

  std::vector<Mat> matrices() const {
    std::vector<Mat> all{A.K, A.M};
    all.insert(all.end(), A.terms.begin(), A.terms.end());
    return all;
  }

  bool ordered = false;
  PivotOrder order;
  std::string ordering;
  /// [real][single]
  std::unique_ptr<Engine> engines[2][2];
  FactorEstimate estimates[2][2];
  Engine* current = nullptr;
  Definiteness definiteness{};
  bool single = false, fell_back = false, count = false;
  int negative = 0, null = 0; ///< pivots of the last factorisation that counted them
  int factorisations = 0;

  std::unique_ptr<Engine> analysed(bool real, bool narrow, FactorEstimate& estimate) {
    auto engine = make_engine(A.comm, real, narrow, options.mumps, kind);
    engine->count_pivots(count && !narrow);
    estimate = engine->analyse(pattern().entries, order);
    return engine;
  }

  /// The ordering asked for, found with the first analysis.
  std::unique_ptr<Engine> order_and_analyse(bool real, bool narrow,
                                            FactorEstimate& estimate) {
    std::unique_ptr<Engine> dissected;
    if (wants_dissection(options, pattern().entries.n)) {
      order = options.order ? *options.order
              : kind == MatrixKind::symmetric
                  ? dissect(A.comm, pattern().entries, matrices(), node_of_row)
                  : dissect(A.comm, common_pattern(A.K, A.M, A.terms).entries, matrices(),
                            node_of_row);
      if (kind == MatrixKind::general) order.block_start.clear();
      dissected = analysed(real, narrow, estimate);
      ordering = "nested dissection";
      if (options.mumps.ordering != Ordering::best) return dissected;
    }
    PivotOrder by_metis = std::exchange(order, {});
    FactorEstimate own_estimate;
    auto own = analysed(real, narrow, own_estimate);
    if (dissected && estimate.flops <= own_estimate.flops) {
      order = std::move(by_metis);
      return dissected;
    }
    estimate = own_estimate;
    ordering = "MUMPS' own choice";
    order = own->order();
    return own;
  }

  Engine& prepare(bool real, bool narrow) {
    auto& slot = engines[real][narrow];
    auto& estimate = estimates[real][narrow];
    if (!slot)
      slot = std::exchange(ordered, true) ? analysed(real, narrow, estimate)
                                          : order_and_analyse(real, narrow, estimate);
    return *slot;
  }

  /// The inertia of a real A, in double and without keeping factors: about a third of
  /// the memory.
  void count_apart() {
    MumpsOptions without_factors = options.mumps;
    without_factors.icntl[31] = 1;
    without_factors.icntl.erase(22);
    give_back_freed_pages();
    {
      const auto engine = make_engine(A.comm, true, false, without_factors, kind);
      engine->count_pivots(true);
      engine->analyse(pattern().entries, order);
      engine->factorise(pattern(), A.coefficients,
                        definiteness != Definiteness::positive);
      negative = engine->negative_pivots();
      null = engine->null_pivots();
      ++factorisations;
    }
    give_back_freed_pages();
  }
};

ShiftedSolver::ShiftedSolver(Mat K, Mat M, std::vector<Mat> terms,
                             std::vector<std::int64_t> node_of_row,
                             const SolverOptions& options, MatrixKind kind)
    : state_(std::make_unique<State>(ShiftedMatrix(K, M, std::move(terms)), options,
                                     std::move(node_of_row), kind)) {
  state_->single = options.precision == Precision::single_precision;
}

ShiftedSolver::~ShiftedSolver() = default;

void ShiftedSolver::use(bool single, bool out_of_core) {
  State& s = *state_;
  s.single = single;
  if (out_of_core) s.options.mumps.icntl.try_emplace(22, 1);
  for (auto& of_kind : s.engines) {
    of_kind[!single].reset();
    if (out_of_core) of_kind[single].reset(); // options are read when MUMPS starts
  }
}

FactorEstimate ShiftedSolver::analyse(bool real) {
  State& s = *state_;
  s.prepare(real, s.single);
  return s.estimates[real][s.single];
}

void ShiftedSolver::factorise(const ShiftCoefficients& coefficients,
                              Definiteness definiteness) {
  stop_if_interrupted();
  State& s = *state_;
  s.A.coefficients = coefficients;
  s.definiteness = definiteness;
  const bool real = coefficients.real(),
             definite = real && definiteness == Definiteness::positive,
             apart = s.count && real && s.single; // single counts nothing
  s.current = &s.prepare(real, s.single);
  if (apart) s.count_apart();
  s.current->count_pivots(s.count && !apart);
  try {
    s.current->factorise(s.pattern(), coefficients, !definite);
  } catch (const ShiftError&) {
    if (!s.single) throw;
    return fall_back(); // singular to single precision only, perhaps
  }
  ++s.factorisations;
  if (!apart && real) {
    s.negative = s.current->negative_pivots();
    s.null = s.current->null_pivots();
  }
}

ShiftedSolver::Solution ShiftedSolver::solve(const Block& b, Verify verify) {
  stop_if_interrupted();
  State& s = *state_;
  const bool real = s.A.coefficients.real();
  const PetscInt p = b.columns();
  Solution solution{Block(s.A.comm, s.A.rows, b.rows(), real ? p : 2 * p), 0.0, 0};
  {
    const Block::Access in(b);
    Block::Access out(solution.x);
    s.current->solve(s.A.rows, in.column(0), nullptr, out.column(0),
                     real ? nullptr : out.column(p), static_cast<int>(p));
  }
  s.A.require_regular(b, solution.x);
  if (verify == Verify::none && real && !s.single) return solution;
  Block r;
  if (verify == Verify::first_column && real && p > 1) {
    const double sample =
        s.A.residual(select_columns(b, {0}), select_columns(solution.x, {0}), r);
    if (sample <= s.options.backward_error) {
      solution.backward_error = sample;
      return solution;
    }
  }
  solution.backward_error = s.A.residual(b, solution.x, r);
  const int limit =
      s.single ? std::max(s.options.refinements, 12) : s.options.refinements;
  while (solution.backward_error > s.options.backward_error &&
         solution.refinements < limit) {
    Block step(s.A.comm, s.A.rows, b.rows(), solution.x.columns());
    {
      const Block::Access in(r);
      Block::Access out(step);
      s.current->solve(s.A.rows, in.column(0), real ? nullptr : in.column(p),
                       out.column(0), real ? nullptr : out.column(p),
                       static_cast<int>(p));
      const Block::Access x(solution.x);
      for (std::size_t i = 0; i < out.all().size(); ++i) out.all()[i] += x.column(0)[i];
    }
    const double error = s.A.residual(b, step, r);
    ++solution.refinements;
    const bool better = error < 0.5 * solution.backward_error;
    if (error < solution.backward_error) {
      std::swap(solution.x, step);
      solution.backward_error = error;
    }
    if (!better) break;
  }
  if (s.single && solution.backward_error > s.options.backward_error) {
    fall_back(); // refinement stalled
    return solve(b);
  }
  if (!(solution.backward_error < 1e-6))
    throw Error(
        text("a solve failed: its backward error is %.1e after %d refinements (try "
             "{mumps_cntl_1} 0.1 for stricter pivoting)",
             solution.backward_error, solution.refinements));
  return solution;
}

int ShiftedSolver::negative_pivots() const { return state_->negative; }
int ShiftedSolver::null_pivots() const { return state_->null; }
void ShiftedSolver::count_pivots(bool count) { state_->count = count; }

/// This and all later shifts in double.
void ShiftedSolver::fall_back() {
  State& s = *state_;
  for (auto& of_kind : s.engines) of_kind[true].reset();
  s.single = false;
  s.fell_back = true;
  factorise(s.A.coefficients, s.definiteness);
}

bool ShiftedSolver::fell_back() const { return state_->fell_back; }
void ShiftedSolver::forget_pattern() { state_->common.reset(); }
const std::string& ShiftedSolver::ordering() const { return state_->ordering; }
int ShiftedSolver::factorisations() const { return state_->factorisations; }

} // namespace flexgram
