#pragma once

#include "base/plan.hpp"
#include "model/reduced_io.hpp"
#include "reduce/gramian_basis.hpp"
#include "reduce/medium_model.hpp"

namespace flexgram {

/// Options of the methods that go through the medium model.
struct TwoStepOptions {
  std::string second_stage = "auto";
  std::string frame = "auto", frame_interface;
  std::vector<double> weight, shifts_hz, error_hz;
  int moments = 2;
  MediumOptions medium;

  void describe(Options& options);
  void check() const;
};

/// Reduction in two steps (Fehr, Eberhard, Lehner, section 2.3, with real shifts and a
/// proof): a medium model by rational Krylov, certified over the band; then a small one
/// out of it, by the position Gramian or another second stage, at the smallest order
/// whose certified error meets the tolerance.
/// @param[in] method  two_step (the second stage by options), or the second stage itself:
/// krylov,
///                    modal, craig_bampton, irka, balanced.
/// @throws Error if the tolerance cannot be met, with the reason.
/// @note Collective on fom.comm. Two real factorisations.
ReducedModel reduce_two_step(const SecondOrderModel& fom, const std::string& method,
                             const GramianOptions& gramian, const TwoStepOptions& options,
                             const SolverOptions& solver, bool mass_is_singular,
                             Plan& plan, Monitor& monitor);

} // namespace flexgram
