#include "base/plan.hpp"

#include "base/text.hpp"

namespace flexgram {

void Plan::fact(const std::string& name, const std::string& value) {
  lines_.push_back(text("  %-14s %s", name.c_str(), value.c_str()));
}

void Plan::skip(const std::string& what, const std::string& why) {
  lines_.push_back(text("  %-14s %s: %s", "skipped", what.c_str(), why.c_str()));
}

void Plan::print(const Monitor& monitor) {
  for (; printed_ < lines_.size(); ++printed_) monitor.say(lines_[printed_]);
}

} // namespace flexgram
