/// Checkpoints of `certify`: what is kept, when, and whether it is of this body.

#include "medium/builder.hpp"

#include "base/process.hpp"
#include "base/text.hpp"
#include "medium/checkpoint.hpp"
#include "medium/mode_search.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>

namespace flexgram {

/// Whether V is of this body: what it makes of K, D and the ports now against what it
/// made of them then, up to rounding of each entry; norms alone would not see a load that
/// moved to another node.
void MediumBuilder::expect_same_projection(const CheckpointState& state) const {
  const auto& g = space_->rounding_weights();
  double worst = loss_of_orthogonality(space_->V(), space_->product()) / 1e-9;
  const auto compare = [&](const Dense& here, const Dense& there, auto&& allowed) {
    if (here.rows != there.rows || here.columns != there.columns) worst = HUGE_VAL;
    for (int j = 0; j < here.columns && worst < HUGE_VAL; ++j)
      for (int i = 0; i < here.rows; ++i)
        worst = std::max(worst, std::abs(here(i, j) - there(i, j)) / allowed(i, j));
  };
  const double rounding = 1e3 * space_->rounding();
  compare(space_->K(), state.K, [&](int i, int j) {
    return rounding * g[static_cast<std::size_t>(i)] * g[static_cast<std::size_t>(j)] +
           1e-12 * medium_.cutoff * medium_.cutoff;
  });
  const double size_D = frobenius_norm(state.D);
  compare(space_->D(), state.D, [&](int, int) { return 1e-9 * size_D + 1e-300; });
  const Dense ports = inner(space_->V(), loads_);
  const double size = frobenius_norm(ports);
  compare(ports, state.ports, [&](int, int) { return 1e-9 * size + 1e-300; });
  int below = 0;
  const RitzPairs pairs = ritz_pairs(*space_);
  for (double l : pairs.lambda) below += l < medium_.cutoff * medium_.cutoff;
  if (!(max_over(fom_.comm, worst) <= 1) || below != medium_.modes)
    throw Error(text("{restart}: the checkpoint %s is of another body, or damaged: what "
                     "its basis makes of K, D and the ports differs; remove it to start "
                     "afresh",
                     checkpoint_.path.c_str()));
}

/// Takes up what a checkpoint holds. @return false if there is none, or it is not wanted.
bool MediumBuilder::resume() {
  if (!checkpoint_.restart || checkpoint_.path.empty()) return false;
  Stage stage(observer_, "restart");
  Medium kept;
  auto state = read_checkpoint(fom_, spec_, checkpoint_.path, kept);
  if (!state) {
    observer_.fact("restart", text("there is no checkpoint %s: from the beginning",
                                   checkpoint_.path.c_str()));
    return false;
  }
  *checkpoint_.used = true;
  medium_ = std::move(kept);
  medium_.body = fom_.head();
  medium_.spec = spec_;
  medium_.shortfall = unfinished;
  expected_ = medium_.modes;
  geometric_ = state->geometric;
  blocks_ = state->blocks;
  factorisations_before_ = medium_.factorisations;
  inertia_is_safe_ = state->inertia_is_safe;
  judged_elastic_ = state->judged_elastic;
  exact_modes_ = state->exact_modes;
  grid_ = std::move(state->grid);
  least_eigenvalue_ = state->least_eigenvalue;
  of_rounding_ = state->of_rounding;
  image_ = std::move(state->image);
  scale_columns(loads_, medium_.scale);
  const int rigid = medium_.rigid, all = static_cast<int>(state->V.columns());
  std::vector<int> first(static_cast<std::size_t>(rigid)),
      rest(static_cast<std::size_t>(all - rigid));
  std::iota(first.begin(), first.end(), 0);
  std::iota(rest.begin(), rest.end(), rigid);
  const Block V = std::move(state->V).block();
  space_ = std::make_unique<MediumSpace>(fom_, medium_.kappa, medium_.tau);
  space_->start_with_rigid_modes(select_columns(V, first),
                                 std::move(state->rigid_stiffness), state->geometric);
  space_->restore(select_columns(V, rest));
  expect_same_projection(*state);
  observer_.fact("restart",
                 text("from %s: %d rigid and %d elastic modes below %.4g Hz, order %d, "
                      "%zu levels certified",
                      checkpoint_.path.c_str(), rigid, medium_.modes, medium_.cutoff * hz,
                      all, medium_.levels.size()));
  return true;
}

CheckpointState MediumBuilder::state() const {
  CheckpointState state;
  const int rigid = space_->rigid();
  state.rigid_stiffness =
      rigid > 0 ? part_of(space_->rigid_stiffness(), 0, rigid, 0, rigid) : Dense(0, 0);
  state.geometric = geometric_;
  state.blocks = blocks_;
  state.inertia_is_safe = inertia_is_safe_;
  state.judged_elastic = judged_elastic_;
  state.exact_modes = exact_modes_;
  state.grid = grid_;
  state.least_eigenvalue = least_eigenvalue_;
  state.of_rounding = of_rounding_;
  state.K = space_->K();
  state.D = space_->D();
  state.ports = inner(space_->V(), loads_);
  state.V = space_->V().share();
  if (image_) state.image = image_.share();
  return state;
}

/// Writes a checkpoint if it is time for one, and ends the run if it is asked to.
void MediumBuilder::save(const char* what) {
  if (checkpoint_.path.empty()) return;
  count_factorisations();
  using When = CheckpointSpec::When;
  const bool end = max_over(fom_.comm, asked_to_end() ? 1.0 : 0.0) > 0;
  const bool late = max_over(fom_.comm, now() - start_) > 20;
  bool saved = false;
  if (checkpoint_.when == When::always ||
      (checkpoint_.when == When::automatic && (late || end))) {
    Stage stage(observer_, "checkpoint");
    try {
      write_checkpoint(medium_, state(), fom_, checkpoint_.path);
      saved = *checkpoint_.used = true;
      observer_.detail(text("  checkpoint after %s: %s", what, checkpoint_.path.c_str()));
    } catch (const Error& error) { // on all ranks
      if (checkpoint_.when == When::always) throw;
      observer_.warn(text("no checkpoint: %s", error.what()));
    }
  }
  if (end)
    throw Interrupted(
        saved ? text("ended by SIGTERM after %s; {restart} goes on from %s", what,
                     checkpoint_.path.c_str())
              : text("ended by SIGTERM after %s, without a checkpoint", what));
}

/// Where nothing could be saved.
void MediumBuilder::end_if_asked(const char* what) const {
  if (!checkpoint_.path.empty() && max_over(fom_.comm, asked_to_end() ? 1.0 : 0.0) > 0)
    throw Interrupted(text("ended by SIGTERM before %s was done: there was nothing to "
                           "keep yet",
                           what));
}

} // namespace flexgram
