#include "run/body.hpp"

#include "base/process.hpp"
#include "base/text.hpp"
#include "fem/assembly.hpp"
#include "io/body_io.hpp"
#include "io/part_file.hpp"
#include "model/frame_integrals.hpp"
#include "model/parameters.hpp"
#include "model/rigid_body_modes.hpp"
#include "run/summary.hpp"

#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <filesystem>

namespace flexgram {

void check_output(MPI_Comm comm, const std::string& path,
                  const std::vector<std::string>& inputs) {
  namespace fs = std::filesystem;
  agree(comm, [&] {
    if (comm_rank(comm) != 0) return;
    const fs::path folder = fs::path(target_of(path)).parent_path();
    if (access(folder.empty() ? "." : folder.c_str(), W_OK) != 0)
      throw Error(text("cannot write %s: %s", path.c_str(), std::strerror(errno)));
    std::vector<std::string> all = inputs;
    int count = 0;
    char** words = nullptr;
    FG_CALL(PetscGetArgs(&count, &words));
    for (int k = 1; k + 1 < count; ++k)
      if (std::string(words[k]) == "-options_file") all.emplace_back(words[k + 1]);
    for (const auto& input : all) {
      std::error_code ignored;
      if (!input.empty() && fs::equivalent(path, input, ignored))
        throw Error(text("%s would replace the input %s", path.c_str(), input.c_str()));
    }
  });
}

namespace {

/// Whether there is a file that holds something else than `mark`. On one rank.
bool holds_something_else(const std::string& path, const std::string& mark) {
  if (!std::filesystem::exists(path)) return false;
  try {
    const Hdf5File file = Hdf5File::open(PETSC_COMM_SELF, path);
    const bool is_attribute = mark.find('/') == std::string::npos;
    return !(is_attribute ? file.has_attribute("/", mark) : file.exists(mark));
  } catch (const Error&) {
    return true; // no HDF5
  }
}

} // namespace

void check_default_output(MPI_Comm comm, const std::string& path, const Options& options,
                          const std::string& option, const std::string& mark) {
  const auto& all = options.all();
  const auto known = std::find_if(all.begin(), all.end(),
                                  [&](const auto& one) { return one.name == option; });
  if (known != all.end() && known->set_by_user) return;
  agree(comm, [&] {
    if (comm_rank(comm) == 0 && holds_something_else(path, mark))
      throw Error(text("%s is there and holds something else: name the output, %s",
                       path.c_str(), option.c_str()));
  });
}

void check_checkpoint(MPI_Comm comm, const CheckpointSpec& spec) {
  if (spec.when == CheckpointSpec::When::never && !spec.restart) return;
  agree(comm, [&] {
    namespace fs = std::filesystem;
    if (comm_rank(comm) != 0 || !fs::exists(spec.path)) return;
    if (spec.is_folder ? !fs::is_directory(spec.path)
                       : holds_something_else(spec.path, "/checkpoint"))
      throw Error(text("%s is there and is no checkpoint of flexgram: move it, name "
                       "another output, or set {checkpoint} no",
                       spec.path.c_str()));
  });
}

bool is_same_file(const std::string& one, const std::string& other) {
  namespace fs = std::filesystem;
  std::error_code ignored;
  return one == other || fs::equivalent(one, other, ignored) ||
         fs::weakly_canonical(one, ignored) == fs::weakly_canonical(other, ignored);
}

std::optional<std::filesystem::file_time_type> written_at(const std::string& path) {
  std::error_code failed;
  const auto time = std::filesystem::last_write_time(path, failed);
  return failed ? std::nullopt : std::optional(time);
}

void warn_of_another_run(const std::string& path,
                         std::optional<std::filesystem::file_time_type> before,
                         Observer& observer) {
  if (written_at(path) != before)
    observer.warn(text("%s was written by another run while this one worked, and is "
                       "replaced: give each run an output of its own",
                       path.c_str()));
}

namespace {

/// Behind the inputs and behind the outputs.
void add_spin_loads(SecondOrderModel& model) {
  if (!has_coordinates(model))
    throw Error("{spin_loads}: the body has no coordinates of its nodes");
  const Block loads = spin_loads(model);
  model.B = concatenate(model.B, loads);
  model.C = model.outputs_are_inputs ? model.B.share() : concatenate(model.C, loads);
  for (const char* axes : {"xx", "yy", "zz", "xy", "yz", "zx"})
    for (auto* names : {&model.inputs, &model.outputs})
      names->push_back(std::string("frame.spin") + axes);
}

} // namespace

Body load_body(MPI_Comm comm, const Settings& settings, Observer& observer) {
  if (settings.body.empty())
    throw Error("no body file is named: flexgram reduce part.h5, where flexgram import "
                "makes part.h5");
  Body body;
  const Hdf5File file = Hdf5File::open(comm, settings.body);
  body.assembled = holds_mesh(file);
  if (body.assembled) {
    AssemblyFacts facts;
    body.model =
        assemble_body(file, settings.solver, settings.stiffening, facts, observer);
    observer.fact("mesh",
                  text("%lld element%s, mass %.6g kg, worst shape %.2g",
                       static_cast<long long>(facts.elements),
                       facts.elements == 1 ? "" : "s", facts.mass, facts.worst_shape));
    if (facts.rigid_elements > 0)
      observer.skip("stiffness", text("%lld elements lie inside a rigid interface",
                                      static_cast<long long>(facts.rigid_elements)));
  } else {
    if (settings.stiffening)
      throw Error("{stiffening} needs the mesh of the body: assemble it with flexgram");
    Stage stage(observer, "read");
    body.model = read_body(file);
  }
  std::string passed_over;
  agree(comm, [&] { passed_over = not_read(file); });
  if (!passed_over.empty()) observer.warn(passed_over);
  begin_plan(body, settings, observer);
  return body;
}

namespace {

/// How many there are; with loads and outputs beside interfaces how many different ones,
/// each a column of the first block solve.
std::string words_of_ports(const SecondOrderModel& model) {
  const auto inputs = static_cast<long long>(model.inputs.size()),
             outputs = static_cast<long long>(model.outputs.size());
  const std::string count = text("%lld inputs, %lld outputs", inputs, outputs);
  if (model.outputs_are_inputs) return count + " (the same)";
  return count + text(", %lld by their names",
                      inputs + static_cast<long long>(model.further_outputs()));
}

} // namespace

namespace {

/// Gives the body's parameters the values that the user wants.
void take_values(SecondOrderModel& model, const Settings& settings) {
  for (const auto& [name, value] : settings.values_of_parameters()) {
    std::vector<std::string> known;
    bool found = false;
    for (auto& term : model.terms) {
      if (!term.law.varies()) continue;
      known.push_back(term.law.parameter());
      if (term.law.parameter() != name) continue;
      found = true;
      try {
        term.law = term.law.with("value", value);
      } catch (Error& error) {
        error.add_context("{at} " + name);
        throw;
      }
    }
    if (!found && known.empty())
      throw Error(text("{at} %s: the body has no parameters", name.c_str()));
    if (!found)
      throw Error(text("{at} %s: the body's parameters are %s, did you mean %s?",
                       name.c_str(), join(known).c_str(), nearest(name, known).c_str()));
  }
}

/// Between which numbers they are known.
void tell_parameters(const SecondOrderModel& model, Observer& observer) {
  std::string words;
  for (const Law& law : parameters_of(model.terms))
    words += text("%s%s from %g to %g (%g)", words.empty() ? "" : ", ",
                  law.parameter().c_str(), law.number("least"), law.number("most"),
                  law.number("value"));
  if (!words.empty()) observer.fact("parameters", words);
}

} // namespace

void begin_plan(Body& body, const Settings& settings, Observer& observer) {
  take_values(body.model, settings);
  select_ports(body.model, split(settings.inputs, ','), split(settings.outputs, ','));
  if (settings.spin_loads) add_spin_loads(body.model);
  const SecondOrderModel& model = body.model;
  observer.fact("body", text("%s: n = %lld, %.3g nonzeros in K", model.name.c_str(),
                             static_cast<long long>(model.n),
                             static_cast<double>(model.nonzeros())));
  observer.fact("ports", words_of_ports(model));
  observer.fact("damping", model.damping_class());
  tell_parameters(model, observer);
  for (const auto& [law, T] : model.terms)
    for (const Interval& band : settings.bands())
      if (band.first < law.kind().known().first || band.last > law.kind().known().last)
        throw Error(
            text("%s is known from %g to %g Hz, the band is %g to %g Hz: give its table "
                 "more frequencies, or {band_hz} fewer",
                 law.name().c_str(), hz * law.kind().known().first,
                 hz * law.kind().known().last, hz * band.first, hz * band.last));
  for (const auto& remark : model.remarks) observer.fact("symmetry", remark);
  for (const auto& doubt : model.doubts) observer.warn(doubt);
  if (model.undamped())
    observer.skip("complex arithmetic", "the body is undamped, its samples are real");
  say_body(model, observer);
}

BodyFacts check(const Body& body, const Settings& s, Observer& observer) {
  Stage stage(observer, "check");
  const bool pod = s.takes_samples();
  const BodyFacts facts = check_body(body.model, body.assembled, pod, s.solver, observer);
  if (pod) observer.fact("rigid modes", std::to_string(facts.rigid_modes));
  if (!pod)
    observer.skip("a factorisation for rigid modes",
                  "the method's own inertia counts them");
  if (facts.mass_is_singular) observer.fact("mass matrix", "singular (massless dofs)");
  for (const auto& what : facts.skipped) {
    const auto colon = what.find(": ");
    observer.skip(what.substr(0, colon), what.substr(colon + 2));
  }
  return facts;
}

} // namespace flexgram
