#include "reduce/two_step.hpp"

#include "base/text.hpp"
#include "reduce/candidates.hpp"
#include "reduce/order_choice.hpp"
#include "reduce/project.hpp"
#include "reduce/report.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace flexgram {
namespace {

constexpr double hz = 0.5 / std::numbers::pi;
/// What auto tries. Measured over seven bodies and tolerances from 1e-2 to 1e-8 (README,
/// "Order over tolerance"), none of the others is ever smaller than the better of these
/// two.
const std::vector<std::string> auto_stages{"gramian", "weighted"};

} // namespace

void TwoStepOptions::describe(Options& options) {
  options.section("Second stage (every method but pod)");
  std::vector<std::string> stages{"auto"};
  stages.insert(stages.end(), candidate_names().begin(), candidate_names().end());
  options.add_choice(
      "-mor_second_stage", second_stage, stages,
      "how -mor_method two_step picks the small basis out of the medium space; auto "
      "tries them and keeps the smallest body that meets -mor_tol (by the order "
      "rule: gramian)");
  options.add("-mor_weight", weight, "Hz, 1",
              "weight of the Gramian over the band: f1,w1,f2,w2,... , linear between, "
              "zero outside");
  options.add(
      "-mor_shifts_hz", shifts_hz, "Hz",
      "expansion points of krylov; default: both ends of the band and its middle");
  options.add("-mor_moments", moments, "", "moments at each expansion point of krylov");
  options.add_choice(
      "-mor_frame", frame, {"auto", "none", "buckens", "tangent"},
      "frame of reference of a free body: buckens: basis vectors orthogonal to "
      "the rigid modes, which come first; tangent: at rest at an interface; none: "
      "rigid motion mixed into the basis. auto: buckens if the body is free");
  options.add(
      "-mor_frame_interface", frame_interface,
      "interface that the tangent frame follows; default: the first with six ports");
  options.add(
      "-mor_error_hz", error_hz, "Hz",
      "first,last,count: further frequencies at which error and bound are evaluated and "
      "stored, beside some hundred over the band and on its resonances");
  medium.describe(options);
}

void TwoStepOptions::check() const {
  std::string words;
  for (double w : weight) words += text("%s%g", words.empty() ? "" : ",", w);
  bool good = weight.size() % 2 == 0 && weight.size() != 2;
  for (std::size_t i = 0; good && i < weight.size(); i += 2)
    good = weight[i] >= 0 && weight[i + 1] >= 0 && (i == 0 || weight[i] > weight[i - 2]);
  require_option(good, "-mor_weight", words, "f1,w1,f2,w2,... with rising f and w >= 0");
  for (double f : shifts_hz)
    require_option(f >= 0, "-mor_shifts_hz", text("%g", f), "zero or more");
  require_option(moments >= 1, "-mor_moments", std::to_string(moments), "1 or more");
  require_option(error_hz.empty() || (error_hz.size() == 3 && error_hz[0] >= 0 &&
                                      error_hz[0] <= error_hz[1] && error_hz[2] >= 1),
                 "-mor_error_hz", std::to_string(error_hz.size()) + " numbers",
                 "first,last,count with first <= last");
  medium.check();
}

namespace {

class SecondStageRun {
public:
  SecondStageRun(const SecondOrderModel& fom, const std::string& method,
                 const GramianOptions& gramian, const TwoStepOptions& options, Plan& plan,
                 Monitor& monitor)
      : fom_(fom), method_(method), gramian_(gramian), options_(options), plan_(plan),
        monitor_(monitor) {}

  ReducedModel run(const SolverOptions& solver, bool mass_is_singular);

private:
  std::vector<double> shifts() const;
  std::vector<BandWeight> weights() const;
  std::vector<double> error_grid(const MediumModel& medium) const;
  Dense gram(const MediumModel& medium) const;
  std::vector<std::string> names() const;
  Dense tangent(const Dense& Q) const;
  ErrorOverBand::Supremum shared_supremum(ErrorOverBand::Supremum sup) const;
  ErrorClaim claim_of(const ErrorOverBand::Supremum& sup) const;
  ReducedModel finish();

