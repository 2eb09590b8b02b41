/// The fields of a reduced body by their names, once: for its file (reduced_io) and for
/// Python (src/python/module.cpp), which reads both alike.

#pragma once

#include "model/reduced_model.hpp"

#include <cstdint>
#include <string>
#include <vector>

namespace flexgram {

/// Where the fields go. A name is a path: "error/worst" is `worst` of the group `error`.
class FieldSink {
public:
  virtual ~FieldSink() = default;
  /// Small values: attributes of their group.
  virtual void value(const std::string& name, double value) = 0;
  virtual void value(const std::string& name, const std::string& value) = 0;
  virtual void value(const std::string& name, const std::vector<double>& value) = 0;
  virtual void value(const std::string& name, const std::vector<std::string>& value) = 0;
  /// Arrays, row-major.
  virtual void array(const std::string& name, const std::vector<std::int64_t>& shape,
                     const std::vector<double>& values) = 0;
};

/// Everything but V, which is distributed. What is unknown or empty is left out.
void visit_fields(const ReducedModel& rom, FieldSink& sink);

} // namespace flexgram
