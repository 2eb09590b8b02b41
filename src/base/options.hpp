#pragma once

#include <algorithm>
#include <map>
#include <optional>
#include <string>
#include <utility>
#include <vector>

namespace flexgram {

/// One option after reading: what it is called, what it was set to, and what it means.
struct Option {
  std::string section, name, value, unit, choices, help;
  std::string verbs; ///< that look at it, separated by spaces
  /// number, whole number, flag, text, choice, numbers; numbered for a family.
  std::string type;
  bool set_by_user = false;
};

/// The registry of all options. An options struct registers each of its fields once, with
/// default (the field's value), unit, choices and help; the same call reads PETSc's
/// option database, so command line, -options_file and PETSC_OPTIONS all work.
///
///     options.section("Sampling", "reduce sweep");
///     options.add("-mor_samples", samples, "", "frequencies of the quadrature");
class Options {
public:
  enum class Mode { read, describe };
  /// describe: keep the defaults and only collect the texts, for -help.
  explicit Options(Mode mode = Mode::read) : mode_(mode) {}

  /// What follows belongs together, and to these verbs (separated by spaces).
  void section(const std::string& title, const std::string& verbs) {
    section_ = title;
    verbs_ = verbs;
  }
  void add(const char* name, double& value, const char* unit, const char* help);
  /// Unset unless the user gives it.
  void add(const char* name, std::optional<double>& value, const char* unit,
           const char* help);
  void add(const char* name, int& value, const char* unit, const char* help);
  void add(const char* name, bool& value, const char* help);
  void add(const char* name, std::string& value, const char* help);
  void add(const char* name, std::vector<double>& value, const char* unit,
           const char* help);
  void add_choice(const char* name, std::string& value,
                  const std::vector<std::string>& choices, const char* help);
  /// A choice whose words stand for values: an enumeration, or yes and no.
  template <class T>
  void add_word(const char* name, T& value,
                const std::vector<std::pair<const char*, T>>& words, const char* help) {
    std::vector<std::string> choices;
    for (const auto& [word, meaning] : words) choices.emplace_back(word);
    const auto known = std::find_if(words.begin(), words.end(),
                                    [&](const auto& w) { return w.second == value; });
    std::string word = known->first;
    add_choice(name, word, choices, help);
    value = std::find_if(words.begin(), words.end(), [&](const auto& w) {
              return word == w.first;
            })->second;
  }
  /// A family such as -mor_mumps_icntl_N: every N that the user gave, with its value.
  void add_numbered(const char* prefix, std::map<int, double>& values, const char* help);

  /// @throws Error for a -mor_* option that nobody registered; names the nearest one.
  void reject_unknown() const;

  const std::vector<Option>& all() const { return options_; }
  /// The options of a verb, or all.
  std::string help(const std::string& verb = "") const;

private:
  bool given(const char* name, std::string& value) const;
  void record(const char* name, const char* type, std::string value, bool set_by_user,
              std::string unit, std::string choices, std::string help);

  Mode mode_;
  std::string section_, verbs_;
  std::vector<Option> options_;
  std::vector<std::string> prefixes_;
};

/// @throws Error "name value: must be …" unless the condition holds.
void require_option(bool condition, const char* name, const std::string& value,
                    const char* expected);

} // namespace flexgram
