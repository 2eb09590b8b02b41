#include "medium/growth.hpp"

#include "base/process.hpp"
#include "base/text.hpp"
#include "medium/checkpoint.hpp"
#include "medium/growth_directions.hpp"
#include "medium/level_certifier.hpp"

#include <algorithm>
#include <cmath>
#include <map>

namespace flexgram {

namespace {

/// How many columns a level is grown by. Terms leave many more residuals than there are ports, few
/// of which matter: a wider block saves levels, and costs vectors that the last one would have done
/// without.
int narrow_block(const CertifyRun& run, const ModalSpace& modal) {
  const int ports = static_cast<int>(modal.scale.size());
  return run.fom.terms.empty() ? 3 * ports : std::max(ports, std::min(3 * ports, 6));
}

/// A wide block brings more than is needed: it is cut to the directions that matter, as long as
/// that helps.
class BlockCut {
public:
  /// Of the block that a new level leaves, the part to grow by.
  Block operator()(const CertifyRun& run, const ModalSpace& modal,
                   const std::vector<double>& grid, const LevelCertifier::Parts& of,
                   LevelJudge& judge, const Basis& images) {
    if (was_cut_ && of.worst > 0.5 * worst_before_) helps_ = false;
    worst_before_ = of.worst;
    return part(run, modal, grid, of, of.worst, judge, images);
  }

  /// The same of a level that was judged again, with another largest bound.
  Block part(const CertifyRun& run, const ModalSpace& modal,
             const std::vector<double>& grid, const LevelCertifier::Parts& of,
             double worst, LevelJudge& judge, const Basis& images) {
    const int columns = static_cast<int>(images.columns());
    const int wide = run.fom.terms.empty() ? wide_block : narrow_block(run, modal);
    was_cut_ =
        helps_ && of.residuals.complete && columns > wide && worst > run.spec.target;
    if (columns == 0) return Block();
    if (!was_cut_) return combine(images, identity(columns));
    std::vector<double> samples = of.samples;
    samples.push_back(of.worst_omega);
    for (std::size_t l = grid.size(); l-- > 0 && grid.size() - l <= 8;)
      samples.push_back(grid[l]); // where it was found to be weak
    const MediumModel& level = judge.model();
    Dense chosen = directions_to_grow(
        of.residuals, of.norm.gram, of.response->at(judge.worst_values()), samples,
        level.blocks(), modal.scale, modal.space->kappa(), modal.cutoff, modal.modes(),
        level.left_out(), 0.3 * run.spec.target);
    share_list(run.fom.comm, chosen.data);
    chosen.columns = static_cast<int>(chosen.data.size()) / std::max(chosen.rows, 1);
    return combine(images, chosen);
  }

private:
  bool helps_ = true, was_cut_ = false;
  double worst_before_ = 0;
};

/// Whether vectors no longer lower the bound: terms that stiffen a part many times over need many
/// of them to halve it.
class Stall {
public:
  explicit Stall(std::size_t ports) : enough_(12 * static_cast<int>(ports)) {}
  /// @param values  of the parameters, with which the bound is that.
  void count(double worst, int order, const ParameterValues& values) {
    double& halved = halved_.try_emplace(values, HUGE_VAL).first->second;
    if (worst > 0.5 * halved) {
      ++times_;
    } else {
      times_ = 0;
      halved = worst;
      from_ = order;
    }
    order_ = order;
  }
  bool has_come() const { return times_ >= 4 && order_ - from_ >= enough_; }

private:
  std::map<ParameterValues, double>
      halved_; ///< the last bound that was half of the one before
  int times_ = 0, order_ = 0, from_ = 0, enough_; ///< orders now and when it was halved
};

} // namespace

void grow(const CertifyRun& run, CertifyState& state) {
  ModalSpace& modal = state.modal;
  Medium& medium = state.medium;
  Growth& growth = state.growth;
  MediumSpace& space = *modal.space;
  auto& levels = medium.levels;
  const auto is_certified = [&] {
    return !levels.empty() && levels.back().order() == space.columns();
  };
  if (!is_certified()) hold_cutoff(run, modal); // else it may not be needed
  Stage stage(run.observer, "krylov");
  const int limit = run.largest_order();
  const double target = run.spec.target;
  LevelJudge judge(run.fom, medium, growth.grid);
  LevelCertifier certifier(run, modal, medium, judge);
  BlockCut cut;
  Stall stall(modal.scale.size());
  const auto prove = [&](int most) {
    growth.image = Block();
    certifier.prove(growth.bounds, growth.grid, most);
    growth.image =
        cut(run, modal, growth.grid, certifier.parts(), judge, certifier.images());
  };
  // A vector brings its mass, what rounding leaves of its solve, and a column of each term.
  const auto all_residuals = [&] {
    return (3 + static_cast<int>(run.fom.terms.size())) * space.columns();
  };
  for (std::size_t k = 0; k < levels.size();
       ++k) { // of a checkpoint, by what is asked now
    judge.judge(k, levels[k]);
    if (k + 1 < levels.size())
      stall.count(levels[k].worst, levels[k].order(), judge.worst_values());
  }
  double told = now();
  for (;;) {
    if (!is_certified()) {
      prove(narrow_block(run, modal));
      if (!levels.back().complete && levels.back().worst <= target)
        prove(all_residuals());
      run.checkpoints.save(run, state, "a level");
    }
    MediumLevel& level = levels.back();
    const std::string line =
        text("  krylov: order %d, certified %.2e of %.0e, modes within %.0e",
             space.columns(), level.worst, target, level.certificate->worst_angle());
    if (now() - told > 2.0)
      run.observer.say(line);
    else
      run.observer.detail(line);
    told = now();
    // Modes that are not exact enough for the proof gain from a block; strong dampers do
    // not.
    if (level.serves(target)) {
      // Between the frequencies of the grid; a space that is the whole body has none.
      Progress progress(run.observer, "proof between frequencies, per cent:", 100);
      int reached = 0;
      const auto tell = [&](double share) {
        const int percent = static_cast<int>(100 * share);
        if (percent > reached) progress.reach(reached = percent, "");
      };
      const std::optional<double> weak =
          space.columns() < run.fom.n ? judge.weak_spot(tell) : std::nullopt;
      if (!weak) {
        certifier.sharpen_between();
        medium.shortfall.clear();
        return;
      }
      growth.grid.push_back(*weak);
      judge.judge_again(level);
      if (certifier.parts().response) // else of a checkpoint, which holds the whole block
        growth.image = cut.part(run, modal, growth.grid, certifier.parts(), level.worst,
                                judge, certifier.images());
    }
    stall.count(level.worst, level.order(), judge.worst_values());
    if (stall.has_come()) {
      medium.shortfall = "more vectors do not lower the bound";
      break;
    }
    if (!growth.image ||
        std::min<PetscInt>(run.fom.n, space.columns() + growth.image.columns()) > limit) {
      medium.shortfall =
          text("the largest order of the medium model, %d, is reached (%s)", limit,
               run.why_no_larger().c_str());
      break;
    }
    const int before = space.columns();
    space.append(std::move(growth.image), 1e-7);
    if (space.columns() == before) {
      medium.shortfall = "the solves add nothing new to the space";
      break;
    }
    ++growth.blocks;
  }
  if (!levels.back().complete) prove(all_residuals());
  certifier.sharpen_if_needed();
  if (medium.spec.values.size() > 1) judge.judge_again(levels.back(), true);
}

} // namespace flexgram
