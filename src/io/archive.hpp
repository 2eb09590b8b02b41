#pragma once

#include "base/text.hpp"
#include "io/hdf5_file.hpp"
#include "linalg/dense.hpp"

#include <cmath>

namespace flexgram {

/// The name of the k-th of a list.
inline std::string numbered(const char* name, std::size_t k) {
  return text("%s_%zu", name, k + 1);
}

/// Writing and reading of fields by their names: a class lists its fields once, in a
/// function `archive(archive, object)` that both can take. Numbers are attributes of the
/// group, arrays datasets in it; empty ones are left out.
class FieldWriter {
public:
  FieldWriter(Hdf5File& file, std::string group) : file_(file), group_(std::move(group)) {
    if (group_ != "/") file_.create_group(group_);
  }
  void operator()(const char* name, double value) {
    file_.set_attribute(group_, name, value);
  }
  void operator()(const char* name, int value) {
    (*this)(name, static_cast<double>(value));
  }
  void operator()(const char* name, bool value) { (*this)(name, value ? 1.0 : 0.0); }
  void operator()(const char* name, const std::string& value) {
    if (!value.empty()) file_.set_attribute(group_, name, value);
  }
  void operator()(const char* name, const std::vector<std::string>& value) {
    if (!value.empty()) file_.set_attribute(group_, name, value);
  }
  void operator()(const char* name, const std::vector<double>& value) {
    if (!value.empty())
      file_.write(path(name), {static_cast<std::int64_t>(value.size())}, value);
  }
  void operator()(const char* name, const Dense& value) {
    const std::string shape = std::string(name) + "_shape";
    file_.set_attribute(group_, shape,
                        std::vector<double>{static_cast<double>(value.rows),
                                            static_cast<double>(value.columns)});
    if (!value.data.empty()) // stored by columns: the shape is reversed
      file_.write(path(name), {value.columns, value.rows}, value.data);
  }
  /// As NAME_1, NAME_2, …, and their number.
  template <class T>
  void operator()(const char* name, const std::vector<T>& values) {
    (*this)((std::string(name) + "_count").c_str(), static_cast<int>(values.size()));
    for (std::size_t k = 0; k < values.size(); ++k)
      (*this)(numbered(name, k).c_str(), values[k]);
  }

private:
  std::string path(const char* name) const {
    return (group_ == "/" ? "/" : group_ + "/") + name;
  }
  Hdf5File& file_;
  std::string group_;
};

/// @throws Error naming file and field for what cannot be. Reads are rank-local.
class FieldReader {
public:
  FieldReader(const Hdf5File& file, std::string group)
      : file_(file), group_(std::move(group)) {}
  void operator()(const char* name, double& value) {
    value = file_.number_attribute(group_, name);
    if (std::isnan(value)) fail(name, "is no number");
  }
  void operator()(const char* name, int& value) {
    const double number = file_.number_attribute(group_, name);
    if (!(std::abs(number) < 2e9) || number != std::floor(number))
      fail(name, "is no whole number");
    value = static_cast<int>(number);
  }
  void operator()(const char* name, bool& value) {
    const double number = file_.number_attribute(group_, name);
    if (number != 0 && number != 1) fail(name, "is neither 0 nor 1");
    value = number == 1;
  }
  void operator()(const char* name, std::string& value) {
    value = file_.has_attribute(group_, name) ? file_.text_attribute(group_, name) : "";
  }
  void operator()(const char* name, std::vector<std::string>& value) {
    value.clear();
    if (file_.has_attribute(group_, name)) value = file_.texts_attribute(group_, name);
  }
  void operator()(const char* name, std::vector<double>& value) {
    value.clear();
    if (!file_.exists(path(name))) return;
    value = file_.read_all<double>(path(name));
    for (double x : value)
      if (!std::isfinite(x)) fail(name, "holds NaN or Inf");
  }
  void operator()(const char* name, Dense& value) {
    const auto shape = file_.numbers_attribute(group_, std::string(name) + "_shape");
    std::vector<double> data;
    (*this)(name, data);
    if (shape.size() != 2 || !(shape[0] >= 0) || !(shape[1] >= 0) ||
        shape[0] * shape[1] != static_cast<double>(data.size()) || shape[0] > 1e9 ||
        shape[1] > 1e9)
      fail(name, "has not the shape that it says");
    value.rows = static_cast<int>(shape[0]);
    value.columns = static_cast<int>(shape[1]);
    value.data = std::move(data);
  }
  template <class T>
  void operator()(const char* name, std::vector<T>& values) {
    int count = 0;
    (*this)((std::string(name) + "_count").c_str(), count);
    if (count < 0 || count > 1000) fail(name, "has not the number that it says");
    values.resize(static_cast<std::size_t>(count));
    for (std::size_t k = 0; k < values.size(); ++k)
      (*this)(numbered(name, k).c_str(), values[k]);
  }

private:
  [[noreturn]] void fail(const char* name, const char* what) const {
    throw Error(text("file %s: %s %s: it is damaged", file_.path().c_str(),
                     path(name).c_str(), what));
  }
  std::string path(const char* name) const {
    return (group_ == "/" ? "/" : group_ + "/") + name;
  }
  const Hdf5File& file_;
  std::string group_;
};

} // namespace flexgram
