/// flexgram: reduces elastic bodies of multibody systems.

#include "model/body_io.hpp"
#include "run/reduce.hpp"
#include "run/sweep.hpp"
#include "session.hpp"

namespace flexgram {
namespace {

const char* const usage =
    "flexgram reduces elastic bodies of multibody systems.\n\n"
    "  flexgram reduce   -body body.h5 [-mor_band_hz 10,500] [-mor_out rom.h5]\n"
    "  flexgram sweep    -body body.h5 [-rom rom.h5] [-mor_sweep_hz 10,500,200]\n"
    "  flexgram assemble -body mesh.h5 -body_out matrices.h5\n"
    "  flexgram plan     -body body.h5          what would be done and skipped, "
    "memory\n\n"
    "Exit status: 0; 1 for errors, with one message; 2 if -mor_tol is not met: the best "
    "body\n"
    "found is written all the same, with the error that it is certified to.\n\n"
    "Runs under mpirun; takes -options_file, -log_view and every PETSc option.\n"
    "Options [default]:\n";

constexpr int tolerance_not_met = 2;

void assemble(MPI_Comm comm, const Settings& s, Monitor& monitor) {
  Plan plan;
  if (s.body_out.empty())
    throw Error("option -body_out is missing: name the file to write");
  check_output(comm, s.body_out, {s.body});
  const Body body = load_body(comm, s, plan, monitor);
  if (!body.assembled)
    throw Error(s.body + " holds matrices, there is nothing to assemble");
  plan.print(monitor);
  {
    Stage stage(monitor, "write");
    write_body(body.model, s.body_out);
  }
  print_summary(monitor, comm);
  monitor.say("  wrote          " + s.body_out);
}

int run(const std::string& verb, MPI_Comm comm) {
  Settings settings;
  Options options;
  settings.describe(options);
  options.reject_unknown();
  Monitor monitor(comm, settings.prepare(comm));
  if (verb == "reduce")
    return reduce(comm, settings, options, monitor) ? 0 : tolerance_not_met;
  if (verb == "sweep")
    sweep(comm, settings, options, monitor);
  else if (verb == "assemble")
    assemble(comm, settings, monitor);
  else
    plan_only(comm, settings, monitor);
  return 0;
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
