#include "basis/cut.hpp"

#include "base/index.hpp"
#include "base/text.hpp"
#include "basis/claims.hpp"
#include "basis/held.hpp"
#include "basis/order_choice.hpp"
#include "basis/tangent_frame.hpp"
#include "basis/tell.hpp"
#include "linalg/decompositions.hpp"
#include "medium/error_between.hpp"
#include "model/project.hpp"

#include <algorithm>
#include <cmath>

namespace flexgram {
std::vector<std::string> automatic_methods(const OrderSpec& order) {
  // Measured over seven bodies and tolerances from 1e-2 to 1e-8 (README, "Order over
  // tolerance"), none of the others is ever smaller than the better of these two.
  if (order.tolerance || order.order > 0) return {"gramian", "weighted"};
  return {"gramian"};
}

std::vector<double> default_shifts(const std::vector<Interval>& bands) {
  const double first = bands.front().first, last = bands.back().last;
  if (first == last) return {first};
  return {first, 0.5 * (first + last), last};
}

double medium_target(const OrderSpec& order) {
  return order.tolerance ? 0.02 * order.smallest() : 1e-8;
}

namespace {

/// One call of cut, with what its steps share.
class Cut {
public:
  Cut(const Medium& medium, const CutRequest& request, Observer& observer);
  ReducedModel run();

private:
  void check() const;
  /// What the medium model must be good to.
  double target() const {
    return request_.medium_target > 0 ? request_.medium_target
                                      : medium_target(request_.order);
  }
  std::shared_ptr<MediumOverBand> seen(std::size_t level,
                                       const ParameterValues& values) const;
  std::vector<ErrorOverBox::Sight> sights(std::size_t level) const;
  std::vector<ErrorOverBox::Sight> first_that_serves();
  std::vector<BandWeight> weights() const;
  std::vector<const MediumModel*> others() const;
  const char* not_between() const;
  OrderSpec with_room(OrderSpec order) const;
  void choose(const std::vector<std::string>& names);
  bool add_weak_values();
  void prove_between(const Dense& Q, const ErrorOverBox::Supremum& sup, BandClaim& claim);
  std::vector<double> error_grid(const MediumModel& model) const;
  Dense gram() const;
  double smallest_tolerance() const {
    return request_.order.tolerance ? request_.order.smallest() : 0.0;
  }
  double limit_of(std::size_t view) const;
  BandClaim claim_of(const ErrorOverBox::Supremum& sup, const DenseSystem& small);
  DenseSystem::Modal chosen_model();
  ReducedModel reduced(const Dense& Q, const DenseSystem& small,
                       const ErrorOverBox::Supremum& sup);

