/// flexgram: reduces elastic bodies of multibody systems.

#include "base/blas.hpp"
#include "base/text.hpp"
#include "io/body_io.hpp"
#include "python_verbs.hpp"
#include "run/reduce.hpp"
#include "run/summary.hpp"
#include "run/sweep.hpp"
#include "session.hpp"
#include "verbs.hpp"

namespace flexgram {
namespace {

constexpr int tolerance_not_met = 2;

void assemble(MPI_Comm comm, const Settings& s, Observer& observer) {
  if (s.body_out.empty()) throw Error("no file to write: name it, -o matrices.h5");
  check_output(comm, s.body_out, {s.body});
  const Body body = load_body(comm, s, observer);
  if (!body.assembled)
    throw Error(s.body + " holds matrices, there is nothing to assemble");
  observer.print();
  {
    Stage stage(observer, "write");
    write_body(body.model, s.body_out);
  }
  say_time(observer, comm);
  observer.say("  wrote          " + s.body_out);
}

int run(const std::string& verb, MPI_Comm comm) {
  Settings settings;
  Options options;
  settings.describe(options);
  options.reject_unknown();
  if (verb == "plan" && settings.monitor == Observer::Level::summary)
    settings.monitor = Observer::Level::plan; // which is all that it makes
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
    plan_only(comm, settings, options, observer);
  return 0;
}

std::vector<std::string> verb_names() {
  std::vector<std::string> names;
  for (const Verb& verb : program_verbs()) names.push_back(verb.words.name);
  for (const auto& verb : python_verbs()) names.push_back(verb.first);
  return names;
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
  return run_session(argc, argv, {verb_names(), petsc_words_of, help_text, run});
}
