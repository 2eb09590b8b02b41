#include "medium/factors.hpp"

#include "base/process.hpp"
#include "base/text.hpp"
#include "medium/space.hpp"

#include <algorithm>
#include <string>

namespace flexgram {

double memory_of_modes(PetscInt rows, double columns) {
  constexpr double copies = 2.6; // of what Lanczos has: what it needs, what the residuals
                                 // are made of, their images
  return copies * columns * 8e-6 * static_cast<double>(rows);
}

std::vector<FactorPath> factor_paths(const SecondOrderModel& fom,
                                     const FactorEstimate& estimate) {
  give_back_freed_pages(); // of the ordering
  const double ranks = comm_size(fom.comm),
               now = max_over(fom.comm, resident_memory_mb()),
               entries = 1.15e-6 * estimate.factor_entries / ranks,
               ports = std::max<double>(8, static_cast<double>(fom.B.columns())),
               further = static_cast<double>(fom.further_outputs()),
               bases = 8e-6 * static_cast<double>(fom.n) / ranks *
                       (14 * ports + 9 * further + 6),
               // Of the lower triangle: handed to MUMPS, and its own copy.
      values = 0.5 * 16e-6 * static_cast<double>(fom.nonzeros()) / ranks,
               rest = now + std::max(bases, values);
  const double mumps = estimate.mb_per_rank;
  const auto path = [&](const char* name, bool single, bool on_disk, double bytes,
                        double own) {
    const double factors = bytes * entries;
    // Several ranks: fronts that they share, and what they send.
    const double beside = std::max(0.0, own - 1.3 * factors);
    return FactorPath{name, single, on_disk, factors, rest + factors + beside, own};
  };
  return {path("double precision", false, false, 8, mumps),
          path("single precision, refined", true, false, 4, mumps / 2),
          path("single precision on disk", true, true, 1, 0)};
}

void warn_of_memory(double needed_mb, double limit_mb, Observer& observer) {
  if (limit_mb > 0 && needed_mb > limit_mb)
    observer.warn(text("the run may take %.0f MB on a rank, and %.0f MB may be used "
                       "({memory_limit_mb}): more ranks share it",
                       needed_mb, limit_mb));
}

FactorEstimate choose_factors(ShiftedSolver& solver, const SecondOrderModel& fom,
                              const SolverOptions& options, Observer& observer,
                              bool every) {
  FactorEstimate estimate = solver.analyse(true);
  if (options.precision == Precision::single_precision) estimate.mb_per_rank *= 2;
  std::vector<FactorPath> paths = factor_paths(fom, estimate);
  if (options.precision == Precision::single_precision)
    paths.erase(paths.begin());
  else if (options.precision == Precision::double_precision)
    paths.resize(1);
  const double limit = options.mumps.memory_limit_mb;
  auto taken = std::find_if(paths.begin(), paths.end(), [&](const FactorPath& path) {
    return limit == 0 || std::max(path.peak_mb, path.mumps_mb) <= limit;
  });
  const bool fits = taken != paths.end();
  if (!fits) // the last, unless that saves nothing that counts
    taken = paths.back().peak_mb < 0.9 * paths.front().peak_mb ? paths.end() - 1
                                                               : paths.begin();
  solver.use(taken->single, taken->out_of_core);

  observer.fact(
      "factors",
      text("of K - ω_c²M, %s: %.2g entries, %.2g flops, %.0f MB on a rank, ordered "
           "by %s; the run about %.0f MB",
           taken->name, estimate.factor_entries, estimate.flops, taken->factors_mb,
           solver.ordering().c_str(), taken->peak_mb));
  for (const FactorPath& path : paths)
    if (every && &path != &*taken)
      observer.fact("or", text("%s: %.0f MB on a rank; the run about %.0f MB", path.name,
                               path.factors_mb, path.peak_mb));
  if (every) // before the first factorisation
    observer.fact(
        "many modes",
        text("if hundreds of natural frequencies lie below the end of the band, about "
             "%.2g MB more on a rank for each; the first factorisation counts them",
             memory_of_modes(fom.rows.size(), from_cutoff)));
  const double ports = static_cast<double>(fom.B.columns() + fom.further_outputs());
  if (ports > wide_block)
    observer.fact("solves",
                  text("for %.0f ports about %.0f right-hand sides of %.2g flops: "
                       "as much as %.1f factorisations, dense work beside them",
                       ports, 2 * ports, 4 * estimate.factor_entries,
                       8 * ports * estimate.factor_entries / estimate.flops));
  if (taken->single)
    observer.fact("inertia", "by a factorisation in double that keeps no factors");
  if (taken != paths.begin())
    observer.skip("factors in " + std::string(paths.front().name),
                  text("the run would take about %.0f MB on a rank, %.0f MB may be used "
                       "({memory_limit_mb})",
                       paths.front().peak_mb, limit));
  if (taken->out_of_core)
    observer.warn(
        "the factors go to disk ({mumps_icntl_22} 1, folder MUMPS_OOC_TMPDIR or "
        "/tmp): each solve reads them; more ranks would hold them in memory");
  if (!fits) warn_of_memory(taken->peak_mb, limit, observer);
  observer.print(); // before the first factorisation, which may take long
  return estimate;
}

RealFactors::RealFactors(const SecondOrderModel& fom, const SolverOptions& options,
                         Observer& observer)
    : fom_(fom), observer_(observer), options_(counting(options)),
      solver_(fom.K, fom.M, {}, fom.node, options_) {
  solver_.count_pivots(true);
}

void RealFactors::hold(double s) {
  if (holds(s)) return;
  if (!chosen_) estimate_ = choose_factors(solver_, fom_, options_, observer_, false);
  chosen_ = true;
  shift_.reset(); // until it is there
  solver_.factorise({1.0, s});
  solver_.forget_pattern();
  shift_ = s;
}

Block RealFactors::solve(const Block& b, ShiftedSolver::Verify verify) {
  Block x = solver_.solve(b, verify).x;
  solved_columns_ += static_cast<int>(b.columns());
  return x;
}

void RealFactors::count_from(int factorisations, int solved_columns) {
  factorisations_before_ = factorisations;
  solved_columns_ = solved_columns;
}

} // namespace flexgram
