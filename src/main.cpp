/// flexgram: reduces elastic bodies of multibody systems.

#include "io/body_io.hpp"
#include "run/reduce.hpp"
#include "run/sweep.hpp"
#include "session.hpp"

namespace flexgram {
namespace {

const char* const usage =
    "flexgram reduces elastic bodies of multibody systems.\n\n"
    "  flexgram reduce   -body body.h5 [-mor_band_hz 10,500] [-mor_out rom.h5]\n"
    "  flexgram certify  -body body.h5 [-mor_band_hz 10,500] [-mor_medium_out "
    "medium.h5]\n"
    "  flexgram cut      -medium medium.h5 [-mor_tol 1e-4] [-mor_out rom.h5]\n"
    "  flexgram sweep    -body body.h5 [-rom rom.h5] [-mor_sweep_hz 10,500,200]\n"
    "  flexgram assemble -body mesh.h5 -body_out matrices.h5\n"
    "  flexgram plan     -body body.h5          what would be done and skipped, "
    "memory\n\n"
    "Exit status: 0; 1 for errors, with one message; 2 if -mor_tol is not met: the best "
    "body\n"
    "found is written all the same, with the error that it is certified to; 3 if SIGTERM "
    "ended\nit, with a checkpoint (-mor_restart).\n\n"
    "Runs under mpirun; takes -options_file, -log_view and every PETSc option.\n"
    "Options [default]:\n";

constexpr int tolerance_not_met = 2;

void assemble(MPI_Comm comm, const Settings& s, Observer& observer) {
  if (s.body_out.empty())
    throw Error("option -body_out is missing: name the file to write");
  check_output(comm, s.body_out, {s.body});
  const Body body = load_body(comm, s, observer);
  if (!body.assembled)
    throw Error(s.body + " holds matrices, there is nothing to assemble");
  observer.print();
  {
    Stage stage(observer, "write");
    write_body(body.model, s.body_out);
  }
  print_summary(observer, comm);
  observer.say("  wrote          " + s.body_out);
}

int run(const std::string& verb, MPI_Comm comm) {
  Settings settings;
  Options options;
  settings.describe(options);
  options.reject_unknown();
  Observer observer(comm, settings.prepare(comm));
  if (verb == "reduce")
    return reduce(comm, settings, options, observer) ? 0 : tolerance_not_met;
  if (verb == "cut")
    return cut(comm, settings, options, observer) ? 0 : tolerance_not_met;
  if (verb == "certify")
    certify(comm, settings, options, observer);
  else if (verb == "sweep")
    sweep(comm, settings, options, observer);
  else if (verb == "assemble")
    assemble(comm, settings, observer);
  else
    plan_only(comm, settings, observer);
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
  return run_session(
      argc, argv, {"reduce", "certify", "cut", "sweep", "assemble", "plan"}, help(), run);
}
