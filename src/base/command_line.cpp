#include "base/command_line.hpp"

#include "base/error.hpp"
#include "base/text.hpp"

#include <algorithm>
#include <cctype>
#include <map>
#include <set>
#include <utility>

namespace flexgram {
namespace {

using Words = std::vector<std::string>;

bool is_option(const std::string& word) {
  const std::size_t letter = word.rfind("--", 0) == 0 ? 2 : 1;
  return word.size() > letter && word[0] == '-' &&
         std::isalpha(static_cast<unsigned char>(word[letter]));
}

bool contains(const Words& words, const std::string& word) {
  return std::find(words.begin(), words.end(), word) != words.end();
}

/// What people type for something that has another name here.
std::string other_name(const std::string& word) {
  static const std::map<std::string, std::string> names{
      {"--verbose", "-v"},
      {"--quiet", "-q"},
      {"--options-file", "-options_file"},
      {"--log-view", "-log_view"}};
  const auto found = names.find(word);
  return found == names.end() ? "" : found->second;
}

class Translation {
public:
  Translation(const Words& words, const std::vector<Option>& options,
              const VerbWords& verb)
      : words_(words), options_(options), verb_(verb) {}

  Words all() {
    while (at_ < words_.size()) one(words_[at_++]);
    return result_;
  }

private:
  void one(const std::string& word) {
    static const std::map<std::string, std::string> levels{
        {"-v", "plan"}, {"-vv", "detail"}, {"-q", "silent"}};
    const std::string name = word.substr(0, word.find('='));
    if (const auto level = levels.find(word); level != levels.end()) {
      result_.insert(result_.end(), {"-mor_monitor", level->second});
    } else if (name == "-o" || name == "--output") {
      if (verb_.output.empty())
        throw Error("-o: flexgram " + verb_.name + " writes no file");
      add(verb_.output, "-o", value_of(word, "the name of the file to write"));
    } else if (word.rfind("--", 0) == 0) {
      short_option(word);
    } else if (is_option(word)) {
      petsc_option(word);
    } else {
      file(word);
    }
  }

  /// @throws Error if it is there already. @param typed  as what.
  void add(const std::string& option, const std::string& typed,
           const std::string& value) {
    if (!given_.insert(option).second || of_petsc_.count(option) > 0)
      throw Error(typed + " is given twice" +
                  (option == "-mor_band_hz" ? ": several bands are one list, --band "
                                              "10,100,200,300"
                                            : ""));
    result_.insert(result_.end(), {option, value});
  }

  /// Behind =, or the next word.
  std::string value_of(const std::string& word, const char* needs) {
    const auto equals = word.find('=');
    if (equals != std::string::npos) return word.substr(equals + 1);
    if (at_ == words_.size() || is_option(words_[at_]))
      throw Error(word + " needs " + needs + " (--help-all lists all options)");
    return words_[at_++];
  }

  void short_option(const std::string& word) {
    std::string typed = word.substr(0, word.find('='));
    std::replace(typed.begin(), typed.end(), '_', '-');
    const auto [option, name] = named(typed);
    const Words choices = split(option->choices, '|');
    // Flags and choices with a yes may stand alone.
    if ((option->type == "flag" || contains(choices, "yes")) &&
        word.find('=') == std::string::npos) {
      const bool is_value = at_ < words_.size() && contains(choices, words_[at_]);
      return add(name, typed, is_value ? words_[at_++] : "yes");
    }
    add(name, typed, value_of(word, "a value"));
  }

  /// An option, and PETSc's name of it.
  std::pair<const Option*, std::string> named(const std::string& word) const {
    Words known, elsewhere;
    for (const Option& option : options_) {
      const std::string name = short_name(option.name);
      const Words verbs = split(option.verbs, ' ');
      const bool is_own = contains(verbs, verb_.name);
      if (word == name || (word == name + "-hz" && option.name.ends_with("_hz"))) {
        if (is_own) return {&option, option.name};
        elsewhere = verbs;
      }
      if (option.type == "numbered" && is_own) { // --mumps-icntl-14
        const std::size_t start = name.size() - 1;
        if (word.size() > start && word.compare(0, start, name, 0, start) == 0)
          return {&option,
                  option.name.substr(0, option.name.size() - 1) + word.substr(start)};
      }
      if (is_own) known.push_back(name);
    }
    if (!elsewhere.empty())
      throw Error(word + " is an option of flexgram " + join(elsewhere) + ", not of " +
                  verb_.name);
    std::string near = suggestion(word, known);
    if (const std::string own = "--" + word.substr(std::min<std::size_t>(6, word.size()));
        word.rfind("--mor-", 0) == 0 && contains(known, own))
      near = ": did you mean " + own + "?";
    else if (const std::string other = other_name(word); !other.empty())
      near = ": did you mean " + other + "?";
    throw Error(
        "unknown option " + word +
        (near.empty() ? ": flexgram " + verb_.name + " --help-all lists all" : near));
  }

  void petsc_option(const std::string& word) {
    if (given_.count(word) > 0) throw Error(word + " is given twice");
    of_petsc_.insert(
        word); // these may be repeated, as everywhere in PETSc: the last counts
    result_.push_back(word);
    if (at_ < words_.size() && !is_option(words_[at_])) result_.push_back(words_[at_++]);
  }

  void file(const std::string& word) {
    // Of the files that no option names.
    const auto is_named = [&](const std::string& option) {
      return std::any_of(words_.begin(), words_.end(), [&](const std::string& w) {
        return w == option || w.substr(0, w.find('=')) == short_name(option);
      });
    };
    while (next_file_ < verb_.inputs.size() && is_named(verb_.inputs[next_file_]))
      ++next_file_;
    if (next_file_ < verb_.inputs.size())
      return add(verb_.inputs[next_file_++], word, word);
    const std::string dash = "\xe2\x80"; // of en and em dashes
    const auto equals = word.find('=');
    if (word.rfind(dash, 0) == 0)
      throw Error(word + " begins with a dash of a text processor: type --");
    if (equals != std::string::npos)
      throw Error("stray word " + word + ": did you mean --" + word.substr(0, equals) +
                  " " + word.substr(equals + 1) + "?");
    if (word.find('.') != std::string::npos &&
        word.find_first_not_of("0123456789.,-+eE") != std::string::npos)
      throw Error(text("stray word %s: flexgram %s takes %zu file%s, which %s named "
                       "already",
                       word.c_str(), verb_.name.c_str(), verb_.inputs.size(),
                       verb_.inputs.size() == 1 ? "" : "s",
                       verb_.inputs.size() == 1 ? "is" : "are"));
    throw Error("stray word " + word +
                ": an option takes one word, lists have commas (--band 10,500)");
  }

  const Words& words_;
  const std::vector<Option>& options_;
  const VerbWords& verb_;
  Words result_;
  std::set<std::string> given_, of_petsc_; ///< in short words; by PETSc's names
  std::size_t at_ = 0, next_file_ = 0;
};

} // namespace

Words petsc_words(const Words& words, const std::vector<Option>& options,
                  const VerbWords& verb) {
  return Translation(words, options, verb).all();
}

} // namespace flexgram
