#include "verbs.hpp"

#include "base/text.hpp"
#include "python_verbs.hpp"
#include "run/settings.hpp"

#include <algorithm>

namespace flexgram {
namespace {

const CommonOption band{"-mor_band_hz", "FIRST,LAST",
                        "frequency band [Hz], or several: FIRST,LAST,FIRST,LAST"};
const CommonOption tolerance{"-mor_tol", "ERROR",
                             "largest relative error of H anywhere in the band [1e-3]"};
const CommonOption order{"-mor_order", "M", "order of the reduced body, for a tolerance"};
const CommonOption inputs{"-mor_inputs", "PORTS",
                          "ports to keep: interfaces (lower) or ports (lower.fx)"};
const CommonOption outputs{"-mor_outputs", "PORTS", "the same for outputs [the inputs]"};
const CommonOption frame{"-mor_frame", "KIND",
                         "moving frame of a free body: buckens, tangent, none [auto]"};
const CommonOption frame_interface{"-mor_frame_interface", "NAME",
                                   "interface that a tangent frame follows"};
const CommonOption statics{"-mor_statics", "",
                           "answer static loads at all ports without error"};
const CommonOption method{"-mor_method", "NAME",
                          "two_step with a proof, or pod, modal, craig_bampton, ..."};
const CommonOption at{"-mor_at", "NAME=VALUE", "values of the body's parameters"};
const CommonOption groups{"-mor_groups", "N",
                          "groups of ranks, each with its own frequencies [auto]"};
const CommonOption restart{"-mor_restart", "",
                           "go on from the checkpoint of an ended run"};

const char* const status_help =
    "Exit status: 0; 1 for errors, with one message; 2 if the tolerance is not met: the\n"
    "best body found is written all the same, with the error that it is certified to;\n"
    "3 if SIGTERM ended it, with a checkpoint (--restart). mpirun kills its ranks\n"
    "instead, so give them the limit:\n"
    "  mpirun -n 8 timeout --preserve-status 3400 flexgram ...\n";

const char* const all_help =
    "Each option has two names: --band on the command line, -mor_band_hz there too and "
    "in\nPETSc's options files (-options_file FILE, PETSC_OPTIONS). Every PETSc option "
    "works\nbeside them: -log_view, -malloc_debug, ...\n"
    "Options [default]:\n";

std::vector<Option> options_of(const std::string& verb) {
  Settings settings;
  Options options(Options::Mode::describe);
  settings.describe(options);
  std::vector<Option> own;
  for (const Option& option : options.all()) {
    const auto verbs = split(option.verbs, ' ');
    if (std::find(verbs.begin(), verbs.end(), verb) != verbs.end()) own.push_back(option);
  }
  return own;
}

std::string line(const std::string& name, const std::string& what) {
  return text("  %-26s %s\n", name.c_str(), what.c_str());
}

std::string help_of(const Verb& verb, bool all_options) {
  std::string words = "usage: flexgram " + verb.name + " " + verb.usage + "\n\n" +
                      verb.what + "\n\n  " + verb.example + "\n\n";
  if (all_options) {
    Settings settings;
    Options options(Options::Mode::describe);
    settings.describe(options);
    return words + status_help + "\n" + all_help + options.help(verb.name);
  }
  for (const CommonOption& common : verb.common) {
    const auto& files = verb.files.inputs;
    std::string name = common.value; // a file alone
    if (common.option == verb.files.output)
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
         status_help;
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
    words += text("  flexgram %-10s %s\n", verb.name.c_str(), verb.what.c_str());
  words += "\nand, of the Python package,\n\n";
  for (const auto& [name, what] : python_verbs())
    words += text("  flexgram %-10s %s\n", name.c_str(), what.c_str());
  return words + "\nflexgram VERB --help shows how to use one, --help-all its options.\n";
}

} // namespace

const std::vector<Verb>& program_verbs() {
  static const std::vector<Verb> verbs{
      {"reduce",
       "BODY [options]",
       "the smallest body that meets the tolerance over the band, with the proof of its "
       "error",
       "flexgram reduce rack.h5 --band 10,500 --tol 1e-4 -o rack.rom.h5",
       {{"-body"}, "-mor_out"},
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
      {"certify",
       "BODY [options]",
       "a medium model with its proof, once, to cut small bodies from",
       "flexgram certify rack.h5 --band 10,500 --tol 1e-6 -o rack.medium.h5",
       {{"-body"}, "-mor_medium_out"},
       {{"-body", "BODY", "body file, of flexgram import"},
        band,
        {"-mor_tol", "ERROR", "smallest tolerance of bodies that are cut from it [1e-3]"},
        {"-mor_medium_out", "FILE", "medium model to write [medium.h5]"},
        inputs,
        outputs,
        at,
        restart}},
      {"cut",
       "MEDIUM [options]",
       "a reduced body out of a certified medium model, without the body's matrices",
       "flexgram cut rack.medium.h5 --tol 1e-4 --inputs upper -o upper.rom.h5",
       {{"-medium"}, "-mor_out"},
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
      {"sweep",
       "BODY [ROM] [options]",
       "H of the full body over frequencies, and the error of a reduced one",
       "flexgram sweep rack.h5 rack.rom.h5 --sweep 10,500,200 -o rack.sweep.h5",
       {{"-body", "-rom"}, "-mor_sweep_out"},
       {{"-body", "BODY", "body file"},
        {"-rom", "ROM", "reduced file to compare with it"},
        {"-mor_sweep_hz", "FIRST,LAST,COUNT", "frequencies [Hz] [10,500,200]"},
        {"-mor_sweep_out", "FILE", "sweep file to write [sweep.h5]"},
        inputs,
        outputs,
        at,
        groups}},
      {"plan",
       "BODY [options]",
       "what reduce would do and skip, and its memory",
       "flexgram plan rack.h5 --band 10,500",
       {{"-body"}, ""},
       {{"-body", "BODY", "body file"}, band, tolerance, inputs, method}},
      {"assemble",
       "MESH_BODY -o FILE",
       "a body of matrices of a mesh",
       "flexgram assemble rack.h5 -o rack.matrices.h5",
       {{"-body"}, "-body_out"},
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
                                 [&](const Verb& v) { return v.name == name; });
  if (verb == verbs.end()) return words;
  return petsc_words(words, options_of(name), verb->files);
}

std::string help_text(const std::string& asked, bool all_options) {
  for (const Verb& verb : program_verbs())
    if (verb.name == asked) return help_of(verb, all_options);
  if (!all_options) return overview();
  Settings settings;
  Options options(Options::Mode::describe);
  settings.describe(options);
  return overview() + "\n" + status_help + "\n" + all_help + options.help();
}

} // namespace flexgram
