/// `certify` from end to end: the modes, the growth, and once more where loose modes hid one
/// that may be rigid.

#include "base/index.hpp"
#include "base/text.hpp"
#include "linalg/orthonormal.hpp"
#include "medium/checkpoint.hpp"
#include "model/band_grid.hpp"
#include "model/rigid_body_modes.hpp"

#include <algorithm>
#include <cmath>

namespace flexgram {

namespace {

/// The medium model without levels, and the frequencies that show the bands.
CertifyState begin(const CertifyRun& run, double omega, bool mass_is_singular,
                   bool exact) {
  CertifyState state;
  state.modal = find_modal_space(run, omega, mass_is_singular, exact);
  const ModalSpace& modal = state.modal;
  Medium& medium = state.medium;
  medium.body = run.fom.head();
  medium.spec = run.spec;
  medium.shortfall = unfinished;
  medium.reference = run.reference;
  medium.tau = run.tau;
  medium.kappa = modal.space->kappa();
  medium.cutoff = modal.cutoff;
  medium.scale = modal.scale;
  medium.rigid = modal.rigid();
  medium.modes = modal.elastic;
  const auto peaks = medium.resonances({ritz_response(run, modal), nullptr});
  state.growth.grid = band_grid(run.spec.bands, 120, peaks);
  share_list(run.fom.comm, state.growth.grid);
  return state;
}

/// Whether a mode that the search left loose, and that was not judged, may be as slow as a
/// rigid one, by its enclosure in the last level.
bool has_unjudged_slow_modes(const CertifyRun& run, const CertifyState& state) {
  const ModalSpace& modal = state.modal;
  const auto enclosed = state.medium.levels.back().certificate->modes();
  int count = 0;
  for (auto k = as_size(modal.rigid()); k < enclosed.largest_mu.size(); ++k)
    count += 1 / enclosed.largest_mu[k] - run.tau <= modal.slow();
  std::vector<double> shared{static_cast<double>(count)};
  share_from_first(run.fom.comm, shared);
  return shared[0] > modal.judged_elastic;
}

/// Whether values of the parameters move modes through the cutoff. Those of the softest body are
/// what the proof counts.
void tell_moved_modes(const CertifyRun& run, const CertifyState& state) {
  const DenseResponse& response = *state.medium.levels.back().response;
  int fewest = state.modal.modes();
  for (const ParameterValues& values : run.spec.values) {
    int below = 0;
    const DenseResponse stiff = response.at(values).stiffened();
    for (double lambda : stiff.lambda())
      below += lambda < state.modal.cutoff * state.modal.cutoff;
    fewest = std::min(fewest, below);
  }
  if (fewest < state.modal.modes())
    run.observer.fact(
        "moved modes",
        text("%d modes are below the cutoff of %.4g Hz with the least values of "
             "the parameters, %d with others: the rest moves through it",
             state.modal.modes(), state.modal.cutoff * hz, fewest));
}

/// What the user reads of a medium model.
void report(const CertifyRun& run, const CertifyState& state) {
  const Medium& medium = state.medium;
  const MediumLevel& level = medium.levels.back();
  const double target = run.spec.target;
  const bool reached = medium.shortfall.empty();
  Observer& observer = run.observer;
  observer.fact(
      "medium model",
      text("order %d, %d factorisations (real), %d solved columns, %d Krylov blocks at "
           "ω_c² after the ports'",
           state.modal.space->columns(), medium.factorisations, medium.solved_columns,
           state.growth.blocks));
  if (run.factors.fell_back())
    observer.fact("fall-back",
                  "refinement of single precision stalled: double precision");
  const RelativeTo relative_to = resolved(run.spec.relative_to, medium);
  const char* const what = relative_to == RelativeTo::elastic ? "H without rigid motion"
                           : relative_to == RelativeTo::both
                               ? "H and of H without rigid motion"
                               : "H";
  // Without rounding, which the claim of the small model includes.
  observer.fact(
      "medium error",
      reached && state.modal.space->columns() >= run.fom.n
          ? std::string("rounding alone: its order is that of the body")
      : reached
          ? text("at most %.0e of %s everywhere in the band%s%s (%.1e at the frequencies "
                 "it grew by)",
                 target, what,
                 medium.has_sharp_resonances() ? " but beside undamped resonances" : "",
                 level.proved ? "" : ", estimated", level.worst)
          : text("%.1e of %s at the frequencies it grew by, target %.0e not reached "
                 "everywhere: %s",
                 level.worst, what, target, medium.shortfall.c_str()));
  tell_moved_modes(run, state);
  observer.skip("complex factorisations", "real shifts span the band");
  if (reached)
    observer.skip("further Krylov blocks", "the bound does not ask for them");
  else
    observer.warn(
        level.worst > target
            ? text("the medium model is good to %.1e only, not to %.0e: %s", level.worst,
                   target, medium.shortfall.c_str())
            : text("the medium model is not known to be good to %.0e everywhere "
                   "in the band: %s",
                   target, medium.shortfall.c_str()));
  if (!level.proved)
    observer.warn(
        !run.fom.terms.empty()
            ? "dampers or terms couple the modes so strongly (q δ >= 1) that the error "
              "is "
              "estimated, not proved; a higher {cutoff} helps"
            : "the modes below the cutoff are not known well enough for a proof: the "
              "error is estimated; a higher {medium_order} helps");
}

/// [rad/s] the certificate must hold up to here. @note Collective.
double reference_of(const SecondOrderModel& fom, const CertifySpec& spec) {
  const double last = std::max(spec.bands.back().last, spec.last_needed);
  return last > 0 ? last : std::sqrt(1e-9 * eigenvalue_scale(fom)); // statics
}

/// K + τM is positive with it. Only a body that may be unstable needs to look.
double stabilising_shift(const SecondOrderModel& fom, RealFactors& factors,
                         double reference) {
  double tau = 0.25 * reference * reference;
  if (!fom.may_be_unstable()) return tau;
  constexpr int most = 40;
  for (int attempt = 0; attempt < most; ++attempt, tau *= 4) {
    factors.hold(tau);
    if (factors.negative() == 0) return tau;
  }
  throw Error(
      "K has negative eigenvalues on dofs without mass: the body is unstable whatever "
      "its gyroscopic forces are");
}

} // namespace

Medium certify(const SecondOrderModel& body, bool mass_is_singular,
               const CertifySpec& spec, const SolverOptions& solver, Observer& observer,
               const CheckpointSpec& checkpoint) {
  Checkpoints checkpoints(body, checkpoint, observer);
  RealFactors factors(body, solver, observer);
  const double reference = reference_of(body, spec);
  const double positive = stabilising_shift(body, factors, reference);
  const Softening softening = softening_of(body, reference, positive, solver);
  const double tau = softening.stabilised(positive);
  const CertifyRun run{body,        spec,      observer, factors,
                       checkpoints, reference, tau,      softening};
  const double needed = std::sqrt(softening.needed_square(reference));
  if (softening.gyration > 0)
    observer.fact(
        "gyroscopic forces",
        text("at most %.4g rad/s of the inertia%s: modes up to %.4g Hz count for a "
             "band up to %.4g Hz",
             softening.gyration,
             softening.mass > 0
                 ? text(", and a spin takes from the stiffness %.4g² of the mass at most",
                        std::sqrt(softening.mass))
                       .c_str()
                 : "",
             needed * hz, reference * hz));
  std::optional<CertifyState> state = checkpoints.resume(run);
  if (!state) {
    state = begin(run, spec.cutoff * needed, mass_is_singular, false);
    checkpoints.save(run, *state, "the modes");
  }
  grow(run, *state);
  if (!state->modal.exact && has_unjudged_slow_modes(run, *state)) {
    observer.fact("slow modes", "one came to light while the space grew: all are found "
                                "again, exactly, and judged");
    const double cutoff = state->modal.cutoff;
    state.reset(); // its memory
    state = begin(run, cutoff, mass_is_singular, true);
    grow(run, *state);
  }
  Medium& medium = state->medium;
  const MediumSpace& space = *state->modal.space;
  medium.factorisations = factors.factorisations();
  medium.solved_columns = factors.solved_columns();
  report(run, *state);
  medium.loss_of_orthogonality = loss_of_orthogonality(space.V(), space.product(), 32);
  medium.printed_rounding = space.printed_rounding();
  medium.V = space.V().share();
  return std::move(medium);
}

} // namespace flexgram
