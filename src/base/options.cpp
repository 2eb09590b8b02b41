#include "base/options.hpp"

#include "base/error.hpp"
#include "base/text.hpp"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <cstring>

namespace flexgram {
namespace {

std::string number_text(double value) { return text("%g", value); }

/// @param percent  whether "1%" is 0.01: of numbers without a unit.
double parse_number(const char* name, const std::string& word, bool percent = false) {
  char* end = nullptr;
  double value = std::strtod(word.c_str(), &end);
  const bool is_percent = percent && end != word.c_str() && std::strcmp(end, "%") == 0;
  require_option(!word.empty() && (*end == '\0' || is_percent) && std::isfinite(value),
                 name, word, "a finite number");
  if (is_percent) value /= 100;
  return value;
}

/// "-mor_b_1" of "-mor_b_1 3": PETSc lists the whole database as one string.
std::vector<std::string> names_in_database() {
  char* all = nullptr;
  FG_CALL(PetscOptionsGetAll(nullptr, &all));
  std::vector<std::string> names;
  for (const auto& word : split(all, ' '))
    if (word.size() > 2 && word[0] == '-' &&
        std::isalpha(static_cast<unsigned char>(word[word[1] == '-' ? 2 : 1])))
      names.push_back(word);
  PetscFree(all);
  return names;
}

} // namespace

void require_option(bool condition, const char* name, const std::string& value,
                    const char* expected) {
  if (!condition)
    throw Error(text("option %s %s: must be %s", name, value.c_str(), expected));
}

bool Options::given(const char* name, std::string& value) const {
  if (mode_ == Mode::describe) return false;
  PetscBool set = PETSC_FALSE;
  const char* word = nullptr; // of any length; null: the name alone is given
  FG_CALL(PetscOptionsFindPair(nullptr, nullptr, name, &word, &set));
  value = set && word ? word : "";
  return set;
}

void Options::record(const char* name, const char* type, std::string value,
                     bool set_by_user, std::string unit, std::string choices,
                     std::string help) {
  know_option(name);
  options_.push_back({section_, name, std::move(value), std::move(unit),
                      std::move(choices), std::move(help), verbs_, type, set_by_user});
}

void Options::add(const char* name, double& value, const char* unit, const char* help) {
  std::string word;
  const bool set = given(name, word);
  if (set) value = parse_number(name, word, *unit == '\0');
  record(name, "number", set ? word : number_text(value), set, unit, "", help);
}

void Options::add(const char* name, std::optional<double>& value, const char* unit,
                  const char* help) {
  std::string word;
  const bool set = given(name, word);
  if (set) value = parse_number(name, word, *unit == '\0');
  record(name, "number", word, set, unit, "", help);
}

void Options::add(const char* name, int& value, const char* unit, const char* help) {
  std::string word;
  const bool set = given(name, word);
  if (set) {
    const double number = parse_number(name, word);
    require_option(number == std::floor(number) && std::abs(number) < 2e9, name, word,
                   "a whole number");
    value = static_cast<int>(number);
  }
  record(name, "whole number", std::to_string(value), set, unit, "", help);
}

void Options::add(const char* name, bool& value, const char* help) {
  std::string word;
  const bool set = given(name, word);
  if (set) {
    if (word.empty() || word == "true" || word == "yes" || word == "1" || word == "on")
      value = true;
    else if (word == "false" || word == "no" || word == "0" || word == "off")
      value = false;
    else
      require_option(false, name, word, "true or false");
  }
  record(name, "flag", value ? "true" : "false", set, "", "true|false", help);
}

void Options::add(const char* name, std::string& value, const char* help) {
  std::string word;
  const bool set = given(name, word);
  if (set) {
    require_option(!word.empty(), name, word, "followed by a value");
    value = word;
  }
  record(name, "text", value, set, "", "", help);
}

void Options::add(const char* name, std::vector<double>& value, const char* unit,
                  const char* help) {
  std::string word;
  const bool set = given(name, word);
  if (set) {
    value.clear();
    for (const auto& part : split(word, ',')) {
      char* end = nullptr;
      value.push_back(std::strtod(part.c_str(), &end));
      require_option(
          *end == '\0' && std::isfinite(value.back()), name, word,
          "finite numbers with commas between them and no unit, such as 10,500");
    }
    require_option(!value.empty(), name, word, "a list of numbers such as 10,500");
  }
  std::vector<std::string> words;
  for (double number : value) words.push_back(number_text(number));
  record(name, "numbers", set ? word : join(words, ","), set, unit, "", help);
}

void Options::add_choice(const char* name, std::string& value,
                         const std::vector<std::string>& choices, const char* help) {
  std::string word;
  const bool set = given(name, word);
  const auto is_choice = [&](const std::string& w) {
    return std::find(choices.begin(), choices.end(), w) != choices.end();
  };
  if (set) {
    if (word.empty() && is_choice("yes")) word = "yes"; // a flag alone, as PETSc takes it
    if (!is_choice(word))
      throw Error(text("option %s %s: must be one of %s (did you mean %s?)", name,
                       word.c_str(), join(choices).c_str(),
                       nearest(word, choices).c_str()));
    value = word;
  }
  record(name, "choice", value, set, "", join(choices, "|"), help);
}

void Options::add_numbered(const char* prefix, std::map<int, double>& values,
                           const char* help) {
  prefixes_.emplace_back(prefix);
  std::vector<std::string> words;
  if (mode_ == Mode::read)
    for (const auto& name : names_in_database()) {
      const std::string start(prefix);
      if (name.rfind(start, 0) != 0) continue;
      const std::string index = name.substr(start.size());
      require_option(!index.empty() && index.size() < 4 &&
                         index.find_first_not_of("0123456789") == std::string::npos,
                     name.c_str(), "", "the prefix followed by a number");
      std::string word;
      given(name.c_str(), word);
      values[std::stoi(index)] = parse_number(name.c_str(), word);
      words.push_back(index + ":" + word);
    }
  record((std::string(prefix) + "N").c_str(), "numbered", join(words, " "),
         !words.empty(), "", "", help);
}

void Options::reject_unknown() const {
  std::vector<std::string> known;
  for (const auto& option : options_) known.push_back(option.name);
  for (const auto& name : names_in_database()) {
    if (std::find(known.begin(), known.end(), name) != known.end()) continue;
    // --band of a file, or -band: PETSc takes its own names alone there.
    for (const auto& option : options_) {
      const std::string own = short_name(option.name);
      if (name == own)
        throw Error(
            text("unknown option %s: an options file and PETSC_OPTIONS take PETSc's "
                 "names, here \\%s",
                 name.c_str(), option.name.c_str()));
      if ("-" + name == own || name == "-mor_" + own.substr(2))
        throw Error(text("unknown option %s: did you mean --%s (\\%s in an options file "
                         "or PETSC_OPTIONS)?",
                         name.c_str(), own.c_str() + 2, option.name.c_str()));
    }
    // -bodi: nearly one of ours without the prefix, and nothing of PETSc's is so near
    const std::string near = nearest(name, known);
    const bool misspelt = near.rfind("-mor_", 0) != 0 && near.size() == name.size() &&
                          name.size() > 4 && near.substr(0, 3) == name.substr(0, 3);
    const bool is_ours = name.rfind("-mor_", 0) == 0 || name.rfind("-mor-", 0) == 0;
    if (!is_ours && !misspelt) continue;
    if (std::any_of(prefixes_.begin(), prefixes_.end(),
                    [&](const auto& prefix) { return name.rfind(prefix, 0) == 0; }))
      continue;
    throw Error(text("unknown option %s: did you mean %s? (flexgram VERB --help-all "
                     "lists all)",
                     name.c_str(), near.c_str()));
  }
}

std::string Options::help(const std::string& verb) const {
  std::string result, section;
  for (const auto& option : options_) {
    const auto verbs = split(option.verbs, ' ');
    if (!verb.empty() && std::find(verbs.begin(), verbs.end(), verb) == verbs.end())
      continue;
    const std::string title =
        option.section + (verb.empty() ? " (" + join(verbs) + ")" : std::string());
    if (title != section) result += "\n" + option_names(section = title) + "\n";
    std::string head = short_name(option.name) + ", " + option.name;
    if (!option.choices.empty()) head += " <" + option.choices + ">";
    if (!option.value.empty()) head += " [" + option.value + "]";
    if (!option.unit.empty()) head += " " + option.unit;
    result += "  " + head + "\n";
    std::string line = "     ";
    for (const auto& word : split(option_names(option.help), ' ')) {
      if (line.size() + word.size() > 88) {
        result += line + "\n";
        line = "     ";
      }
      line += " " + word;
    }
    result += line + "\n";
  }
  return result;
}

} // namespace flexgram
