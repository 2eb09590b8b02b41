/// flexgram: reduces elastic bodies of multibody systems. Reads like the method: read or
/// assemble the body, check it, plan, sample, decompose, project, write.

#include "base/process.hpp"
#include "base/text.hpp"
#include "fem/assembly.hpp"
#include "model/body_io.hpp"
#include "model/checks.hpp"
#include "reduce/pod.hpp"
#include "reduce/project.hpp"
#include "reduce/two_step.hpp"
#include "session.hpp"

#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <filesystem>
#include <numbers>

namespace flexgram {
namespace {

struct Settings {
  std::string body, rom, body_out, out = "rom.h5", sweep_out = "sweep.h5",
                                   monitor = "summary";
  std::string method = "two_step";
  std::string inputs, outputs;
  std::vector<double> sweep_hz{10, 500, 200};
  GramianOptions gramian;
  PodOptions pod;
  TwoStepOptions two_step;
  ParallelOptions parallel;
  SolverOptions solver;

  void describe(Options& options) {
    options.section("Files");
    options.add("-body", body, "body file: matrices or a mesh (all verbs)");
    options.add("-mor_out", out, "reduced file to write (reduce)");
    options.add("-rom", rom, "reduced file to compare with the body (sweep)");
    options.add("-mor_sweep_out", sweep_out, "file with H over the frequencies (sweep)");
    options.add("-body_out", body_out, "body of matrices to write (assemble)");
    options.section("Ports (all verbs)");
    options.add(
        "-mor_inputs", inputs,
        "ports to keep, by port (lower.fx) or interface (lower), comma separated");
    options.add("-mor_outputs", outputs,
                "the same for outputs; default: like the inputs where the outputs are "
                "the inputs, "
                "else all");
    gramian.describe(options);
    options.add_choice(
        "-mor_method", method,
        {"two_step", "pod", "krylov", "modal", "craig_bampton", "irka", "balanced"},
        "two_step: medium model by real-shift Krylov with a proof of its error, then the "
        "smallest "
        "body out of it. pod: the paper's first route, POD of frequency samples, error "
        "estimated. krylov, modal, craig_bampton, irka, balanced: bodies of that kind, "
        "with the "
        "same proof");
    two_step.describe(options);
    options.section("Samples (-mor_method pod)");
    gramian.describe_samples(options);
    pod.describe(options);
    options.section("Sweep");
    options.add("-mor_sweep_hz", sweep_hz, "Hz",
                "first,last,count frequencies, or a single one");
    parallel.describe(options);
    solver.describe(options);
    options.section("Output");
    options.add_choice("-mor_monitor", monitor, {"silent", "summary", "detail"},
                       "what is printed; detail adds a line for each factorisation");
  }
};

const char* const usage =
    "flexgram reduces elastic bodies of multibody systems.\n\n"
    "  flexgram reduce   -body body.h5 [-mor_band_hz 10,500] [-mor_out rom.h5]\n"
    "  flexgram sweep    -body body.h5 [-rom rom.h5] [-mor_sweep_hz 10,500,200]\n"
    "  flexgram assemble -body mesh.h5 -body_out matrices.h5\n"
    "  flexgram plan     -body body.h5          what would be done and skipped, "
    "memory\n\n"
    "Runs under mpirun; takes -options_file, -log_view and every PETSc option.\n"
    "Options [default]:\n";

/// Refuses an output that cannot be written or would replace an input, before any work.
void check_output(MPI_Comm comm, const std::string& path,
                  const std::vector<std::string>& inputs) {
  namespace fs = std::filesystem;
  agree(comm, [&] {
    if (comm_rank(comm) != 0) return;
    const fs::path folder = fs::path(path).parent_path();
    if (access(folder.empty() ? "." : folder.c_str(), W_OK) != 0)
      throw Error(text("cannot write %s: %s", path.c_str(), std::strerror(errno)));
    for (const auto& input : inputs) {
      std::error_code ignored;
      if (fs::equivalent(path, input, ignored))
        throw Error(text("%s would replace the input %s", path.c_str(), input.c_str()));
    }
  });
}

Monitor::Level level_of(const std::string& word) {
  return word == "silent"   ? Monitor::Level::silent
         : word == "detail" ? Monitor::Level::detail
                            : Monitor::Level::summary;
}

/// The body, its plan so far, and what the checks found.
struct Body {
  SecondOrderModel model;
  bool assembled = false;
};

Body load(MPI_Comm comm, const Settings& settings, Plan& plan, Monitor& monitor) {
  if (settings.body.empty()) throw Error("option -body is missing: name a body file");
  Body body;
  const Hdf5File file = Hdf5File::open(comm, settings.body);
  body.assembled = holds_mesh(file);
  if (body.assembled) {
    AssemblyFacts facts;
    body.model = assemble_body(file, facts, monitor);
    plan.fact("mesh", text("%lld elements, mass %.6g kg, worst shape %.2g",
                           static_cast<long long>(facts.elements), facts.mass,
                           facts.worst_shape));
    if (facts.rigid_elements > 0)
      plan.skip("stiffness", text("%lld elements lie inside a rigid interface",
                                  static_cast<long long>(facts.rigid_elements)));
  } else {
    Stage stage(monitor, "read");
    body.model = read_body(file);
  }
  select_ports(body.model, split(settings.inputs, ','), split(settings.outputs, ','));
  const SecondOrderModel& model = body.model;
  plan.fact("body",
            text("%s: n = %lld, %.3g nonzeros in K", settings.body.c_str(),
                 static_cast<long long>(model.n), static_cast<double>(model.nonzeros())));
  plan.fact("ports",
            text("%lld inputs, %lld outputs%s", static_cast<long long>(model.B.columns()),
                 static_cast<long long>(model.C.columns()),
                 model.outputs_are_inputs ? " (the same)" : ""));
  plan.fact("damping", model.damping_class());
  if (model.undamped())
    plan.skip("complex arithmetic", "the body is undamped, its samples are real");
  return body;
}

BodyFacts check(const Body& body, const Settings& s, Plan& plan, Monitor& monitor) {
  Stage stage(monitor, "check");
  const bool pod = s.method == "pod";
  const BodyFacts facts = check_body(body.model, body.assembled, pod, s.solver, monitor);
  if (pod) plan.fact("rigid modes", std::to_string(facts.rigid_modes));
  if (!pod)
    plan.skip("a factorisation for rigid modes", "the method's own inertia counts them");
  if (facts.mass_is_singular) plan.fact("mass matrix", "singular (massless dofs)");
  for (const auto& what : facts.skipped) {
    const auto colon = what.find(": ");
    plan.skip(what.substr(0, colon), what.substr(colon + 2));
  }
  return facts;
}

void plan_solves(const FrequencySolves& solves, std::size_t tasks, Plan& plan) {
  const FactorEstimate& e = solves.estimate();
  plan.fact("factorisation",
            text("%s %s, %.2g entries, %.2g flops, %.0f MB on a rank, ordered by %s",
                 solves.model().undamped() ? "real" : "complex symmetric", "LDLᵀ",
                 e.factor_entries, e.flops, e.mb_per_rank, solves.ordering().c_str()));
  plan.fact("parallel", text("%zu frequencies over %d group%s of %d rank%s", tasks,
                             solves.groups().count, solves.groups().count == 1 ? "" : "s",
                             comm_size(solves.groups().comm),
                             comm_size(solves.groups().comm) == 1 ? "" : "s"));
}

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

void summary(const Monitor& monitor, MPI_Comm comm) {
  std::string line;
  for (const auto& [stage, seconds] : monitor.stages())
    line += text("%s%s %.2f s", line.empty() ? "" : ", ", stage.c_str(), seconds);
  const double peak = max_over(comm, peak_memory_mb());
  monitor.say(text("  %-14s %s; peak %.0f MB on a rank", "time", line.c_str(), peak));
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

/// What the two factorisations of the medium model will take.
void describe_two_step(const Body& body, const Settings& s, Plan& plan,
                       Monitor& monitor) {
  Stage stage(monitor, "analyse");
  ShiftedSolver solver(body.model.K, body.model.M, nullptr, body.model.node, s.solver);
  const FactorEstimate cutoff = solver.analyse(true, Definiteness::indefinite);
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
  std::string bands;
  for (double f : s.gramian.band_hz) bands += text("%s%g", bands.empty() ? "" : "-", f);
  plan.fact("method", s.method + " over " + bands + " Hz");
  const BodyFacts facts = check(body, s, plan, monitor);
  plan.print(monitor);
  return reduce_two_step(body.model, s.method, s.gramian, s.two_step, s.solver,
                         facts.mass_is_singular, plan, monitor);
}

/// Refuses bad options before any work.
void check_options(const Settings& s) {
  if (s.method == "pod") s.gramian.nodes();
  s.gramian.check();
  s.pod.check();
  s.two_step.check();
}

void reduce(MPI_Comm comm, const Settings& s, const Options& options, Monitor& monitor) {
  Plan plan;
  check_options(s);
  check_output(comm, s.out, {s.body});
  const Body body = load(comm, s, plan, monitor);
  plan.print(monitor);
  const ReducedModel rom = s.method == "pod"
                               ? reduce_by_samples(body, s, plan, monitor)
                               : reduce_in_two_steps(body, s, plan, monitor);
  {
    Stage stage(monitor, "write");
    write_reduced(rom, options, monitor, s.out);
  }
  summary(monitor, comm);
  monitor.say("  wrote          " + s.out);
}

void plan_only(MPI_Comm comm, const Settings& s, Monitor& monitor) {
  Plan plan;
  check_options(s);
  const Body body = load(comm, s, plan, monitor);
  plan.skip("checks that factorise", "plan only analyses");
  if (s.method == "pod") {
    FrequencySolves solves = prepare_reduction(body, s, monitor);
    describe_reduction(solves, body, s, plan);
  } else {
    describe_two_step(body, s, plan, monitor);
  }
  plan.print(monitor);
  summary(monitor, comm);
}

std::vector<double> sweep_omega(const std::vector<double>& hz) {
  std::string words;
  for (double f : hz) words += text("%s%g", words.empty() ? "" : ",", f);
  require_option(hz.size() == 1 || (hz.size() == 3 && hz[2] >= 1), "-mor_sweep_hz", words,
                 "first,last,count or one frequency");
  require_option(hz[0] >= 0, "-mor_sweep_hz", words, "zero or more");
  require_option(hz.size() == 1 || hz[0] <= hz[1], "-mor_sweep_hz", words,
                 "first,last,count with first <= last");
  const double to_rad = 2 * std::numbers::pi;
  if (hz.size() == 1) return {hz[0] * to_rad};
  const int count = static_cast<int>(hz[2]);
  std::vector<double> omega;
  for (int l = 0; l < count; ++l)
    omega.push_back(to_rad *
                    (hz[0] + (count == 1 ? 0.0 : (hz[1] - hz[0]) * l / (count - 1))));
  return omega;
}

void write_sweep(MPI_Comm comm, const Settings& s, const std::vector<double>& omega,
                 const std::vector<ComplexDense>& H,
                 const std::vector<ComplexDense>& H_rom,
                 const std::vector<double>& epsilon, const SecondOrderModel& model,
                 const Options& options) {
  Hdf5File file = Hdf5File::create(comm, s.sweep_out);
  file.write("/omega", {static_cast<std::int64_t>(omega.size())}, omega);
  const auto write_transfer = [&](const char* name,
                                  const std::vector<ComplexDense>& list) {
    std::vector<double> values;
    for (const auto& h : list)
      for (int i = 0; i < h.rows; ++i)
        for (int j = 0; j < h.columns; ++j) {
          values.push_back(h(i, j).real());
          values.push_back(h(i, j).imag());
        }
    file.write(name,
               {static_cast<std::int64_t>(omega.size()), model.C.columns(),
                model.B.columns(), 2},
               values);
    file.set_attribute(name, "inputs", model.inputs);
    file.set_attribute(name, "outputs", model.outputs);
  };
  write_transfer("/H", H);
  if (!H_rom.empty()) {
    write_transfer("/H_rom", H_rom);
    file.write("/error/relative", {static_cast<std::int64_t>(epsilon.size())}, epsilon);
  }
  write_options(file, options);
  file.commit();
}

void sweep(MPI_Comm comm, const Settings& s, const Options& options, Monitor& monitor) {
  Plan plan;
  const std::vector<double> omega = sweep_omega(s.sweep_hz);
  check_output(comm, s.sweep_out, {s.body, s.rom});
  Body body = load(comm, s, plan, monitor);
  SecondOrderModel rom;
  if (!s.rom.empty()) {
    rom = read_reduced(comm, s.rom);
    const bool chosen = !s.inputs.empty() || !s.outputs.empty();
    SecondOrderModel& fewer =
        chosen ? rom : body.model; // without a choice the rom's ports count
    const SecondOrderModel& wanted = chosen ? body.model : rom;
    with_context("comparing " + s.rom + " with " + s.body,
                 [&] { select_ports(fewer, wanted.inputs, wanted.outputs); });
  }
  FrequencySolves solves(std::move(body.model), s.parallel, s.solver,
                         static_cast<int>(omega.size()), 0.0, monitor);
  plan_solves(solves, omega.size(), plan);
  plan.print(monitor);
  std::vector<ComplexDense> H, H_rom;
  {
    Stage stage(monitor, "sweep");
    H = solves.transfer(omega, "frequency");
  }
  std::vector<double> epsilon;
  if (rom.n > 0) {
    for (std::size_t l = 0; l < omega.size(); ++l) {
      H_rom.push_back(dense_transfer(rom, omega[l]));
      epsilon.push_back(relative_error(H[l], H_rom.back()));
    }
    const auto worst = std::max_element(epsilon.begin(), epsilon.end());
    plan.fact("error",
              text("at most %.2e of %zu frequencies, at %.4g Hz", *worst, omega.size(),
                   omega[static_cast<std::size_t>(worst - epsilon.begin())] * 0.5 /
                       std::numbers::pi));
  }
  plan.fact("solves", text("%d factorisations, backward error at most %.0e",
                           solves.factorisations(), solves.worst_backward_error()));
  plan.print(monitor);
  {
    Stage stage(monitor, "write");
    write_sweep(comm, s, omega, H, H_rom, epsilon, solves.model(), options);
  }
  summary(monitor, comm);
  monitor.say("  wrote          " + s.sweep_out);
}

void assemble(MPI_Comm comm, const Settings& s, Monitor& monitor) {
  Plan plan;
  if (s.body_out.empty())
    throw Error("option -body_out is missing: name the file to write");
  check_output(comm, s.body_out, {s.body});
  const Body body = load(comm, s, plan, monitor);
  if (!body.assembled)
    throw Error(s.body + " holds matrices, there is nothing to assemble");
  plan.print(monitor);
  {
    Stage stage(monitor, "write");
    write_body(body.model, s.body_out);
  }
  summary(monitor, comm);
  monitor.say("  wrote          " + s.body_out);
}

void run(const std::string& verb, MPI_Comm comm) {
  Settings settings;
  Options options;
  settings.describe(options);
  options.reject_unknown();
  settings.solver.check();
  Monitor monitor(comm, level_of(settings.monitor));
  auto& limit = settings.solver.mumps.memory_limit_mb;
  if (limit == 0) limit = available_memory_mb(comm);
  keep_freed_pages();
  set_blas_threads(node_share(comm).cores_per_rank);
  if (verb == "reduce")
    reduce(comm, settings, options, monitor);
  else if (verb == "sweep")
    sweep(comm, settings, options, monitor);
  else if (verb == "assemble")
    assemble(comm, settings, monitor);
  else
    plan_only(comm, settings, monitor);
}

std::string help() {
  Settings settings;
  Options options(Options::Mode::describe);
  settings.describe(options);
  return usage + options.help();
}

} // namespace
} // namespace flexgram

int main(int argc, char** argv) {
  using namespace flexgram;
  return run_session(argc, argv, {"reduce", "sweep", "assemble", "plan"}, help(), run);
}
