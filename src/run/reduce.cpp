#include "run/reduce.hpp"

#include "base/index.hpp"
#include "base/process.hpp"
#include "base/text.hpp"
#include "io/reduced_io.hpp"
#include "medium/error_between.hpp"
#include "medium/factors.hpp"
#include "medium/medium_io.hpp"
#include "model/load_patterns.hpp"
#include "model/parameters.hpp"
#include "model/rigid_body_modes.hpp"
#include "run/loads.hpp"
#include "run/summary.hpp"
#include "run/sweep.hpp"
#include "sampling/pod.hpp"

#include <algorithm>
#include <filesystem>

namespace flexgram {
namespace {

/// What a rank keeps of the samples [MB].
double samples_mb(const SecondOrderModel& model, std::size_t samples) {
  return static_cast<double>(samples) * static_cast<double>(model.B.columns()) *
         (model.undamped() ? 1 : 2) * static_cast<double>(model.n) * 8 / 1e6 /
         comm_size(model.comm);
}

FrequencySolves prepare_samples(const Body& body, const Settings& s, Observer& observer) {
  const auto samples = s.sampling_spec().nodes().omega.size();
  return FrequencySolves(body.model.share(), s.groups, s.solver,
                         static_cast<int>(samples), samples_mb(body.model, samples),
                         observer);
}

void describe_samples(const FrequencySolves& solves, const Body& body, const Settings& s,
                      Observer& observer) {
  const SamplingSpec spec = s.sampling_spec();
  const auto samples = spec.nodes().omega.size();
  observer.fact("method",
                text("%s: %zu samples over %g-%g Hz (%s, %s), %d checks between "
                     "them and at the ends",
                     s.method.c_str(), samples, spec.band.first * hz, spec.band.last * hz,
                     word_of(s.quadrature), s.logarithmic ? "log" : "linear",
                     std::min(spec.checks, static_cast<int>(samples) - 1)));
  plan_solves(solves, samples, observer);
  observer.fact(
      "samples",
      text("%zu columns, %.0f MB on a rank%s",
           samples * as_size(body.model.B.columns()) * (body.model.undamped() ? 1 : 2),
           samples_mb(body.model, samples),
           solves.groups().count > 1 ? ", twice that while they move" : ""));
}

ReducedModel reduce_by_samples(const Body& body, const Settings& s, Observer& observer,
                               const CheckpointSpec& checkpoint) {
  FrequencySolves solves = prepare_samples(body, s, observer);
  solves.keep(checkpoint);
  describe_samples(solves, body, s, observer);
  observer.print();
  const BodyFacts facts = check(body, s, observer);
  observer.print();
  return reduce_pod(body.model, solves, s.sampling_spec(), facts.rigid_modes, observer);
}

/// The medium model is made by all ranks together.
void tell_of_groups(const Settings& s, Observer& observer) {
  if (s.groups > 0)
    observer.skip("groups", "one factorisation at a time, by all ranks: -mor_groups is "
                            "for sweep and -mor_method pod");
}

/// The values of the body's parameters with which the claim is to hold, told with their price.
/// @throws Error for too many of them, or for a body that nothing damps.
std::vector<ParameterValues> values_to_claim(const SecondOrderModel& body,
                                             const Settings& s, Observer& observer) {
  const std::vector<Law> parameters = parameters_of(body.terms);
  if (parameters.empty()) return {};
  const bool is_damped =
      body.damping.alpha > 0 || body.damping.beta > 0 || body.damping.eta > 0 ||
      std::any_of(body.terms.begin(), body.terms.end(), [](const auto& term) {
        if (term.law.is_skew()) return false;
        if (term.law.is_product()) return term.law.number("least") > 0;
        return term.law.is_parameter() ? term.law.number("loss") > 0
                                       : !term.law.varies() && term.law.is_semidefinite();
      });
  if (!is_damped)
    throw Error("a body with parameters needs some damping for a claim: its resonances "
                "move with them; give alpha, beta, eta or loss factors (eta = 1e-3 is "
                "little)");
  constexpr double most = 1000;
  const double count = number_of_values(parameters, s.parameter_values);
  if (count > most)
    throw Error(text("%.0f combinations of values of %zu parameters: no more than %.0f, "
                     "{parameter_values} makes them fewer",
                     count, parameters.size(), most));
  std::vector<ParameterValues> values = values_that_show(parameters, s.parameter_values);
  std::string words = text("the claim is to hold with %zu combination%s of the "
                           "parameters' values, each as much dense work as a body",
                           values.size(), values.size() == 1 ? "" : "s");
  if (values.size() > 1)
    words += text("; then with all values between, a proof that is given up after %.0e "
                  "operations on a rank",
                  ErrorBetween::most_work);
  observer.fact("values", words);
  return values;
}

/// What the factorisation of the medium model will take.
void describe_two_step(const Body& body, const Settings& s, Observer& observer) {
  observer.fact("method", s.method + " over " + words_of(s.bands()));
  tell_of_groups(s, observer);
  values_to_claim(body.model, s, observer);
  Stage stage(observer, "analyse");
  ShiftedSolver solver(body.model.K, body.model.M, {}, body.model.node, s.solver);
  choose_factors(solver, body.model, s.solver, observer, true);
}

/// Whether to find what a moving frame needs of the body: where it can move and has
/// coordinates.
bool wants_integrals(const SecondOrderModel& body, int rigid_modes, const Settings& s,
                     Observer& observer) {
  const bool possible = has_coordinates(body);
  if (s.frame_integrals == Wish::no || !possible) {
    if (s.frame_integrals == Wish::yes)
      throw Error(
          "-mor_frame_integrals yes: the body has no coordinates (/dofs, /nodes)");
    if (s.stiffening)
      throw Error("{stiffening} is one of the frame integrals: {frame_integrals} no");
    observer.skip("frame integrals",
                  possible ? "-mor_frame_integrals no" : "the body has no coordinates");
    return false;
  }
  if (s.frame_integrals == Wish::automatic && rigid_modes < 6 && !s.stiffening) {
    observer.skip("frame integrals", "the body cannot move freely");
    return false;
  }
  constexpr double no_rounding = 1e-6;
  if (rigid_modes >= 6 && misfit_of_positions(body) > no_rounding) {
    const std::string words = text(
        "the coordinates do not fit K: it has %d rigid modes, but the motions of its "
        "nodes as a rigid body are not among them; look at the order of the "
        "positions, their axes and components, and for a part that nothing holds or "
        "joins to the others",
        rigid_modes);
    if (s.frame_integrals == Wish::yes) throw Error("-mor_frame_integrals yes: " + words);
    observer.warn(words + ". No frame integrals, and shapes are not to be trusted");
    return false;
  }
  if (rigid_modes >= 6 && !body.turns_by_nodes)
    observer.warn(
        "for multibody codes, some terms of second order are approximate: centrifugal "
        "and Coriolis forces at ties with a gap, at equations of some directions (as of "
        "RBE3) and at masses beside their nodes");
  if (rigid_modes >= 6 && s.spin_loads && s.relative_to != RelativeTo::elastic &&
      s.relative_to != RelativeTo::both)
    observer.warn(
        "|H| from spin to inertia is mostly rigid rotation: only "
        "-mor_tol_relative_to both or elastic bounds what a spin does to the body");
  if (rigid_modes >= 6 && !s.spin_loads)
    observer.skip("spin loads", "what the body's own spin does to it is no load here: "
                                "-mor_spin_loads yes for fast or soft rotors");
  return true;
}

/// Geometric stiffening is that of a body which the frame's interface holds.
void hold_for_stiffening(Frame& frame, Observer& observer) {
  if (!frame.integrals || frame.integrals->stiffening.held.empty()) return;
  LoadMatrices& stiffening = frame.integrals->stiffening;
  if (!frame.interface.empty()) stiffening = stiffening.held_at(frame.interface);
  observer.fact("held", text("%s holds the body for its geometric stiffening: forces "
                             "there make no stress of their own",
                             interfaces_of(stiffening.held).front().first.c_str()));
  if (frame.kind == "none")
    observer.warn(
        "{stiffening} is for a floating frame, and there is none ({frame} none)");
}

void tell_integrals(const FrameIntegrals& i, Observer& observer) {
  observer.fact("frame integrals", text("mass %.6g kg, centre (%.4g, %.4g, %.4g) m",
                                        i.mass, i.centre[0], i.centre[1], i.centre[2]));
}

void add_frame_integrals(ReducedModel& rom, const Body& body, const Settings& s,
                         Observer& observer) {
  if (!rom.frame.integrals) {
    if (!wants_integrals(body.model, rom.frame.rigid_modes, s, observer)) return;
    Stage stage(observer, "frame");
    rom.frame.integrals = frame_integrals(body.model, rom.V);
  }
  tell_integrals(*rom.frame.integrals, observer);
  hold_for_stiffening(rom.frame, observer);
}

void warn_of_default_band(const Options& options, Observer& observer) {
  for (const Option& option : options.all())
    if (const auto ends = split(option.value, ',');
        option.name == "-mor_band_hz" && !option.set_by_user)
      observer.warn("{band_hz} is not given: the band is " +
                    (ends.size() == 2 ? ends[0] + " to " + ends[1] : option.value) +
                    " Hz");
}

/// The checkpoint of work that is done: what this run wrote or went on from. Of the
/// folder of samples only samples.
void remove(const CheckpointSpec& checkpoint, MPI_Comm comm) {
  namespace fs = std::filesystem;
  // A run that was killed before its first sample has left an empty folder.
  if (!(*checkpoint.used || checkpoint.restart) || comm_rank(comm) != 0) return;
  std::error_code ignored;
  if (fs::is_directory(checkpoint.path, ignored)) {
    std::vector<fs::path> files;
    for (const auto& entry : fs::directory_iterator(checkpoint.path, ignored)) {
      const std::string name = entry.path().filename().string();
      if (name.size() >= 19 && name.substr(16, 3) == ".h5" &&
          name.find_first_not_of("0123456789abcdef") == 16)
        files.push_back(entry.path());
    }
    for (const auto& file : files) fs::remove(file, ignored);
  }
  fs::remove(checkpoint.path, ignored); // a folder only if it is empty now
}

bool write_result(const ReducedModel& rom, const SecondOrderModel& body,
                  const Settings& s, const Options& options, Observer& observer,
                  std::optional<std::filesystem::file_time_type> before) {
  warn_of_another_run(s.out, before, observer);
  {
    Stage stage(observer, "write");
    write_reduced(rom, options, observer, body, s.out);
  }
  say_result(rom, body, observer);
  say_time(observer, body.comm);
  observer.say("  wrote          " + s.out);
  const std::string page =
      std::filesystem::path(s.out).replace_extension("html").string();
  say_next("flexgram report " + quoted(s.out) + " -o " + quoted(page), observer);
  return !rom.claim.supremum || rom.claim.supremum->met;
}

} // namespace

Medium certify_body(const Body& body, const Settings& s, bool keep, Observer& observer,
                    const CheckpointSpec& checkpoint) {
  if (keep && (s.load_patterns > 0 || !s.loads.empty()))
    throw Error(
        "{loads} and {load_patterns} are of flexgram reduce: a medium model keeps "
        "each port");
  observer.fact("method", s.method + " over " + words_of(s.bands()));
  tell_of_groups(s, observer);
  const BodyFacts facts = check(body, s, observer);
  observer.print();
  CertifySpec spec = s.certify_spec();
  spec.keep_levels = keep;
  const std::vector<Law> parameters = parameters_of(body.model.terms);
  spec.values = values_to_claim(body.model, s, observer);
  spec.between = values_between(parameters, s.parameter_values);
  SolverOptions solver = s.solver;
  solver.order = facts.order;
  Medium medium =
      certify(body.model, facts.mass_is_singular, spec, solver, observer, checkpoint);
  observer.print();
  if (keep && wants_integrals(body.model, medium.rigid, s, observer)) {
    Stage stage(observer, "frame");
    medium.integrals = frame_integrals(body.model, medium.V);
  }
  return medium;
}

ReducedModel cut_medium(const Medium& medium, const Settings& s, Observer& observer) {
  if (s.takes_samples())
    throw Error("-mor_method pod samples the body itself: flexgram reduce does it");
  ReducedModel rom = cut(medium, s.cut_request(), observer);
  hold_for_stiffening(rom.frame, observer);
  rom.provenance.plan = observer.facts();
  return rom;
}

namespace {

ReducedModel reduce_for_ports(const Body& body, const Settings& s, Observer& observer,
                              const CheckpointSpec& checkpoint) {
  CutRequest request = s.cut_request();
  request.inputs.clear(); // the body has no other ports
  request.outputs.clear();
  ReducedModel rom =
      s.takes_samples()
          ? reduce_by_samples(body, s, observer, checkpoint)
          : cut(certify_body(body, s, false, observer, checkpoint), request, observer);
  add_frame_integrals(rom, body, s, observer);
  return rom;
}

/// Doubles hold no such tolerance of most bodies, and the search for it is long.
void warn_of_tiny_tolerance(const Settings& s, Observer& observer) {
  constexpr double tiny = 1e-11;
  if (s.order.tolerance && *s.order.tolerance < tiny)
    observer.warn(text("a tolerance of %g is near the rounding of doubles: the run may "
                       "take long and not meet it. 1e-8 is met by most bodies",
                       *s.order.tolerance));
}

} // namespace

ReducedModel reduce_body(const Body& body, const Settings& s, Observer& observer,
                         const CheckpointSpec& checkpoint) {
  warn_of_tiny_tolerance(s, observer);
  observer.print();
  ReducedModel rom;
  if (auto loads = loads_of(body, s, observer)) {
    const Body narrow{with_patterns(body.model, *loads), body.assembled};
    rom = reduce_for_ports(narrow, s, observer, checkpoint);
    restore_ports(rom, body.model, std::move(*loads));
    observer.fact("claim",
                  text("of the motion along these %zu loads in answer to any in their "
                       "span, relative to all of them together; the body keeps its %zu "
                       "inputs",
                       rom.claim.loads->names.size(), rom.system.inputs.size()));
  } else {
    rom = reduce_for_ports(body, s, observer, checkpoint);
  }
  observer.print();
  rom.provenance.plan = observer.facts();
  return rom;
}

void tell_medium(const Medium& medium, Observer& observer) {
  observer.fact(
      "medium model",
      text("%s: n = %lld, order %d (%zu levels), %s, over %s, modes below %.4g Hz",
           medium.body.name.c_str(), static_cast<long long>(medium.body.n),
           medium.levels.back().order(), medium.levels.size(), medium.claim().c_str(),
           words_of(medium.spec.bands).c_str(), medium.cutoff * hz));
}

void write_medium_file(const Medium& medium, const Settings& s, const Options& options,
                       Observer& observer, const std::string& path) {
  Stage stage(observer, "write");
  std::map<std::string, std::string> values;
  for (const Option& option : options.all()) values[option.name] = option.value;
  write_medium(medium, s.medium_basis, values, observer.facts(), path);
}

/// Where a checkpoint may be kept, Ctrl-C writes one, too.
void let_signals_ask(const CheckpointSpec& checkpoint) {
  let_sigterm_ask();
  if (checkpoint.when != CheckpointSpec::When::never) let_ctrl_c_ask();
}

bool reduce(MPI_Comm comm, Settings& s, const Options& options, Observer& observer) {
  s.check();
  if (s.medium_out.empty()) s.choose_tolerance(observer); // else it serves later cuts too
  const CheckpointSpec checkpoint = s.checkpoint_spec(s.out);
  let_signals_ask(checkpoint);
  check_output(comm, s.out, {s.body, s.loads});
  check_default_output(comm, s.out, options, "-mor_out", "/gramian");
  check_checkpoint(comm, checkpoint);
  const auto before = written_at(s.out);
  if (s.medium_out.empty()) {
    const Body body = load_body(comm, s, observer);
    warn_of_default_band(options, observer);
    const ReducedModel rom = reduce_body(body, s, observer, checkpoint);
    const bool met = write_result(rom, body.model, s, options, observer, before);
    remove(checkpoint, comm);
    return met;
  }
  if (s.takes_samples())
    throw Error("-mor_method pod has no medium model: -mor_medium_out is for the others");
  if (is_same_file(s.medium_out, s.out))
    throw Error("-mor_medium_out and -mor_out name the same file, " + s.out);
  check_output(comm, s.medium_out, {s.body});
  const Body body = load_body(comm, s, observer);
  warn_of_default_band(options, observer);
  observer.print();
  const Medium medium = certify_body(body, s, true, observer, checkpoint);
  write_medium_file(medium, s, options, observer, s.medium_out);
  remove(checkpoint, comm);
  observer.say("  wrote          " + s.medium_out);
  s.choose_tolerance(observer);
  ReducedModel rom = cut_medium(medium, s, observer);
  if (rom.frame.integrals) tell_integrals(*rom.frame.integrals, observer);
  observer.print();
  rom.provenance.plan = observer.facts();
  return write_result(rom, medium.body, s, options, observer, before);
}

void certify(MPI_Comm comm, Settings& s, const Options& options, Observer& observer) {
  s.check();
  if (s.takes_samples())
    throw Error("-mor_method pod has no medium model to certify: flexgram reduce");
  const std::string out = s.medium_out.empty() ? "medium.h5" : s.medium_out;
  check_output(comm, out, {s.body});
  check_default_output(comm, out, options, "-mor_medium_out", "levels");
  const auto before = written_at(out);
  const CheckpointSpec checkpoint = s.checkpoint_spec(out);
  check_checkpoint(comm, checkpoint);
  let_signals_ask(checkpoint);
  const Body body = load_body(comm, s, observer);
  warn_of_default_band(options, observer);
  observer.print();
  const Medium medium = certify_body(body, s, true, observer, checkpoint);
  if (medium.integrals) tell_integrals(*medium.integrals, observer);
  observer.print();
  warn_of_another_run(out, before, observer);
  write_medium_file(medium, s, options, observer, out);
  remove(checkpoint, comm);
  observer.say(text("Medium model of %d dofs: %s.", medium.levels.back().order(),
                    medium.claim().c_str()));
  say_time(observer, comm);
  observer.say("  wrote          " + out);
  say_next("flexgram cut " + quoted(out) + " --tol 1e-4 -o rom.h5", observer);
}

bool cut(MPI_Comm comm, Settings& s, const Options& options, Observer& observer) {
  s.check();
  s.choose_tolerance(observer);
  if (s.medium.empty())
    throw Error(
        "no medium model: name a file of flexgram certify, flexgram cut medium.h5");
  check_output(comm, s.out, {s.medium});
  check_default_output(comm, s.out, options, "-mor_out", "/gramian");
  const auto before = written_at(s.out);
  Medium medium;
  {
    Stage stage(observer, "read");
    medium = read_medium(comm, s.medium);
  }
  tell_medium(medium, observer);
  observer.print();
  ReducedModel rom = cut_medium(medium, s, observer);
  if (rom.frame.integrals) tell_integrals(*rom.frame.integrals, observer);
  if (!medium.V) observer.skip("V", "the medium model is kept without its basis");
  observer.print();
  rom.provenance.plan = observer.facts();
  return write_result(rom, medium.body, s, options, observer, before);
}

void plan_only(MPI_Comm comm, Settings& s, const Options& options, Observer& observer) {
  s.check();
  const Body body = load_body(comm, s, observer);
  warn_of_default_band(options, observer);
  observer.skip("checks that factorise", "plan only analyses");
  if (s.takes_samples()) {
    FrequencySolves solves = prepare_samples(body, s, observer);
    describe_samples(solves, body, s, observer);
  } else {
    describe_two_step(body, s, observer);
  }
  observer.print();
  say_time(observer, comm);
}

} // namespace flexgram
