/// `certify` from end to end: the modes, the growth, and once more where loose modes hid one
/// that may be rigid.

#include "medium/builder.hpp"

#include "medium/mode_search.hpp"
#include "model/band_grid.hpp"
#include "model/rigid_body_modes.hpp"

#include <algorithm>
#include <cmath>

namespace flexgram {

/// The response to the inputs alone, if outputs are many more: errors are products of what
/// is left of both, and the certificate asks for the directions of the outputs that matter.
Block MediumBuilder::without_many_outputs(Block response) const {
  const int inputs = static_cast<int>(fom_.B.columns()),
            ports = static_cast<int>(loads_.columns());
  int further = 0; // outputs that are no inputs
  for (int j = inputs; j < ports; ++j)
    further += same_as_[static_cast<std::size_t>(j)] == j;
  if (further <= std::max(wide_block, 2 * inputs)) return response;
  std::vector<int> chosen; // and what keeps the ports company
  for (int j = 0; j < response.columns(); ++j)
    if (j < inputs || j >= ports) chosen.push_back(j);
  return select_columns(response, chosen);
}

/// The space with all modes below a cutoff near `omega`. @return false if inertia and
/// search disagree and it is not the last attempt.
bool MediumBuilder::find_the_modes(double omega, bool mass_is_singular, bool last) {
  {
    Stage stage(observer_, "cutoff");
    Block response = start(omega, mass_is_singular);
    scale_ports(response);
    response = without_many_outputs(std::move(response));
    space_ = std::make_unique<MediumSpace>(fom_, medium_.kappa, medium_.tau);
    space_->start_with_rigid_modes(rigid_modes_.share(), rigid_stiffness_, geometric_);
    space_->append(std::move(response), 1e-7);
  }
  try {
    search_modes();
  } catch (const MiscountError&) {
    if (last) throw;
    unscale_ports();
    return false;
  }
  rigid_modes_ = Block();
  return true;
}

/// Whether a mode that the search left loose, and that was not judged, may be as slow as a
/// rigid one, by its enclosure in the last level.
bool MediumBuilder::has_unjudged_slow_modes() const {
  const Certificate::Modes modes = medium_.levels.back().certificate->modes();
  int count = 0;
  for (auto k = static_cast<std::size_t>(medium_.rigid); k < modes.largest_mu.size(); ++k)
    count += 1 / modes.largest_mu[k] - medium_.tau <= slow();
  std::vector<double> shared{static_cast<double>(count)};
  share_from_first(fom_.comm, shared);
  return shared[0] > judged_elastic_;
}

void MediumBuilder::begin_again_with_exact_modes(bool mass_is_singular) {
  observer_.fact("slow modes", "one came to light while the space grew: all are found "
                               "again, exactly, and judged");
  exact_modes_ = true;
  judged_elastic_ = 0;
  medium_.levels.clear();
  image_ = Block();
  blocks_ = 0;
  unscale_ports();
  {
    Stage stage(observer_, "cutoff");
    find_rigid_modes();
  }
  find_all_modes(medium_.cutoff, mass_is_singular);
}

/// The modes below a cutoff at `omega`, or near it if one lies there.
void MediumBuilder::find_all_modes(double omega, bool mass_is_singular) {
  for (int attempt = 1; !find_the_modes(omega, mass_is_singular, attempt == 3); ++attempt)
    omega = 1.0123 * medium_.cutoff; // a mode on the cutoff: beside it
  if (medium_.rigid > 0) refuse_statics_of_a_free_body(spec_.bands.front().first);
  const auto peaks = medium_.resonances({ritz_response(), nullptr});
  grid_ = band_grid(spec_.bands, 120, peaks);
  share_list(fom_.comm, grid_);
}

Medium MediumBuilder::build(bool mass_is_singular) {
  const double first = spec_.bands.front().first, last = spec_.bands.back().last;
  double reference = std::max(last, spec_.last_needed);
  if (reference == 0) reference = std::sqrt(1e-9 * eigenvalue_scale(fom_)); // statics
  medium_.reference = reference;
  medium_.tau = 0.25 * reference * reference;
  if (!resume()) {
    {
      Stage stage(observer_, "cutoff");
      find_rigid_modes();
    }
    if (geometric_ > 0) refuse_statics_of_a_free_body(first);
    find_all_modes(spec_.cutoff * reference, mass_is_singular);
    save("the modes");
  }
  grow();
  if (!exact_modes_ && has_unjudged_slow_modes()) {
    begin_again_with_exact_modes(mass_is_singular);
    grow();
  }
  report();
  medium_.loss_of_orthogonality = loss_of_orthogonality(space_->V(), space_->product());
  medium_.printed_rounding = space_->printed_rounding();
  medium_.V = space_->V().share();
  return std::move(medium_);
}

Medium certify(const SecondOrderModel& body, bool mass_is_singular,
               const CertifySpec& spec, const SolverOptions& solver, Observer& observer,
               const CheckpointSpec& checkpoint) {
  return MediumBuilder(body, spec, solver, observer, checkpoint).build(mass_is_singular);
}

} // namespace flexgram
