#pragma once

#include <mpi.h>

#include <map>
#include <string>
#include <utility>
#include <vector>

namespace flexgram {

/// Where the program talks to its user: rank 0 prints, the others stay silent. Also keeps
/// the seconds of each stage, for the summary and for /log of the results.
class Monitor {
public:
  enum class Level { silent, summary, detail };
  explicit Monitor(MPI_Comm comm, Level level = Level::summary);

  void say(const std::string& line) const;    ///< summary and detail
  void detail(const std::string& line) const; ///< detail only
  /// Kept and repeated at the end of the run, and stored in /log/warnings.
  void warn(const std::string& line);
  const std::vector<std::string>& warnings() const { return warnings_; }

  Level level() const { return level_; }
  bool speaks() const { return speaks_; }

  void add_seconds(const std::string& stage, double seconds);
  /// In the order in which the stages first ran.
  const std::vector<std::pair<std::string, double>>& stages() const { return stages_; }

private:
  bool speaks_;
  Level level_;
  std::vector<std::string> warnings_;
  std::vector<std::pair<std::string, double>> stages_;
};

/// A stage of the data flow: a PETSc log stage (-log_view is the profile) and a clock.
class Stage {
public:
  Stage(Monitor& monitor, const char* name);
  ~Stage();
  Stage(const Stage&) = delete;
  Stage& operator=(const Stage&) = delete;

private:
  Monitor& monitor_;
  std::string name_;
  double start_;
};

/// Progress of long work: a line a step in detail, otherwise at most one every two
/// seconds, with the time that remains.
class Progress {
public:
  Progress(const Monitor& monitor, std::string what, int total);
  void step(const std::string& note);

private:
  const Monitor& monitor_;
  std::string what_;
  int total_, done_ = 0;
  double start_, printed_;
};

} // namespace flexgram
