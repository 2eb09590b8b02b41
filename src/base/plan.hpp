#pragma once

#include "base/monitor.hpp"

#include <string>
#include <vector>

namespace flexgram {

/// What this body needs, and what is skipped and why. Printed before the work starts and
/// stored with the result.
class Plan {
public:
  void fact(const std::string& name, const std::string& value);
  void skip(const std::string& what, const std::string& why);
  const std::vector<std::string>& lines() const { return lines_; }
  /// Prints what has been added since the last call.
  void print(const Monitor& monitor);

private:
  std::vector<std::string> lines_;
  std::size_t printed_ = 0;
};

} // namespace flexgram
