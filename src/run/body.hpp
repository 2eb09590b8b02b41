/// Reading, planning and checking a body, and what verbs have in common. Used by
/// run/reduce, run/sweep, main and the Python module.

#pragma once

#include "base/observer.hpp"
#include "model/checks.hpp"
#include "run/settings.hpp"

#include <filesystem>
#include <optional>

namespace flexgram {

/// A body, and whether it was assembled here.
struct Body {
  SecondOrderModel model;
  bool assembled = false;
};

/// Reads or assembles the body file, keeps the ports asked for and begins the plan.
/// Collective.
Body load_body(MPI_Comm comm, const Settings& settings, Observer& observer);

/// Keeps the ports asked for and begins the plan of a body that is already there.
void begin_plan(Body& body, const Settings& settings, Observer& observer);

/// The checks that the chosen method needs.
BodyFacts check(const Body& body, const Settings& settings, Observer& observer);

/// Refuses an output that cannot be written or would replace an input (the options file is
/// one), before any work. Inputs may be empty names.
void check_output(MPI_Comm comm, const std::string& path,
                  const std::vector<std::string>& inputs);
/// Refuses to replace a file by a name that nobody gave, unless that file is of its own kind.
/// @param option  by which the name is given.
/// @param mark    an object or, without a slash, an attribute of the root of such files.
void check_default_output(MPI_Comm comm, const std::string& path, const Options& options,
                          const std::string& option, const std::string& mark);
/// Refuses to write the checkpoint over a file that is none, before any work.
void check_checkpoint(MPI_Comm comm, const CheckpointSpec& spec);
/// Whether two names are of one file, there or not.
bool is_same_file(const std::string& one, const std::string& other);

/// When a file was written; @return nothing without one.
std::optional<std::filesystem::file_time_type> written_at(const std::string& path);
/// Warns where another run has written the file since.
void warn_of_another_run(const std::string& path,
                         std::optional<std::filesystem::file_time_type> before,
                         Observer& observer);

} // namespace flexgram
