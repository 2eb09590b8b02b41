#include "run/reduce.hpp"

#include "base/text.hpp"
#include "model/rigid_body_modes.hpp"
#include "run/sweep.hpp"

#include <numbers>

namespace flexgram {
namespace {

/// What a rank keeps of the samples [MB].
double samples_mb(const SecondOrderModel& model, std::size_t samples) {
  return static_cast<double>(samples) * static_cast<double>(model.B.columns()) *
         (model.undamped() ? 1 : 2) * static_cast<double>(model.n) * 8 / 1e6 /
         comm_size(model.comm);
}

FrequencySolves prepare_reduction(const Body& body, const Settings& s, Monitor& monitor) {
  const auto samples = s.gramian.nodes().omega.size();
  return FrequencySolves(body.model.share(), s.parallel, s.solver,
                         static_cast<int>(samples), samples_mb(body.model, samples),
                         monitor);
}

void describe_reduction(const FrequencySolves& solves, const Body& body,
                        const Settings& s, Plan& plan) {
  const auto [first, last] = s.gramian.band();
  const auto samples = s.gramian.nodes().omega.size();
  const double hz = 0.5 / std::numbers::pi;
  plan.fact("method", text("%s: %zu samples over %g-%g Hz (%s, %s), %d checks between "
                           "them and at the ends",
                           s.method.c_str(), samples, first * hz, last * hz,
                           s.gramian.quadrature.c_str(), s.gramian.spacing.c_str(),
                           std::min(s.pod.validate, static_cast<int>(samples) - 1)));
  plan_solves(solves, samples, plan);
  plan.fact("samples",
            text("%zu columns, %.0f MB on a rank%s",
                 samples * static_cast<std::size_t>(body.model.B.columns()) *
                     (body.model.undamped() ? 1 : 2),
                 samples_mb(body.model, samples),
                 solves.groups().count > 1 ? ", twice that while they move" : ""));
}

ReducedModel reduce_by_samples(const Body& body, const Settings& s, Plan& plan,
                               Monitor& monitor) {
  FrequencySolves solves = prepare_reduction(body, s, monitor);
  describe_reduction(solves, body, s, plan);
  plan.print(monitor);
  const BodyFacts facts = check(body, s, plan, monitor);
  plan.print(monitor);
  return reduce_pod(body.model, solves, s.gramian, s.pod, facts.rigid_modes, plan,
                    monitor);
}

void plan_method(const Settings& s, Plan& plan) {
  std::string bands;
  for (double f : s.gramian.band_hz) bands += text("%s%g", bands.empty() ? "" : "-", f);
  plan.fact("method", s.method + " over " + bands + " Hz");
}

/// What the two factorisations of the medium model will take.
void describe_two_step(const Body& body, const Settings& s, Plan& plan,
                       Monitor& monitor) {
  plan_method(s, plan);
  Stage stage(monitor, "analyse");
  ShiftedSolver solver(body.model.K, body.model.M, nullptr, body.model.node, s.solver);
  const FactorEstimate cutoff = solver.analyse(true);
  plan.fact("factorisations", text("2 real LDLᵀ of K - ω²M and K + τM, one at a time: "
                                   "%.2g entries, %.2g flops, %.0f "
                                   "MB on a rank, ordered by %s",
                                   cutoff.factor_entries, cutoff.flops,
                                   cutoff.mb_per_rank, solver.ordering().c_str()));
  const double column =
      static_cast<double>(body.model.n) * 8 / 1e6 / comm_size(body.model.comm);
  plan.fact("medium space",
            text("about %.0f MB on a rank for each 100 vectors", 400 * column));
}

ReducedModel reduce_in_two_steps(const Body& body, const Settings& s, Plan& plan,
                                 Monitor& monitor) {
  plan_method(s, plan);
  const BodyFacts facts = check(body, s, plan, monitor);
  plan.print(monitor);
  return reduce_two_step(body.model, s.method, s.gramian, s.two_step, s.solver,
                         facts.mass_is_singular, plan, monitor);
}

/// What a moving frame needs of the body, where it can move and has coordinates.
void add_frame_integrals(ReducedModel& rom, const Body& body, const Settings& s,
                         Plan& plan, Monitor& monitor) {
  const bool possible = has_coordinates(body.model);
  if (s.frame_integrals == "no" || !possible) {
    if (s.frame_integrals == "yes")
      throw Error(
          "-mor_frame_integrals yes: the body has no coordinates (/dofs, /nodes)");
    plan.skip("frame integrals",
              possible ? "-mor_frame_integrals no" : "the body has no coordinates");
    return;
  }
  if (s.frame_integrals == "auto" && rom.rigid_modes < 6) {
    plan.skip("frame integrals", "the body cannot move freely");
    return;
  }
  Stage stage(monitor, "frame");
  rom.integrals = frame_integrals(body.model, rom.V);
  const FrameIntegrals& i = *rom.integrals;
  plan.fact("frame integrals", text("mass %.6g kg, centre (%.4g, %.4g, %.4g) m", i.mass,
                                    i.centre[0], i.centre[1], i.centre[2]));
}

} // namespace

ReducedModel reduce_body(const Body& body, const Settings& s, Plan& plan,
                         Monitor& monitor) {
  plan.print(monitor);
  ReducedModel rom = s.samples() ? reduce_by_samples(body, s, plan, monitor)
                                 : reduce_in_two_steps(body, s, plan, monitor);
  add_frame_integrals(rom, body, s, plan, monitor);
  plan.print(monitor);
  rom.plan = plan.lines();
  return rom;
}

bool reduce(MPI_Comm comm, const Settings& s, const Options& options, Monitor& monitor) {
  Plan plan;
  s.check();
  for (const Option& option : options.all())
    if (option.name == "-mor_band_hz" && !option.set_by_user)
      monitor.warn("-mor_band_hz is not given: the band is " + option.value + " Hz");
  check_output(comm, s.out, {s.body});
  const Body body = load_body(comm, s, plan, monitor);
  const ReducedModel rom = reduce_body(body, s, plan, monitor);
  {
    Stage stage(monitor, "write");
    write_reduced(rom, options, monitor, body.model, s.out);
  }
  print_summary(monitor, comm);
  monitor.say("  wrote          " + s.out);
  return !rom.claim || rom.claim->met;
}

void plan_only(MPI_Comm comm, const Settings& s, Monitor& monitor) {
  Plan plan;
  s.check();
  const Body body = load_body(comm, s, plan, monitor);
  plan.skip("checks that factorise", "plan only analyses");
  if (s.samples()) {
    FrequencySolves solves = prepare_reduction(body, s, monitor);
    describe_reduction(solves, body, s, plan);
  } else {
    describe_two_step(body, s, plan, monitor);
  }
  plan.print(monitor);
  print_summary(monitor, comm);
}

} // namespace flexgram
