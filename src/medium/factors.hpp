/// Which factors of K − ω_c²M a body gets: in double precision, in single, or in single on
/// disk, by the memory that the run will take; and the factors that `certify` has at hand.
/// Called by the steps of `certify` and by the verb plan.

#pragma once

#include "base/observer.hpp"
#include "linalg/shifted_solver.hpp"
#include "model/second_order_model.hpp"

#include <optional>

namespace flexgram {

/// A way to keep the factors, and what a rank needs for it.
struct FactorPath {
  const char* name;
  bool single = false, out_of_core = false;
  double factors_mb = 0; ///< in memory
  double peak_mb = 0;    ///< of the whole run, with what the process holds now
  double mumps_mb = 0;   ///< what MUMPS itself expects of a factorisation, and is held to
};

/// @param estimate  of the analysis in double precision.
/// @return estimates: what the process holds now, 1.15 times the factors' entries (fronts),
/// what MUMPS on several ranks expects beside 1.3 times that, and the values handed to MUMPS
/// or the bases after it, whichever is more (14 vectors for each input, eight inputs at
/// least, and nine for each output beside them). Single precision has half the factors.
/// @note Collective.
std::vector<FactorPath> factor_paths(const SecondOrderModel& fom,
                                     const FactorEstimate& estimate);

/// Krylov vectors for each mode that plates of solids took, from the cutoff and from within.
constexpr double from_cutoff = 2.7, from_within = 1.9;

/// Memory of the search of many modes and of what follows, at most at a time [MB]: `columns` Krylov
/// vectors of so many rows.
double memory_of_modes(PetscInt rows, double columns);

/// Warns where that is more than the limit; 0: there is none.
void warn_of_memory(double needed_mb, double limit_mb, Observer& observer);

/// Analyses, takes the first path that fits into the memory limit (with a warning, if none does,
/// the last, or the first if that takes as much; the user's -mor_precision limits the choice), makes
/// the solver follow it, and tells.
/// @param every  tell all paths, not only the one taken.
/// @return the estimate of the analysis, in double precision.
/// @note Collective.
FactorEstimate choose_factors(ShiftedSolver& solver, const SecondOrderModel& fom,
                              const SolverOptions& options, Observer& observer,
                              bool every);

/// The factors of K + sM, with its inertia, for one shift s at a time.
class RealFactors {
public:
  RealFactors(const SecondOrderModel& fom, const SolverOptions& options,
              Observer& observer);

  bool holds(double s) const { return shift_ == s; }
  /// K + sM, if it is not what is at hand. The first time the arithmetic is chosen.
  /// Collective.
  void hold(double s);
  /// (K + sM)⁻¹ b. @throws ShiftError if K + sM must be taken as singular. Collective.
  Block solve(const Block& b, ShiftedSolver::Verify verify = ShiftedSolver::Verify::all);
  /// Eigenvalues of K + sM below zero, and those that are zero.
  int negative() const { return solver_.negative_pivots(); }
  int null() const { return solver_.null_pivots(); }

  /// Of a factorisation, once there was one.
  const FactorEstimate& estimate() const { return estimate_; }

  /// What was done, with what a run had done whose checkpoint goes on.
  int factorisations() const { return factorisations_before_ + solver_.factorisations(); }
  int solved_columns() const { return solved_columns_; }
  void count_from(int factorisations, int solved_columns);
  bool fell_back() const { return solver_.fell_back(); }
  double memory_limit_mb() const { return options_.mumps.memory_limit_mb; }

private:
  const SecondOrderModel& fom_;
  Observer& observer_;
  SolverOptions options_;
  ShiftedSolver solver_;
  std::optional<double> shift_;
  FactorEstimate estimate_;
  bool chosen_ = false; ///< the arithmetic
  int factorisations_before_ = 0, solved_columns_ = 0;
};

} // namespace flexgram
