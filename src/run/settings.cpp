#include "run/settings.hpp"

#include "base/blas.hpp"
#include "base/process.hpp"
#include "base/text.hpp"
#include "basis/method.hpp"

#include <algorithm>

namespace flexgram {
namespace {

std::vector<std::string> method_names() {
  std::vector<std::string> names;
  for (const auto& [name, method] : flexgram::methods()) names.push_back(name);
  return names;
}

/// "name: what it is; …" of all methods.
std::string method_help() {
  std::string help;
  for (const auto& [name, method] : flexgram::methods())
    help += text("%s%s: %s", help.empty() ? "" : "; ", name.c_str(), method->help);
  return help;
}

const char* const all_verbs = "reduce certify cut sweep assemble plan";
const char* const all_but_cut = "reduce certify sweep assemble plan";

} // namespace

void Settings::describe(Options& options) {
  describe_files(options);
  describe_ports(options);
  describe_parameters(options);
  describe_accuracy(options);
  describe_method(options);
  describe_second_stage(options);
  describe_medium(options);
  describe_samples(options);
  describe_restart(options);
  options.section("Sweep", "sweep");
  options.add("-mor_sweep_hz", sweep_hz, "Hz",
              "first,last,count frequencies, or a single one");
  options.section("Parallel", "reduce sweep plan");
  options.add(
      "-mor_groups", groups, "",
      "groups of ranks; each holds the body and factorises its own frequencies (pod, "
      "sweep). 0: as many as the memory estimate allows (independent factorisations "
      "scale better than parallel ones)");
  describe_solver(options);
  options.section("Output", all_verbs);
  options.add_word(
      "-mor_monitor", monitor,
      {{"silent", Observer::Level::silent},
       {"summary", Observer::Level::summary},
       {"plan", Observer::Level::plan},
       {"detail", Observer::Level::detail}},
      "what is printed. summary: what came in and out, warnings, progress; plan "
      "(-v): what is done and skipped and why, with times; detail (-vv): a line "
      "for each factorisation too");
}

void Settings::describe_files(Options& options) {
  options.section("Files", all_but_cut);
  options.add("-body", body, "body file: matrices or a mesh");
  options.section("Files", "cut");
  options.add("-medium", medium, "certified medium model to cut from");
  options.section("Files", "reduce cut");
  options.add("-mor_out", out, "reduced file to write");
  options.section("Files", "reduce certify");
  options.add(
      "-mor_medium_out", medium_out,
      "certified medium model to write, for cut; default medium.h5 (certify), none "
      "(reduce)");
  options.add_word(
      "-mor_medium_basis", medium_basis, {{"yes", true}, {"no", false}},
      "write the basis V (n × N) into the medium file. Without it reduced files have no "
      "/V: no shapes, and no pictures of the body in a multibody code");
  options.section("Files", "sweep");
  options.add("-rom", rom, "reduced file to compare with the body");
  options.add("-mor_sweep_out", sweep_out, "file to write, with H over the frequencies");
  options.section("Files", "assemble");
  options.add("-body_out", body_out, "body of matrices to write");
}

void Settings::describe_ports(Options& options) {
  options.section("Ports", all_verbs);
  options.add("-mor_inputs", inputs,
              "ports to keep, by port (lower.fx) or interface (lower), comma separated");
  options.add("-mor_outputs", outputs,
              "the same for outputs; default: like the inputs where the outputs are "
              "the inputs, else all");
  options.section("Spin loads", all_but_cut);
  options.add_word(
      "-mor_spin_loads", spin_loads, {{"no", false}, {"yes", true}},
      "add the centrifugal loads of the body's own spin as six inputs, frame.spinxx … "
      "frame.spinzx for ω_x² … ω_zω_x [rad²/s²], and the change of its inertia as six "
      "outputs; for fast or soft rotors in a floating frame");
  options.section("Ports", "reduce");
  options.add(
      "-mor_loads", loads,
      "CSV of load cases to reduce for, instead of each input by itself: the first line "
      "names the load cases, and each other line is a port with its share of each. The "
      "error is then that of the motion along these load cases, in answer to any of "
      "their combinations; the reduced body keeps all ports");
  options.add(
      "-mor_load_patterns", load_patterns, "",
      "the same for this many leading load patterns of the inputs, those that move them "
      "most; for hundreds of ports and more. 0: each port by itself");
}

void Settings::describe_parameters(Options& options) {
  options.section("Parameters of the body", "reduce certify plan");
  options.add(
      "-mor_parameter_values", parameter_values, "",
      "values of each parameter of the body, from its least to its most, with which the "
      "error is bounded; all combinations, and the values that the body has. 0: 5 of "
      "one parameter, 3 of two, else 2; 1: those of the body alone");
  options.section("Parameters of the body", all_but_cut);
  options.add(
      "-mor_at", at,
      "values of the body's parameters in place of its own, E_rubber=2e6,k_bolt=1e7; "
      "with -mor_parameter_values 1 the claim is of these alone");
}

void Settings::describe_accuracy(Options& options) {
  options.section("Reduction", "reduce certify cut plan");
  options.add("-mor_band_hz", band_hz, "Hz",
              "frequency band, first,last; or one frequency; or several bands, "
              "first,last,first,last (cut: default the bands of the medium model)");
  band_is_given = options.all().back().set_by_user;
  options.add(
      "-mor_order", order_word,
      "order m of the reduced body; rule: smallest m with sigma_(m+1)/sigma_1 < "
      "sqrt(eps) "
      "= 1.5e-8, the paper's, whatever the error is; auto: by -mor_tol, or what "
      "-mor_method gives by itself (pod: the rule, modal: the modes in the band, ...)");
  options.add(
      "-mor_tol", order.tolerance, "",
      "smallest order whose relative error over the band is below this: the certified "
      "error, or with -mor_method pod the one at the samples and the check frequencies. "
      "Default without -mor_order: 1e-3, but for methods with an order of their own");
  options.add_word(
      "-mor_tol_of", order.each_kind, {{"each_kind", true}, {"whole", false}},
      "what -mor_tol bounds. whole: one error for H (eq. 17), which mixes m/N and "
      "rad/(N m). each_kind: also that of each kind of output from each kind of input, "
      "such as displacements from forces and rotations from moments (ports named x.fx "
      "... x.mz)");
  options.add_word(
      "-mor_field_error", field_error, {{"no", false}, {"yes", true}},
      "certify the error of the whole field of displacements too, for each kind of "
      "inputs: in the norm of the strain energy, relative to that of the field (not "
      "with a damping matrix)");
  options.add(
      "-mor_tol_kind", tolerances_of_kinds,
      "tolerances of single kinds: stress=1e-2,displacement from force=1e-5, or of "
      "outputs by name, foot.ry=1e-3 or foot.*=1e-3. The other kinds keep -mor_tol, and "
      "H as a whole has the largest of all. The error of a kind is relative to the "
      "Frobenius norm of its block of H, so small rows beside large ones need a name of "
      "their own");
  options.add_word("-mor_tol_relative_to", relative_to,
                   {{"both", RelativeTo::both},
                    {"pointwise", RelativeTo::pointwise},
                    {"elastic", RelativeTo::elastic},
                    {"band", RelativeTo::band}},
                   "what errors of H are divided by. pointwise: |H| at the same "
                   "frequency (eq. 17 of the "
                   "paper; near an antiresonance, where H itself vanishes, the order "
                   "grows to meet it). "
                   "elastic: |H| at the same frequency without the motion as a rigid "
                   "body, which is what "
                   "joints and springs at the interfaces of a free body leave. both: "
                   "the smaller of the "
                   "two; the same as pointwise for a body without rigid modes. band: "
                   "the largest |H| over "
                   "the band, which forgives antiresonances");
}

void Settings::describe_method(Options& options) {
  options.section("Reduction", "reduce cut");
  options.add_word(
      "-mor_port_scaling", equal_ports, {{"none", false}, {"equal", true}},
      "weight of the ports in the Gramian. equal: forces and moments (in N m or N mm) "
      "count alike. none: as their units have it (the paper)");
  options.add_word(
      "-mor_inner_product", metric,
      {{"mass", Metric::mass},
       {"euclidean", Metric::euclidean},
       {"energy", Metric::energy}},
      "in which the modes are orthonormal: mass (independent of units; M + "
      "K/omega_max^2 where M is singular), euclidean (the paper), energy (M + "
      "K/omega_max^2)");
  options.section("Reduction", "reduce certify cut plan");
  std::vector<std::string> names = method_names(), kinds{"two_step", "pod"},
                           stages{"auto"};
  kinds.insert(kinds.end(), names.begin(), names.end());
  stages.insert(stages.end(), names.begin(), names.end());
  options.add_choice(
      "-mor_method", method, kinds,
      ("two_step: medium model by real-shift Krylov with a proof of its error, then the "
       "smallest body out of it, by -mor_second_stage. pod: the paper's first route, POD "
       "of frequency samples, error estimated. The others: bodies of that kind out of "
       "the medium model, with the same proof. " +
       method_help())
          .c_str());
  options.section("Second stage (every method but pod)", "reduce certify cut plan");
  options.add_choice(
      "-mor_second_stage", second_stage, stages,
      "how -mor_method two_step picks the small basis out of the medium space; auto "
      "tries gramian and weighted and keeps the smallest body that meets -mor_tol (by "
      "the order rule: gramian)");
  options.add(
      "-mor_shifts_hz", shifts_hz, "Hz",
      "expansion points of krylov; default: both ends of the band and its middle");
}

void Settings::describe_second_stage(Options& options) {
  options.section("Second stage (every method but pod)", "reduce cut");
  options.add("-mor_weight", weight, "Hz, 1",
              "weight of the Gramian over the band: f1,w1,f2,w2,... , linear between, "
              "zero outside");
  options.add_word(
      "-mor_statics", statics, {{"no", false}, {"yes", true}},
      "include the static response to every port in the basis (of a free body its "
      "elastic part): at most one vector more for each port, and slow loads are as "
      "exact as the medium model");
  options.add("-mor_moments", moments, "", "moments at each expansion point of krylov");
  options.add_word(
      "-mor_frame", frame,
      {{"auto", FrameKind::automatic},
       {"none", FrameKind::none},
       {"buckens", FrameKind::buckens},
       {"tangent", FrameKind::tangent}},
      "frame of reference of a free body: buckens: basis vectors orthogonal to "
      "the rigid modes, which come first; tangent: at rest at an interface; none: "
      "rigid motion mixed into the basis. auto: buckens if the body is free");
  options.add("-mor_frame_interface", frame_interface,
              "interface that the tangent frame follows, and that holds a free body for "
              "its geometric stiffening; default: the first with six ports");
  options.add(
      "-mor_error_hz", error_hz, "Hz",
      "first,last,count: further frequencies at which error and bound are evaluated and "
      "stored, beside some hundred over the band and on its resonances");
}

void Settings::describe_medium(Options& options) {
  options.section("Medium model (every method but pod)", "reduce certify plan");
  options.add(
      "-mor_cutoff", cutoff, "",
      "all modes up to this many times the end of the band are found and counted; more "
      "modes, but fewer Krylov blocks");
  options.add("-mor_medium_order", medium_order, "",
              "largest order of the medium model; 0: what memory and the body allow");
  options.section("Medium model (every method but pod)", "reduce certify cut plan");
  options.add(
      "-mor_medium_tol", medium_target, "",
      "certified relative error of the medium model; 0: a fiftieth of -mor_tol, or 1e-8 "
      "where the order is given or ruled");
  options.section("Medium model (every method but pod)", "reduce certify");
  options.add_word(
      "-mor_frame_integrals", frame_integrals,
      {{"auto", Wish::automatic}, {"yes", Wish::yes}, {"no", Wish::no}},
      "mass, centre, inertia and the shape integrals that a floating frame of "
      "reference needs, into /frame; auto: if the body is free and has "
      "coordinates");
  options.add_word(
      "-mor_stiffening", stiffening, {{"no", false}, {"yes", true}},
      "geometric stiffening for a floating frame, into /frame: the stiffness by the "
      "stress under unit accelerations and spins of the frame and under unit forces at "
      "interfaces. For bodies given by a mesh; a static solve each. A free body is held "
      "at -mor_frame_interface for it");
}

void Settings::describe_samples(Options& options) {
  options.section("Samples (-mor_method pod)", "reduce plan");
  options.add("-mor_samples", samples, "",
              "frequencies at which the response is sampled");
  options.add_word("-mor_quadrature", quadrature,
                   {{"midpoint", QuadratureRule::midpoint},
                    {"gauss", QuadratureRule::gauss},
                    {"clenshaw_curtis", QuadratureRule::clenshaw_curtis}},
                   "rule for the integral of the Gramian over the band");
  options.add_word("-mor_spacing", logarithmic, {{"linear", false}, {"log", true}},
                   "nodes of the rule in the frequency or in its logarithm");
  options.add_word(
      "-mor_svd", snapshots, {{"tsqr", false}, {"snapshots", true}},
      "tsqr: singular values of the samples by a QR factorisation, to working "
      "accuracy. snapshots: Sirovich's method, eigenvalues of Z'Z; faster, but "
      "squares the condition: directions with sigma_j/sigma_1 below about 1e-16 "
      "(singular values below 1e-8) are lost, so high orders gain nothing");
  options.add("-mor_validate", validate, "",
              "frequencies between the samples at which the error is checked by full "
              "solves, beside the two ends of the band; 0 checks none");
}

void Settings::describe_restart(Options& options) {
  using When = CheckpointSpec::When;
  options.section("Checkpoint and restart", "reduce certify");
  options.add_word(
      "-mor_checkpoint", checkpoint,
      {{"auto", When::automatic}, {"yes", When::always}, {"no", When::never}},
      "write a checkpoint to OUTPUT.checkpoint (pod: to the folder OUTPUT.samples) "
      "after the modes, after each level of the medium model and after each sample. "
      "auto: once the work has taken 20 s (and for a medium model, if it takes at most "
      "about 3 % of the time since the last one), and when SIGTERM or Ctrl-C asks "
      "to end (exit status 3). It is removed when the output is written");
  options.add("-mor_restart", restart,
              "go on from the checkpoint, on any number of ranks; from the beginning if "
              "there is none. One of another body, band, ports or version is refused");
}

void Settings::describe_solver(Options& options) {
  MumpsOptions& mumps = solver.mumps;
  options.section("Factorisation", all_but_cut);
  options.add_word(
      "-mor_ordering", mumps.ordering,
      {{"auto", Ordering::automatic},
       {"best", Ordering::best},
       {"nested_dissection", Ordering::nested_dissection},
       {"mumps", Ordering::mumps}},
      "fill-reducing ordering: METIS nested dissection on the node graph, MUMPS' own "
      "choice, or the best (fewer estimated flops) of the two. auto: the best where many "
      "frequencies are factorised; elsewhere nested dissection, below 10,000 dofs MUMPS' "
      "own");
  options.add(
      "-mor_memory_limit_mb", mumps.memory_limit_mb, "MB per rank",
      "memory that the whole run may take: decides how factors are kept (-mor_precision) "
      "and is the limit of each factorisation; 0 means what the node has available");
  options.add("-mor_mumps_workspace", mumps.workspace_percent, "%",
              "workspace above MUMPS' estimate at the first try, ICNTL(14)");
  options.add("-mor_mumps_workspace_limit", mumps.workspace_limit, "%",
              "largest workspace tried when MUMPS asks for more");
  options.add_numbered("-mor_mumps_icntl_", mumps.icntl, "sets ICNTL(N) of MUMPS");
  options.add_numbered("-mor_mumps_cntl_", mumps.cntl, "sets CNTL(N) of MUMPS");
  options.add_word(
      "-mor_precision", solver.precision,
      {{"auto", Precision::automatic},
       {"double", Precision::double_precision},
       {"single", Precision::single_precision}},
      "arithmetic of the factors; single takes half the memory, is refined to double "
      "accuracy, and falls back to double where refinement stalls (it does within 1e-6 "
      "of an undamped resonance). auto: double where the run then fits into the memory, "
      "else single, else single on disk; with pod and sweep always double");
  options.add(
      "-mor_refinements", solver.refinements, "",
      "refinement steps at most, taken while the backward error is above its target");
  options.add("-mor_backward_error", solver.backward_error, "",
              "target for the backward error of each solve");
}

void Settings::choose_tolerance(Observer& observer) {
  constexpr double default_tolerance = 1e-3;
  if (order.tolerance || order_word != "auto" || takes_samples()) return;
  for (const auto& name : methods())
    if (flexgram::method(name).rule) return;
  order.tolerance = default_tolerance;
  observer.fact("tolerance",
                text("%g, as none is given (-mor_tol, -mor_order)", default_tolerance));
}

Observer::Level Settings::prepare(MPI_Comm comm) {
  check_solver();
  auto& limit = solver.mumps.memory_limit_mb;
  if (limit == 0) limit = available_memory_mb(comm);
  keep_freed_pages();
  set_blas_threads(node_share(comm).cores_per_rank);
  return monitor;
}

} // namespace flexgram