  const Medium& whole_;
  const CutRequest& request_;
  Observer& observer_;
  MPI_Comm comm_;
  std::vector<Interval> bands_;
  std::vector<double> shifts_;
  PortSelection ports_;
  std::size_t level_ = 0;                   ///< that serves
  std::vector<ErrorOverBox::Sight> sights_; ///< with each of the parameters' values
  /// Largest error of H as a whole that was seen between these values, on a grid.
  std::optional<double> between_;
  MediumOverBand& seen_; ///< with those that the body has
  const MediumModel& medium_;
  std::unique_ptr<SecondStage> stage_;
  ErrorOverBox errors_;
  OrderChoice choice_;
  FrameKind frame_ = FrameKind::none;
  std::string frame_interface_;
};

Cut::Cut(const Medium& medium, const CutRequest& request, Observer& observer)
    : whole_(medium), request_(request), observer_(observer), comm_(medium.body.comm),
      bands_(request.bands.empty() ? medium.spec.bands : request.bands),
      shifts_(request.shifts.empty() ? default_shifts(bands_) : request.shifts),
      ports_(find_ports(medium.body, request.inputs, request.outputs)),
      sights_(first_that_serves()), seen_(*sights_.front().seen), medium_(seen_.model()),
      errors_(sights_, request.relative_to) {}

/// What the medium model must hold for the request.
void Cut::check() const {
  const double reach = whole_.reference * (1 + 1e-12);
  if (bands_.back().last > reach)
    throw Error(text("the medium model is certified up to %g Hz, the band ends at %g Hz: "
                     "certify it again with {band_hz} as wide",
                     whole_.reference * hz, bands_.back().last * hz));
  const Demand asked = demand_of(request_.methods, request_.order.order, shifts_);
  if (asked.last_needed > reach)
    throw Error(text("%s expands at %g Hz, the medium model is certified up to %g Hz: "
                     "certify it again with {shifts_hz}",
                     join(request_.methods).c_str(), asked.last_needed * hz,
                     whole_.reference * hz));
  if (asked.modes > whole_.rigid + whole_.modes)
    throw Error(text("%s of order %d: the medium model knows the %d modes below %g Hz; "
                     "certify it again with {order} or a higher {cutoff}",
                     join(request_.methods).c_str(), asked.modes,
                     whole_.rigid + whole_.modes, whole_.cutoff * hz));
  if (whole_.rigid > 0) refuse_statics_of_a_free_body(bands_.front().first);
}

/// The level restricted to the ports, bands and kinds of this request; kept in the medium model.
std::shared_ptr<MediumOverBand> Cut::seen(std::size_t level,
                                          const ParameterValues& values) const {
  const KindSpec kinds = request_.order.kinds();
  const double enough = std::min(target(), whole_.spec.target),
               negligible = negligible_rounding(target());
  return whole_.seen->find_or(
      {level, ports_, kinds,
       request_.relative_to == RelativeTo::band ? RelativeTo::pointwise
                                                : request_.relative_to,
       bands_, request_.error_omega, enough, values, negligible},
      [&] {
        MediumModel model(whole_, level, ports_, kinds, request_.relative_to, enough,
                          values, negligible);
        model.follow_dampers();
        std::vector<double> peaks; // decisions about intervals must not differ
        for (const auto& [omega, half_width] : model.resonances)
          peaks.insert(peaks.end(), {omega, half_width});
        share_list(comm_, peaks);
        model.resonances.clear();
        for (std::size_t i = 0; i + 1 < peaks.size(); i += 2)
          model.resonances.push_back({peaks[i], peaks[i + 1]});
        std::vector<double> grid = error_grid(model);
        return std::make_shared<MediumOverBand>(std::move(model), bands_,
                                                std::move(grid));
      });
}

/// With all values of the parameters.
std::vector<ErrorOverBox::Sight> Cut::sights(std::size_t level) const {
  if (whole_.spec.values.empty()) return {{{}, seen(level, {})}};
  std::vector<ErrorOverBox::Sight> all;
  for (const ParameterValues& values : whole_.spec.values)
    all.push_back({values, seen(level, values)});
  return all;
}

/// The first level that meets the target: for all ports and bands the one that the growth
/// for this target would have ended with.
std::vector<ErrorOverBox::Sight> Cut::first_that_serves() {
  check();
  const std::size_t last = whole_.levels.size() - 1;
  for (std::size_t k = 0; k < last && target() > whole_.spec.target; ++k) {
    if (!whole_.levels[k].serves(target())) continue;
    auto here = sights(k);
    const bool is_weak =
        std::any_of(here.begin(), here.end(), [&](const ErrorOverBox::Sight& sight) {
          std::vector<double> spot{ErrorOverBand(*sight.seen, request_.relative_to)
                                       .weak_spot(target())
                                       .value_or(-1.0)};
          share_from_first(comm_, spot);
          return spot[0] >= 0;
        });
    level_ = k;
    if (!is_weak) return here;
  }
  level_ = last;
  return sights(last);
}

std::vector<BandWeight> Cut::weights() const {
  if (!request_.weight.omega.empty()) return {request_.weight};
  std::vector<BandWeight> result;
  for (const Interval& band : bands_)
    result.push_back(BandWeight::flat(band.first, band.last));
  return result;
}

/// With other values of the parameters than those that the body has.
std::vector<const MediumModel*> Cut::others() const {
  std::vector<const MediumModel*> models;
  for (std::size_t k = 1; k < sights_.size(); ++k)
    models.push_back(&sights_[k].seen->model());
  return models;
}

/// Why a claim for all values of the parameters is not tried; null: it is.
const char* Cut::not_between() const {
  if (resolved(request_.relative_to, whole_) != RelativeTo::pointwise)
    return "it is of errors relative to |H| at each frequency";
  if (!medium_.outputs().is_plain())
    return "outputs hold more than displacements of the model";
  return nullptr;
}

/// What is asked for, with room for errors between the values of parameters: the bound of them is
/// larger than the error.
OrderSpec Cut::with_room(OrderSpec order) const {
  constexpr double room = 0.8;
  if (sights_.size() == 1 || !order.tolerance || not_between()) return order;
  *order.tolerance *= room;
  for (auto& [kind, tolerance] : order.of_kinds) tolerance *= room;
  return order;
}

/// Rank 0's choice: the last bit of an error may differ between ranks.
void Cut::choose(const std::vector<std::string>& names) {
  choice_ = choose_order(names, *stage_, errors_, with_room(request_.order));
  if (sights_.size() > 1 && request_.order.tolerance && !not_between()) {
    std::vector<double> falls_short{choice_.shortfall.empty() ? 0.0 : 1.0};
    share_from_first(comm_, falls_short);
    if (falls_short[0] > 0)
      choice_ = choose_order(names, *stage_, errors_, request_.order);
    else
      choice_.chosen_by = text("{tol} %g", smallest_tolerance());
  }
  std::vector<double> shared{static_cast<double>(choice_.best),
                             static_cast<double>(choice_.order)};
  share_from_first(comm_, shared);
  choice_.best = static_cast<std::size_t>(shared[0]);
  choice_.order = static_cast<int>(shared[1]);
}

/// Looks at values of the parameters between those that the claim is made for, at frequencies.
/// Where the chosen body does not meet the tolerance the claim is made for these too: whether
/// there are such.
bool Cut::add_weak_values() {
  const Candidate& candidate = choice_.candidates[choice_.best];
  const DenseSystem small = medium_.system.project(candidate.basis(choice_.order));
  between_.reset();
  bool any = false;
  for (const ParameterValues& values : whole_.spec.between) {
    const auto is_known = [&](const auto& sight) { return sight.values == values; };
    if (std::any_of(sights_.begin(), sights_.end(), is_known)) continue;
    const auto here = seen(level_, values);
    const auto errors = ErrorOverBand(*here, request_.relative_to).of(small.at(values));
    const bool is_weak = request_.order.tolerance && choice_.shortfall.empty() &&
                         !(errors.worst <= smallest_tolerance());
    std::vector<double> shared{
        *std::max_element(errors.bound.begin(), errors.bound.end()), is_weak ? 1.0 : 0.0};
    share_from_first(comm_, shared);
    if (shared[1] > 0) {
      sights_.push_back({values, here});
      errors_.add(sights_.back());
      any = true;
    } else {
      between_ = std::max(between_.value_or(0.0), shared[0]);
    }
  }
  return any;
}

std::vector<double> Cut::error_grid(const MediumModel& model) const {
  std::vector<double> grid = band_grid(bands_, 400, model.resonances);
  for (double omega : request_.error_omega)
    if (std::any_of(bands_.begin(), bands_.end(), [&](const Interval& band) {
          return omega >= band.first && omega <= band.last;
        }))
      grid.push_back(omega);
  if (!request_.error_omega.empty()) {
    std::sort(grid.begin(), grid.end());
    grid.erase(std::unique(grid.begin(), grid.end()), grid.end());
  }
  share_list(comm_, grid);
  return grid;
}

Dense Cut::gram() const {
  if (request_.metric == Metric::euclidean) return medium_.euclidean_gram();
  const double last = bands_.back().last;
  const double stiffness =
      request_.metric == Metric::energy && last > 0 ? 1 / (last * last) : medium_.kappa;
  Dense g = medium_.system.M;
  add_to(g, medium_.system.K, stiffness);
  return g;
}

/// What is asked of a view.
double Cut::limit_of(std::size_t view) const {
  return request_.order.smallest() * medium_.views[view].allowed;
}

BandClaim Cut::claim_of(const ErrorOverBox::Supremum& sup, const DenseSystem& small) {
  BandClaim claim;
  claim.worst = sup.worst;
  claim.whole = sup.worst_of[0];
  const auto view = as_size(std::max_element(sup.worst_of.begin(), sup.worst_of.end()) -
                            sup.worst_of.begin());
  claim.attained = sup.attained_of[view];
  claim.at = sup.at_of[view];
  for (const Law& parameter : parameters_of(small.terms))
    claim.parameters.push_back(parameter.parameter());
  if (!claim.parameters.empty())
    for (const ErrorOverBox::Sight& sight : sights_) claim.values.push_back(sight.values);
  claim.between = between_;
  claim.at_values = sup.values_of[view];
  claim.rigid_rounding = seen_.grid().rigid_rounding;
  const auto& data = seen_.grid().data_rounding;
  if (const auto most = std::max_element(data.begin(), data.end()); most != data.end()) {
    claim.data_rounding = *most;
    claim.data_rounding_at = errors_.omega()[as_size(most - data.begin())];
  }
  claim.relative_to = word_of(resolved(request_.relative_to, whole_));
  for (const Interval& b : bands_) claim.bands.push_back({b.first, b.last});
  for (const Interval& e : sup.excluded) claim.excluded.push_back({e.first, e.last});
  claim.tolerance = request_.order.tolerance;
  claim.met = !request_.order.tolerance || sup.proved;
  for (std::size_t v = 0; claim.met && claim.tolerance && v < sup.worst_of.size(); ++v)
    claim.met = sup.worst_of[v] <= limit_of(v);
  if (claim.met || !sup.proved) return claim;
  std::vector<double> ends;
  for (const Interval& i : errors_.unmet(small, smallest_tolerance()).intervals)
    ends.insert(ends.end(), {i.first, i.last});
  share_list(comm_, ends);
  for (std::size_t i = 0; i + 1 < ends.size(); i += 2)
    claim.unmet.push_back({ends[i], ends[i + 1]});
  return claim;
}

constexpr const char* frame_names[] = {"auto", "none", "buckens", "tangent"};

/// The model of the chosen order in modal coordinates, the same on every rank.
DenseSystem::Modal Cut::chosen_model() {
  Dense Q = choice_.candidates[choice_.best].basis(choice_.order);
  share_from_first(comm_, Q.data);
  DenseSystem::Modal chosen = medium_.system.project_to_modes(Q, medium_.tau);
  if (frame_ == FrameKind::tangent) { // K resists rigid motion in no coordinates
    Dense K = std::move(chosen.system.K);
    chosen.Q = at_rest_at(medium_, frame_interface_, chosen.Q);
    chosen.system = medium_.system.project(chosen.Q);
    chosen.system.K = std::move(K);
  }
  DenseSystem& system = chosen.system;
  for (Dense* a : {&chosen.Q, &system.K, &system.M, &system.B, &system.C})
    share_from_first(comm_, a->data);
  for (auto& [law, T] : system.terms) share_from_first(comm_, T.data);
  return chosen;
}

/// The reduced body and what is claimed of it.
ReducedModel Cut::reduced(const Dense& Q, const DenseSystem& small,
                          const ErrorOverBox::Supremum& sup) {
  ReducedModel rom;
  rom.system = small.model(medium_.names);
  rom.V = medium_.lift(Q);
  rom.provenance.method = request_.name;
  rom.provenance.second_stage = choice_.candidates[choice_.best].name;
  // The paper's indicator: the Gramian over the band, whatever the basis is made of.
  const auto paper = std::find_if(choice_.candidates.begin(), choice_.candidates.end(),
                                  [](const Candidate& c) { return c.name == "gramian"; });
  rom.sigma = paper != choice_.candidates.end()
                  ? paper->sigma
                  : make_candidate("gramian", *stage_).sigma;
  ErrorOverBand::Errors errors = errors_.of(small);
  rom.claim.curve.omega = errors_.omega();
  rom.claim.curve.error = std::move(errors.relative);
  rom.claim.curve.bound = std::move(errors.bound);
  rom.claim.curve.floor = errors_.floor();
  if (whole_.printed_rounding > 0)
    rom.claim.curve.data_rounding = seen_.grid().data_rounding;
  rom.claim.supremum = claim_of(sup, small);
  std::vector<double> poles;
  for (const auto& pole : medium_.poles_within(small, sup.excluded))
    poles.insert(poles.end(), {pole.omega, pole.frequency, pole.residue});
  share_list(comm_, poles);
  for (std::size_t i = 0; i + 2 < poles.size(); i += 3)
    rom.claim.supremum->poles.push_back({poles[i], poles[i + 1], poles[i + 2]});
  rom.claim.kind = !sup.proved            ? "estimated"
                   : sup.excluded.empty() ? "certified"
                                          : "certified outside";
  for (std::size_t v = 1; v < sup.worst_of.size(); ++v)
    rom.claim.by_kind.emplace_back(medium_.views[v].name, sup.worst_of[v],
                                   medium_.least_size(v));
  if (!request_.order.of_kinds.empty())
    for (std::size_t v = 1; v < sup.worst_of.size(); ++v)
      rom.claim.kind_tolerances.push_back(limit_of(v));
  rom.modes = eigenfrequencies(small.stiffened().model(medium_.names));
  rom.claim.band[0] = bands_.front().first;
  rom.claim.band[1] = bands_.back().last;
  rom.provenance.factorisations = whole_.factorisations;
  rom.provenance.medium_order = medium_.system.order();
  const bool apart = medium_.rigid > 0 && choice_.candidates[choice_.best].rigid_first;
  rom.frame.kind = frame_names[as_size(
      frame_ == FrameKind::none && apart ? FrameKind::buckens : frame_)];
  rom.frame.rigid_modes = medium_.rigid;
  rom.frame.interface = frame_interface_;
  if (whole_.integrals) {
    Dense all(whole_.integrals->M_er.rows, Q.columns);
    set_part(all, 0, 0, medium_.in_V(Q));
    rom.frame.integrals = project(*whole_.integrals, all);
  }
  return rom;
}

/// With all values of the parameters, where the claim for some of them is proved and met.
void Cut::prove_between(const Dense& Q, const ErrorOverBox::Supremum& sup,
                        BandClaim& claim) {
  if (claim.values.size() < 2) return; // no parameters, or of their present values alone
  const auto skip = [&](const char* why) { observer_.skip("proof between values", why); };
  if (const char* why = not_between()) return skip(why);
  if (!sup.proved || !sup.excluded.empty() || !claim.met)
    return skip("the claim with some of them is not proved, or not met");
  double worst = 0;
  for (std::size_t v = 0; v < sup.worst_of.size(); ++v)
    worst = std::max(worst, sup.worst_of[v] / medium_.views[v].allowed);
  std::vector<double> shared{worst, 2 * errors_.largest_floor().worst};
  share_from_first(comm_, shared);
  const double floor = shared[1],
               limit = (claim.tolerance ? smallest_tolerance() : 3 * worst) - floor;
  if (Q.columns >= medium_.system.order())
    return skip("the reduced body is the medium model");
  if (!(floor < limit)) return skip("rounding is as large as the tolerance");
  Stage timer(observer_, "between values");
  const auto found = ErrorBetween(medium_, Q).supremum(comm_, bands_, limit);
  claim.cells_between = found.cells;
  for (std::size_t v = 0; found.proved && v < found.worst_of.size(); ++v)
    claim.of_all_values.push_back(std::max(found.worst_of[v] + floor, sup.worst_of[v]));
}

ReducedModel Cut::run() {
  Stage timer(observer_, "second stage");
  frame_ = request_.frame != FrameKind::automatic ? request_.frame
           : medium_.rigid > 0                    ? FrameKind::buckens
                                                  : FrameKind::none;
  if (medium_.rigid == 0 && frame_ != FrameKind::none) {
    observer_.skip("frame", "the body has no rigid modes");
    frame_ = FrameKind::none;
  }
  if (medium_.rigid > 0) observer_.fact("frame", frame_names[as_size(frame_)]);
  frame_interface_ = request_.frame_interface;
  if (frame_interface_.empty() && frame_ == FrameKind::tangent)
    frame_interface_ = first_with_six_ports(medium_);
  stage_ = std::make_unique<SecondStage>(
      SecondStage{medium_, others(), weights(), request_.equal_ports,
                  frame_ != FrameKind::none, gram(), shifts_, request_.moments,
                  request_.relative_to, smallest_tolerance(), request_.statics});
  const auto names =
      request_.methods.empty() ? automatic_methods(request_.order) : request_.methods;
  choose(names);
  while (add_weak_values()) {
    stage_->others = others();
    choose(names);
  }
  if (!choice_.tried.empty()) observer_.fact("second stage", choice_.tried);
  const DenseSystem::Modal chosen = chosen_model();
  const Dense& Q = chosen.Q;
  const DenseSystem& small = chosen.system;
  const auto sup = of_first_rank(comm_, errors_.supremum(small, smallest_tolerance()));
  ReducedModel rom = reduced(Q, small, sup);
  prove_between(Q, sup, *rom.claim.supremum);
  if (request_.field)
    rom.claim.fields = field_claims(comm_, seen_, Q, small, sup.excluded);
  rom.claim.form = seen_.model().error_form();
  rom.claim.held = held_interfaces(medium_, small, bands_.back().last);
  tell({whole_, request_, seen_, choice_, small, sup}, rom, observer_);
  return rom;
}

} // namespace

ReducedModel cut(const Medium& medium, const CutRequest& request, Observer& observer) {
  return Cut(medium, request, observer).run();
}

} // namespace flexgram
