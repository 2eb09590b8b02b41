#pragma once

#include <mpi.h>

#include <map>
#include <string>
#include <utility>
#include <vector>

namespace flexgram {

/// What the work tells about itself: facts and what was skipped and why (the plan,
/// printed as it grows and stored with the result), warnings, progress, and the seconds
/// of each stage. Rank 0 prints, the others stay silent. Words in braces name options:
/// see option_names().
class Observer {
public:
  /// What is printed: nothing; what came in and out, with warnings and progress; the plan
  /// too; each factorisation too.
  enum class Level { silent, summary, plan, detail };
  explicit Observer(MPI_Comm comm, Level level = Level::summary);

  void fact(const std::string& name, const std::string& value);
  void skip(const std::string& what, const std::string& why);
  /// Prints the facts since the last call, as lines of the plan.
  void print();
  /// Name and value, as they were told.
  const std::vector<std::pair<std::string, std::string>>& facts() const { return facts_; }

  void say(const std::string& line) const;    ///< unless silent
  void plan(const std::string& line) const;   ///< plan and detail
  void detail(const std::string& line) const; ///< detail only
  /// Printed at once, and stored in /log/warnings.
  void warn(const std::string& line);
  const std::vector<std::string>& warnings() const { return warnings_; }

  Level level() const { return level_; }

  void add_seconds(const std::string& stage, double seconds);
  /// In the order in which the stages first ran.
  const std::vector<std::pair<std::string, double>>& stages() const { return stages_; }

private:
  bool speaks_;
  Level level_;
  std::vector<std::pair<std::string, std::string>> facts_;
  std::size_t printed_ = 0;
  std::vector<std::string> warnings_;
  std::vector<std::pair<std::string, double>> stages_;
};

/// A stage of the data flow: a PETSc log stage (-log_view is the profile) and a clock. One
/// of more than two seconds says when it is done.
class Stage {
public:
  Stage(Observer& observer, const char* name);
  ~Stage();
  Stage(const Stage&) = delete;
  Stage& operator=(const Stage&) = delete;

private:
  Observer& observer_;
  std::string name_;
  double start_;
};

/// Progress of long work: a line a step in detail, otherwise at most one every two
/// seconds, with the time that remains.
class Progress {
public:
  Progress(const Observer& observer, std::string what, int total);
  /// One more of the total.
  void step(const std::string& note) { reach(done_ + 1, note); }
  /// So many of the total.
  void reach(int done, const std::string& note);

private:
  const Observer& observer_;
  std::string what_;
  int total_, done_ = 0;
  double start_, printed_;
};

} // namespace flexgram