  const SecondOrderModel& fom_;
  const std::string& method_;
  const GramianOptions& gramian_;
  const TwoStepOptions& options_;
  Plan& plan_;
  Monitor& monitor_;
  MediumModel medium_;
  std::unique_ptr<SecondStage> stage_;
  std::unique_ptr<ErrorOverBand> errors_;
  OrderChoice choice_;
  std::string frame_;
};

std::vector<double> SecondStageRun::shifts() const {
  std::vector<double> shifts;
  for (double f : options_.shifts_hz) shifts.push_back(f / hz);
  if (!shifts.empty()) return shifts;
  const auto bands = gramian_.bands();
  const double first = bands.front().first, last = bands.back().second;
  return first == last ? std::vector<double>{first}
                       : std::vector<double>{first, 0.5 * (first + last), last};
}

std::vector<BandWeight> SecondStageRun::weights() const {
  std::vector<BandWeight> result;
  if (!options_.weight.empty()) {
    BandWeight weight;
    for (std::size_t i = 0; i < options_.weight.size(); i += 2) {
      weight.omega.push_back(options_.weight[i] / hz);
      weight.weight.push_back(options_.weight[i + 1]);
    }
    result.push_back(std::move(weight));
    return result;
  }
  for (const auto& [first, last] : gramian_.bands())
    result.push_back(BandWeight::flat(first, last));
  return result;
}

std::vector<double> SecondStageRun::error_grid(const MediumModel& medium) const {
  std::vector<double> grid;
  const auto bands = gramian_.bands();
  for (const auto& [first, last] : bands) {
    const auto part =
        band_grid(first, last, 400 / static_cast<int>(bands.size()), medium.resonances);
    grid.insert(grid.end(), part.begin(), part.end());
  }
  if (!options_.error_hz.empty()) {
    const int count = static_cast<int>(options_.error_hz[2]);
    for (int l = 0; l < count; ++l) {
      const double t = count == 1 ? 0.0 : static_cast<double>(l) / (count - 1);
      const double omega =
          (options_.error_hz[0] + t * (options_.error_hz[1] - options_.error_hz[0])) / hz;
      for (const auto& [first, last] : bands)
        if (omega >= first && omega <= last) grid.push_back(omega);
    }
    std::sort(grid.begin(), grid.end());
    grid.erase(std::unique(grid.begin(), grid.end()), grid.end());
  }
  return grid;
}

Dense SecondStageRun::gram(const MediumModel& medium) const {
  if (gramian_.inner_product == "euclidean") {
    Dense g = inner(medium.V, medium.V);
    symmetrise(g);
    return g;
  }
  const double last = gramian_.bands().back().second;
  const double stiffness =
      gramian_.inner_product == "energy" && last > 0 ? 1 / (last * last) : medium.kappa;
  Dense g = medium.system.M;
  for (std::size_t i = 0; i < g.data.size(); ++i)
    g.data[i] += stiffness * medium.system.K.data[i];
  return g;
}

/// The second stages to try.
std::vector<std::string> SecondStageRun::names() const {
  if (method_ != "two_step") return {method_};
  if (options_.second_stage != "auto") return {options_.second_stage};
  const bool ruled = !gramian_.tolerance && gramian_.order == 0;
  return ruled ? std::vector<std::string>{"gramian"} : auto_stages;
}

/// V_e − Φ_r (B_iᵀΦ_r)⁻¹ B_iᵀV_e: every elastic vector at rest at the interface.
Dense SecondStageRun::tangent(const Dense& Q) const {
  std::string interface = options_.frame_interface;
  std::vector<int> ports;
  for (std::size_t i = 0; i < fom_.inputs.size(); ++i) {
    const std::string name = fom_.inputs[i].substr(0, fom_.inputs[i].rfind('.'));
    if (interface.empty() && std::count_if(fom_.inputs.begin(), fom_.inputs.end(),
                                           [&](const std::string& other) {
                                             return other.rfind(name + ".", 0) == 0;
                                           }) == 6)
      interface = name;
    if (name == interface) ports.push_back(static_cast<int>(i));
  }
  if (ports.size() != 6 || medium_.rigid != 6)
    throw Error(
        text("-mor_frame tangent needs a free body and an interface with six ports; %s%s "
             "has %zu, and there are %d rigid modes",
             interface.empty() ? "no interface" : "interface ", interface.c_str(),
             ports.size(), medium_.rigid));
  const int m = Q.columns;
  const Dense motion = multiply_transposed(medium_.system.B, Q); // n_in × m
  ComplexDense rigid(6, 6), elastic(6, m - 6);
  for (int i = 0; i < 6; ++i) {
    const int port = ports[static_cast<std::size_t>(i)];
    for (int j = 0; j < 6; ++j) rigid(i, j) = motion(port, j);
    for (int j = 6; j < m; ++j) elastic(i, j - 6) = motion(port, j);
  }
  const ComplexDense share = solve(std::move(rigid), std::move(elastic));
  Dense moved = Q;
  for (int j = 6; j < m; ++j)
    for (int i = 0; i < 6; ++i) moved(i, j) -= share(i, j - 6).real();
  return moved;
}

/// Rank 0's: the last bit may differ between ranks, and with it how often intervals were
/// halved; the file and the exit status must not.
ErrorOverBand::Supremum
SecondStageRun::shared_supremum(ErrorOverBand::Supremum sup) const {
  std::vector<double> head{sup.worst, sup.proved ? 1.0 : 0.0,
                           static_cast<double>(sup.excluded.size()),
                           static_cast<double>(sup.intervals)};
  share_from_first(fom_.comm, head);
  sup.worst = head[0];
  sup.proved = head[1] > 0;
  sup.excluded.resize(static_cast<std::size_t>(head[2]));
  sup.intervals = static_cast<int>(head[3]);
  for (auto* values : {&sup.worst_of, &sup.attained_of, &sup.at_of})
    share_from_first(fom_.comm, *values);
  std::vector<double> ends;
  for (const Interval& e : sup.excluded) ends.insert(ends.end(), {e.first, e.last});
  share_from_first(fom_.comm, ends);
  for (std::size_t i = 0; i < sup.excluded.size(); ++i)
    sup.excluded[i] = {ends[2 * i], ends[2 * i + 1]};
  return sup;
}

ErrorClaim SecondStageRun::claim_of(const ErrorOverBand::Supremum& sup) const {
  ErrorClaim claim;
  claim.worst = sup.worst;
  claim.whole = sup.worst_of[0];
  const auto view = static_cast<std::size_t>(
      std::max_element(sup.worst_of.begin(), sup.worst_of.end()) - sup.worst_of.begin());
  claim.attained = sup.attained_of[view];
  claim.at = sup.at_of[view];
  claim.rigid_rounding = errors_->assumed();
  claim.relative_to = options_.medium.relative_to;
  for (const auto& [first, last] : gramian_.bands()) claim.bands.push_back({first, last});
  for (const Interval& e : sup.excluded) claim.excluded.push_back({e.first, e.last});
  claim.tolerance = gramian_.tolerance;
  claim.met = !gramian_.tolerance || (sup.proved && sup.worst <= *gramian_.tolerance);
  return claim;
}

/// What is claimed, as it is printed.
std::string label_of(const ReducedModel& rom) {
  if (rom.kind == "estimated") return "estimated, not proved";
  const auto& excluded = rom.claim->excluded;
  if (excluded.empty()) return "certified";
  double widest = 0;
  for (const auto& [first, last] : excluded)
    widest = std::max(widest, (last - first) / last);
  std::string words =
      text("certified outside %zu interval%s of relative width %.0e at most, around "
           "undamped resonances",
           excluded.size(), excluded.size() == 1 ? "" : "s", widest);
  double frequency = 0, residue = 0;
  for (const auto& pole : rom.claim->poles) {
    frequency = std::max(frequency, pole[1]);
    residue = std::max(residue, pole[2]);
  }
  if (!rom.claim->poles.empty())
    words += text(", whose frequencies are right to %.0e and residues to %.0e", frequency,
                  residue);
  return words;
}

ReducedModel SecondStageRun::finish() {
  std::vector<double> shared{static_cast<double>(choice_.best),
                             static_cast<double>(choice_.order)};
  share_from_first(fom_.comm,
                   shared); // the last bit of an error may differ between ranks
  choice_.best = static_cast<std::size_t>(shared[0]);
  const int order = static_cast<int>(shared[1]);
  const Candidate& candidate = choice_.candidates[choice_.best];
  Dense Q = candidate.basis(order);
  share_from_first(fom_.comm, Q.data);
  if (frame_ == "tangent") Q = tangent(Q);
  const DenseSystem small = medium_.system.project(Q);
  const ErrorOverBand::Errors errors = errors_->of(small);
  const ErrorOverBand::Supremum sup = shared_supremum(errors_->supremum(
      small, gramian_.tolerance.value_or(0), options_.medium.relative()));

  ReducedModel rom;
  rom.model = small.model(fom_);
  rom.V = combine(medium_.V, Q);
  rom.method = method_;
  rom.second_stage = candidate.name;
  // The paper's indicator: the Gramian over the band, whatever the basis is made of.
  const auto paper = std::find_if(choice_.candidates.begin(), choice_.candidates.end(),
                                  [](const Candidate& c) { return c.name == "gramian"; });
  rom.sigma = paper != choice_.candidates.end()
                  ? paper->sigma
                  : make_candidate("gramian", *stage_).sigma;
  rom.omega = errors_->omega();
  rom.epsilon = errors.relative;
  rom.bound = errors.bound;
  rom.floor = errors_->floor();
  rom.claim = claim_of(sup);
  for (const auto& pole : medium_.poles_within(small, sup.excluded))
    rom.claim->poles.push_back({pole.omega, pole.frequency, pole.residue});
  rom.kind = !sup.proved            ? "estimated"
             : sup.excluded.empty() ? "certified"
                                    : "certified outside";
  rom.modes = eigenfrequencies(rom.model);
  const auto bands = gramian_.bands();
  rom.band[0] = bands.front().first;
  rom.band[1] = bands.back().second;
  rom.factorisations = medium_.factorisations;
  rom.medium_order = medium_.system.order();
  rom.frame = frame_;
  rom.rigid_modes = medium_.rigid;

  plan_.fact(
      "order",
      text("m = %d of n = %lld, by %s, from %s%s", order, static_cast<long long>(fom_.n),
           choice_.chosen_by.c_str(), candidate.name.c_str(),
           candidate.remark.empty() ? "" : (" (" + candidate.remark + ")").c_str()));
  const double floor = *std::max_element(rom.floor.begin(), rom.floor.end());
  const std::string label = label_of(rom);
  const bool to_band = options_.medium.relative() == RelativeTo::band;
  const char* const references[] = {"|H| at each frequency",
                                    "the largest |H| in the band"};
  plan_.fact(
      "error",
      text("at most %.2e of %s, everywhere in the band%s (%s), reached %.2e at %.5g Hz; "
           "rounding floor %.0e",
           sup.worst_of[0], references[to_band ? 1 : 0],
           rom.claim->bands.size() > 1 ? "s" : "", label.c_str(), sup.attained_of[0],
           sup.at_of[0] * hz, floor));
  if (sup.excluded.empty()) { // else |H| has no largest value
    const auto other = errors_->supremum(
        small, gramian_.tolerance.value_or(0),
        to_band ? RelativeTo::pointwise : RelativeTo::band, sup.intervals + 200);
    plan_.fact("relative to",
               text("%s (-mor_tol_relative_to %s); of %s the error is at most %.1e",
                    references[to_band ? 1 : 0], options_.medium.relative_to.c_str(),
                    references[to_band ? 0 : 1], other.worst));
  }
  if (medium_.rigid > 0)
    plan_.fact("rigid rounding",
               text("rigid modes are rigid; if what K holds of them, which its rounding "
                    "explains, were meant, H would change by %.0e",
                    rom.claim->rigid_rounding));
  if (sup.worst_of.size() == 3) {
    rom.by_kind = {sup.worst_of[1], sup.worst_of[2]};
    plan_.fact("by kind",
               text("%s at most %.1e, %s at most %.1e (%s)",
                    medium_.views[1].name.c_str(), sup.worst_of[1],
                    medium_.views[2].name.c_str(), sup.worst_of[2], label.c_str()));
  } else {
    std::vector<ComplexDense> H_r;
    const DenseResponse response(small, medium_.tau);
    for (double omega : rom.omega) H_r.push_back(response.transfer(omega));
    warn_of_kinds(rom.model, errors_->H(), H_r, sup.worst, plan_, monitor_);
  }
  if (!rom.claim->met)
    monitor_.warn(
        text("-mor_tol %g is not met: the error is at most %.1e (%s); %s. This is "
             "the best body that was found",
             *gramian_.tolerance, sup.worst, label.c_str(), choice_.shortfall.c_str()));
  plan_.fact("reduced modes", describe_modes(rom.modes, medium_.rigid));
  plan_.fact("reduced M, K",
             text("smallest over largest eigenvalue %.1e, %.1e; V'MV = I to %.0e",
                  relative_smallest_eigenvalue(rom.model.M),
                  relative_smallest_eigenvalue(rom.model.K),
                  medium_.loss_of_orthogonality));
  plan_.print(monitor_);
  return rom;
}

ReducedModel SecondStageRun::run(const SolverOptions& solver, bool mass_is_singular) {
  const auto bands = gramian_.bands();
  const double last = bands.back().second;
  const auto expansion = shifts();
  double needed = last;
  if (method_ == "krylov" || options_.second_stage == "krylov")
    needed = std::max(last, *std::max_element(expansion.begin(), expansion.end()));
  const double target = options_.medium.target > 0 ? options_.medium.target
                        : gramian_.tolerance       ? 0.02 * *gramian_.tolerance
                                                   : 1e-8;
  const int wanted = method_ == "modal" ? std::max(gramian_.order, 1) : 0;
  MediumOptions how = options_.medium;
  how.by_kind = gramian_.by_kind();
  std::vector<Interval> intervals;
  for (const auto& [from, to] : bands) intervals.push_back({from, to});
  medium_ = medium_model(fom_, intervals, needed, wanted, mass_is_singular, how, target,
                         solver, plan_, monitor_);
  plan_.print(monitor_);
  Stage timer(monitor_, "second stage");
  frame_ = options_.frame != "auto" ? options_.frame
           : medium_.rigid > 0      ? "buckens"
                                    : "none";
  if (medium_.rigid == 0 && frame_ != "none") {
    plan_.skip("frame", "the body has no rigid modes");
    frame_ = "none";
  }
  if (medium_.rigid > 0) plan_.fact("frame", frame_);
  stage_ = std::make_unique<SecondStage>(
      SecondStage{medium_, weights(), gramian_.port_scaling == "equal", frame_ != "none",
                  gram(medium_), expansion, options_.moments});
  errors_ = std::make_unique<ErrorOverBand>(medium_, intervals, error_grid(medium_),
                                            options_.medium.relative());
  choice_ = choose_order(names(), *stage_, *errors_, gramian_);
  if (!choice_.tried.empty()) plan_.fact("second stage", choice_.tried);
  return finish();
}

} // namespace

ReducedModel reduce_two_step(const SecondOrderModel& fom, const std::string& method,
                             const GramianOptions& gramian, const TwoStepOptions& options,
                             const SolverOptions& solver, bool mass_is_singular,
                             Plan& plan, Monitor& monitor) {
  return SecondStageRun(fom, method, gramian, options, plan, monitor)
      .run(solver, mass_is_singular);
}

} // namespace flexgram
