/// flexgram: reduces elastic bodies of multibody systems.

#include "base/blas.hpp"
#include "base/text.hpp"
#include "io/body_io.hpp"
#include "python_verbs.hpp"
#include "run/reduce.hpp"
#include "run/sweep.hpp"
#include "session.hpp"

namespace flexgram {
namespace {

/// A verb of the program, as its help shows it.
struct Verb {
  std::string name, usage, what;
};

const std::vector<Verb> verbs{
    {"reduce", "-body body.h5 -mor_band_hz 10,500 [-mor_tol 1e-4] [-mor_out rom.h5]",
     "the smallest body that meets the tolerance over the band, with the proof of its "
     "error"},
    {"certify",
     "-body body.h5 -mor_band_hz 10,500 [-mor_tol 1e-8] [-mor_medium_out m.h5]",
     "a medium model with its proof, once, to cut small bodies from"},
    {"cut", "-medium m.h5 [-mor_tol 1e-4] [-mor_inputs upper] [-mor_out rom.h5]",
     "a reduced body out of a certified medium model, without the body's matrices"},
    {"sweep", "-body body.h5 [-rom rom.h5] -mor_sweep_hz 10,500,200",
     "H of the full body over frequencies, and the error of a reduced one"},
    {"plan", "-body body.h5 [-mor_band_hz 10,500]",
     "what reduce would do and skip, and its memory"},
    {"assemble", "-body mesh.h5 -body_out matrices.h5", "a body of matrices of a mesh"},
};

const char* const status_help =
    "Exit status: 0; 1 for errors, with one message; 2 if -mor_tol is not met: the best "
    "body\n"
    "found is written all the same, with the error that it is certified to; 3 if SIGTERM "
    "ended\nit, with a checkpoint (-mor_restart); mpirun kills its ranks instead, so "
    "give them "
    "the\nlimit: mpirun -n 8 timeout --preserve-status 3400 flexgram ...\n\n"
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

std::vector<std::string> verb_names() {
  std::vector<std::string> names;
  for (const Verb& verb : verbs) names.push_back(verb.name);
  for (const auto& verb : python_verbs()) names.push_back(verb.first);
  return names;
}

/// Help of a verb, or of the whole program; the verbs alone for no word.
std::string help(const std::string& asked) {
  Settings settings;
  Options options(Options::Mode::describe);
  settings.describe(options);
  for (const Verb& verb : verbs)
    if (verb.name == asked)
      return "flexgram " + verb.name + " " + verb.usage + "\n\n" + verb.what + "\n\n" +
             status_help + options.help(verb.name);
  std::string list = "flexgram reduces elastic bodies of multibody systems.\n\n";
  for (const Verb& verb : verbs)
    list += text("  flexgram %-9s %s\n", verb.name.c_str(), verb.what.c_str());
  list += "\nand, of the Python package,\n\n";
  for (const auto& [name, what] : python_verbs())
    list += text("  flexgram %-9s %s\n", name.c_str(), what.c_str());
  list +=
      "\nflexgram VERB -help shows the options of one, flexgram -help those of all.\n";
  return asked.empty() ? list : list + "\n" + status_help + options.help();
}

} // namespace
} // namespace flexgram

int main(int argc, char** argv) {
  using namespace flexgram;
  fit_blas_kernels();
  if (argc > 1 && is_python_verb(argv[1])) return run_python(argv);
  if (argc > 2 && std::string(argv[1]) == "help" && is_python_verb(argv[2])) {
    char help[] = "--help";
    char* words[] = {argv[0], argv[2], help, nullptr};
    return run_python(words);
  }
  return run_session(argc, argv, verb_names(), help, run);
}
