#include "base/observer.hpp"

#include "base/error.hpp"
#include "base/parallel.hpp"
#include "base/process.hpp"
#include "base/text.hpp"

#include <petsclog.h>

#include <algorithm>

namespace flexgram {

Observer::Observer(MPI_Comm comm, Level level)
    : speaks_(comm_rank(comm) == 0), level_(level) {}

void Observer::fact(const std::string& name, const std::string& value) {
  facts_.emplace_back(name, option_names(value));
}

void Observer::skip(const std::string& what, const std::string& why) {
  fact("skipped", what + ": " + why);
}

void Observer::print() {
  for (; printed_ < facts_.size(); ++printed_)
    plan(text("  %-14s %s", facts_[printed_].first.c_str(),
              facts_[printed_].second.c_str()));
}

void Observer::say(const std::string& line) const {
  if (speaks_ && level_ != Level::silent)
    PetscPrintf(PETSC_COMM_SELF, "%s\n", option_names(line).c_str());
}

void Observer::plan(const std::string& line) const {
  if (level_ >= Level::plan) say(line);
}

void Observer::detail(const std::string& line) const {
  if (level_ == Level::detail) say(line);
}

void Observer::warn(const std::string& line) {
  warnings_.push_back(option_names(line));
  say("warning: " + warnings_.back());
}

void Observer::add_seconds(const std::string& stage, double seconds) {
  const auto found = std::find_if(stages_.begin(), stages_.end(), [&](const auto& entry) {
    return entry.first == stage;
  });
  if (found != stages_.end())
    found->second += seconds;
  else
    stages_.emplace_back(stage, seconds);
}

Stage::Stage(Observer& observer, const char* name)
    : observer_(observer), name_(name), start_(now()) {
  PetscLogStage stage = -1;
  FG_CALL(PetscLogStageGetId(name, &stage));
  if (stage < 0) FG_CALL(PetscLogStageRegister(name, &stage));
  FG_CALL(PetscLogStagePush(stage));
}

Stage::~Stage() {
  PetscLogStagePop();
  const double seconds = now() - start_;
  observer_.add_seconds(name_, seconds);
  if (seconds > 2)
    observer_.say(text("  %-14s done after %.1f s", name_.c_str(), seconds));
}

Progress::Progress(const Observer& observer, std::string what, int total)
    : observer_(observer), what_(std::move(what)), total_(total), start_(now()),
      printed_(start_) {}

void Progress::reach(int done, const std::string& note) {
  done_ = done;
  const double time = now();
  const bool due = time - printed_ > 2.0 && done_ < total_;
  if (observer_.level() != Observer::Level::detail && !due) return;
  printed_ = time;
  std::string left;
  if (done_ > 0) left = text("  %.1f s left", (time - start_) / done_ * (total_ - done_));
  observer_.say(
      text("  %s %d/%d  %s%s", what_.c_str(), done_, total_, note.c_str(), left.c_str()));
}

} // namespace flexgram
