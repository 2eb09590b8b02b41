#include "verbs.hpp"

#include "base/text.hpp"
#include "python_verbs.hpp"
#include "run/settings.hpp"

#include <algorithm>

namespace flexgram {
namespace {

const CommonOption band{"-mor_band_hz", "FIRST,LAST",
                        "frequency band [Hz], or several: FIRST,LAST,... [10,500]"};
const CommonOption tolerance{"-mor_tol", "ERROR",
                             "largest relative error of H anywhere in the band [1e-3]"};
const CommonOption order{"-mor_order", "M",
                         "order of the reduced body, instead of --tol"};
const CommonOption inputs{"-mor_inputs", "PORTS",
                          "ports to keep: interfaces (lower) or ports (lower.fx)"};
const CommonOption outputs{"-mor_outputs", "PORTS", "the same for outputs [the inputs]"};
const CommonOption frame{"-mor_frame", "KIND",
                         "moving frame of a free body: buckens, tangent, none [auto]"};
const CommonOption frame_interface{"-mor_frame_interface", "NAME",
                                   "interface that a tangent frame follows"};
const CommonOption statics{"-mor_statics", "",
                           "add the static response to every port to the basis"};
const CommonOption method{"-mor_method", "NAME",
                          "two_step with a proof; modal, craig_bampton, krylov, ..."};
const CommonOption at{"-mor_at", "NAME=VALUE", "values of the body's parameters"};
const CommonOption groups{"-mor_groups", "N",
                          "groups of ranks, each with its own frequencies [auto]"};
const CommonOption restart{"-mor_restart", "",
                           "go on from the checkpoint of an ended run"};

const char* const status_help =
    "Exit status: 0; 1 for errors, with one message; 2 if the tolerance is not met: the\n"
    "best body found is written all the same, with the error that it is certified to;\n"
    "3 if SIGTERM or Ctrl-C ended it, with a checkpoint (--restart). mpirun kills its "
    "ranks\n"
    "instead, so give them the limit:\n"
    "  mpirun -n 8 timeout --preserve-status 3400 flexgram ...\n";

const char* const all_help =
    "Each option has two names: --band on the command line, -mor_band_hz there too and "
    "in\nPETSc's options files (-options_file FILE, PETSC_OPTIONS). Every PETSc option "
    "works\nbeside them: -log_view, -malloc_debug, ...\n"
    "-o FILE is the file that a verb writes. -v, -vv and -q are --monitor plan, detail, "
    "silent.\n\n"
    "Options [default]:\n";

Options registry() {
  Settings settings;
  Options options(Options::Mode::describe);
  settings.describe(options);
  return options;
}

/// Where the tolerance may be missed.
std::string status_of(const Verb& verb) {
  const bool has_tolerance =
      std::any_of(verb.common.begin(), verb.common.end(),
                  [](const CommonOption& c) { return c.option == "-mor_tol"; });
  return has_tolerance && !verb.words.output.empty() ? status_help
                                                     : "Exit status: 0; 1 for errors.\n";
}

std::string line(const std::string& name, const std::string& what) {
  return text("  %-26s %s\n", name.c_str(), what.c_str());
}

std::string help_of(const Verb& verb, bool all_options) {
  std::string words = "usage: flexgram " + verb.words.name + " " + verb.usage + "\n\n" +
                      verb.what + "\n\n  " + verb.example + "\n\n";
  if (all_options)
    return words + status_of(verb) + all_help + registry().help(verb.words.name);
  for (const CommonOption& common : verb.common) {
    const auto& files = verb.words.inputs;
    std::string name = common.value; // a file alone
    if (common.option == verb.words.output)
      name = "-o " + name;
    else if (std::find(files.begin(), files.end(), common.option) == files.end())
      name = short_name(common.option) + (name.empty() ? "" : " ") + name;
    words += line(name, common.what);
  }
  words +=
      line("-v, -vv, -q", "print the plan with its reasons; the solver too; nothing");
  words += line("--help-all", "all options, by theme");
  return words +
         "\nRuns under mpirun; takes -options_file, -log_view and every PETSc "
         "option.\n" +
         status_of(verb);
}

/// What to do first, and the verbs.
std::string overview() {
  std::string words =
      "flexgram reduces elastic bodies of multibody systems, with a proof of the "
      "error.\n\n"
      "From a mesh, or the files of an FE code, to a multibody code:\n"
      "  flexgram import part.yaml -o part.h5\n"
      "  flexgram reduce part.h5 --band 10,500 --tol 1e-4 -o part.rom.h5\n"
      "  flexgram report part.rom.h5 -o part.html\n"
      "  flexgram export part.rom.h5 --to exudyn -o part.npz\n\n"
      "Verbs:\n";
  for (const Verb& verb : program_verbs())
    words += text("  flexgram %-10s %s\n", verb.words.name.c_str(), verb.what.c_str());
  words += "\nand, of the Python package,\n\n";
  for (const auto& [name, what] : python_verbs())
    words += text("  flexgram %-10s %s\n", name.c_str(), what.c_str());
  return words + "\nflexgram VERB --help shows how to use one, --help-all its options.\n";
}

} // namespace

const std::vector<Verb>& program_verbs() {
  static const std::vector<Verb> verbs{
      {{"reduce", {"-body"}, "-mor_out"},
       "BODY [options]",
       "the smallest body that meets the tolerance over the band, with the proof of its "
       "error",
       "flexgram reduce rack.h5 --band 10,500 --tol 1e-4 -o rack.rom.h5",
       {{"-body", "BODY", "body file, of flexgram import"},
        band,
        tolerance,
        {"-mor_out", "FILE", "reduced file to write [rom.h5]"},
        order,
        inputs,
        outputs,
        frame,
        frame_interface,
        statics,
        method,
        at,
        restart}},
      {{"certify", {"-body"}, "-mor_medium_out"},
       "BODY [options]",
       "a medium model with its proof, once, to cut small bodies from",
       "flexgram certify rack.h5 --band 10,500 --tol 1e-6 -o rack.medium.h5",
       {{"-body", "BODY", "body file, of flexgram import"},
        band,
        {"-mor_tol", "ERROR", "smallest tolerance of bodies that are cut from it [1e-3]"},
        {"-mor_medium_out", "FILE", "medium model to write [medium.h5]"},
        inputs,
        outputs,
        at,
        restart}},
      {{"cut", {"-medium"}, "-mor_out"},
       "MEDIUM [options]",
       "a reduced body out of a certified medium model, without the body's matrices",
       "flexgram cut rack.medium.h5 --tol 1e-4 --inputs upper -o upper.rom.h5",
       {{"-medium", "MEDIUM", "file of flexgram certify"},
        {"-mor_band_hz", "FIRST,LAST", "frequency band [Hz] [that of the medium model]"},
        tolerance,
        {"-mor_out", "FILE", "reduced file to write [rom.h5]"},
        order,
        inputs,
        outputs,
        frame,
        frame_interface,
        statics,
        method}},
      {{"sweep", {"-body", "-rom"}, "-mor_sweep_out"},
       "BODY [ROM] [options]",
       "H of the full body over frequencies, and the error of a reduced one",
       "flexgram sweep rack.h5 rack.rom.h5 --sweep 10,500,200 -o rack.sweep.h5",
       {{"-body", "BODY", "body file"},
        {"-rom", "ROM", "reduced file to compare with it"},
        {"-mor_sweep_hz", "FIRST,LAST,COUNT", "frequencies [Hz] [10,500,200]"},
        {"-mor_sweep_out", "FILE", "sweep file to write [sweep.h5]"},
        inputs,
        outputs,
        at,
        groups}},
      {{"plan", {"-body"}, ""},
       "BODY [options]",
       "what reduce would do and skip, and its memory",
       "flexgram plan rack.h5 --band 10,500",
       {{"-body", "BODY", "body file"}, band, tolerance, inputs, method}},
      {{"assemble", {"-body"}, "-body_out"},
       "MESH_BODY -o FILE",
       "K and M of a mesh body, written as a body of matrices",
       "flexgram assemble rack.h5 -o rack.matrices.h5",
       {{"-body", "MESH_BODY", "body file that holds a mesh"},
        {"-body_out", "FILE", "body of matrices to write"},
        at}},
  };
  return verbs;
}

std::vector<std::string> petsc_words_of(const std::string& name,
                                        const std::vector<std::string>& words) {
  const auto& verbs = program_verbs();
  const auto verb = std::find_if(verbs.begin(), verbs.end(),
                                 [&](const Verb& v) { return v.words.name == name; });
  if (verb == verbs.end()) return words;
  return petsc_words(words, registry().all(), verb->words);
}

std::string help_text(const std::string& asked, bool all_options) {
  for (const Verb& verb : program_verbs())
    if (verb.words.name == asked) return help_of(verb, all_options);
  if (!all_options) return overview();
  return overview() + "\n" + status_help + "\n" + all_help + registry().help();
}

} // namespace flexgram
