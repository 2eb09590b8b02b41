#include "run/settings.hpp"

#include "base/process.hpp"

namespace flexgram {

void Settings::describe(Options& options) {
  options.section("Files");
  options.add("-body", body, "body file: matrices or a mesh (all verbs)");
  options.add("-mor_out", out, "reduced file to write (reduce)");
  options.add("-rom", rom, "reduced file to compare with the body (sweep)");
  options.add("-mor_sweep_out", sweep_out, "file with H over the frequencies (sweep)");
  options.add("-body_out", body_out, "body of matrices to write (assemble)");
  options.section("Ports (all verbs)");
  options.add("-mor_inputs", inputs,
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
  options.add_choice(
      "-mor_frame_integrals", frame_integrals, {"auto", "yes", "no"},
      "mass, centre, inertia and the shape integrals that a floating frame of "
      "reference needs, into /frame; auto: if the body is free and has "
      "coordinates");
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

void Settings::check() const {
  if (samples()) gramian.nodes();
  gramian.check();
  pod.check();
  two_step.check();
  solver.check();
}

Monitor::Level Settings::prepare(MPI_Comm comm) {
  solver.check();
  auto& limit = solver.mumps.memory_limit_mb;
  if (limit == 0) limit = available_memory_mb(comm);
  keep_freed_pages();
  set_blas_threads(node_share(comm).cores_per_rank);
  return monitor == "silent"   ? Monitor::Level::silent
         : monitor == "detail" ? Monitor::Level::detail
                               : Monitor::Level::summary;
}

} // namespace flexgram
