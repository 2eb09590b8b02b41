#include "base/monitor.hpp"

#include "base/error.hpp"
#include "base/parallel.hpp"
#include "base/process.hpp"
#include "base/text.hpp"

#include <petsclog.h>

#include <algorithm>

namespace flexgram {

Monitor::Monitor(MPI_Comm comm, Level level)
    : speaks_(comm_rank(comm) == 0), level_(level) {}

void Monitor::say(const std::string& line) const {
  if (speaks_ && level_ != Level::silent)
    PetscPrintf(PETSC_COMM_SELF, "%s\n", line.c_str());
}

void Monitor::detail(const std::string& line) const {
  if (level_ == Level::detail) say(line);
}

void Monitor::warn(const std::string& line) {
  warnings_.push_back(line);
  say("warning: " + line);
}

void Monitor::add_seconds(const std::string& stage, double seconds) {
  const auto found = std::find_if(stages_.begin(), stages_.end(), [&](const auto& entry) {
    return entry.first == stage;
  });
  if (found != stages_.end())
    found->second += seconds;
  else
    stages_.emplace_back(stage, seconds);
}

Stage::Stage(Monitor& monitor, const char* name)
    : monitor_(monitor), name_(name), start_(now()) {
  PetscLogStage stage = -1;
  FG_CALL(PetscLogStageGetId(name, &stage));
  if (stage < 0) FG_CALL(PetscLogStageRegister(name, &stage));
  FG_CALL(PetscLogStagePush(stage));
}

Stage::~Stage() {
  PetscLogStagePop();
  monitor_.add_seconds(name_, now() - start_);
}

Progress::Progress(const Monitor& monitor, std::string what, int total)
    : monitor_(monitor), what_(std::move(what)), total_(total), start_(now()),
      printed_(start_) {}

void Progress::step(const std::string& note) {
  ++done_;
  const double time = now();
  const bool due = time - printed_ > 2.0 && done_ < total_;
  if (monitor_.level() != Monitor::Level::detail && !due) return;
  printed_ = time;
  const double left = (time - start_) / done_ * (total_ - done_);
  monitor_.say(text("  %s %d/%d  %s  %.1f s left", what_.c_str(), done_, total_,
                    note.c_str(), left));
}

} // namespace flexgram
