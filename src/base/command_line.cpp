#include "base/command_line.hpp"

#include "base/error.hpp"
#include "base/text.hpp"

#include <algorithm>
#include <cctype>
#include <map>
#include <utility>

namespace flexgram {
namespace {

using Words = std::vector<std::string>;

bool is_option(const std::string& word) {
  const std::size_t letter = word.rfind("--", 0) == 0 ? 2 : 1;
  return word.size() > letter && word[0] == '-' &&
         std::isalpha(static_cast<unsigned char>(word[letter]));
}

class Translation {
public:
  Translation(const Words& words, const std::vector<Option>& options,
              const VerbFiles& files)
      : words_(words), options_(options), files_(files) {}

  Words all() {
    while (at_ < words_.size()) one(words_[at_++]);
    return result_;
  }

private:
  void one(const std::string& word) {
    static const std::map<std::string, std::string> levels{
        {"-v", "plan"}, {"-vv", "detail"}, {"-q", "silent"}};
    if (const auto level = levels.find(word); level != levels.end())
      add("-mor_monitor", level->second);
    else if (word == "-o")
      output();
    else if (word.rfind("--", 0) == 0)
      short_option(word);
    else if (is_option(word))
      petsc_option(word);
    else
      file(word);
  }

  void add(const std::string& option, const std::string& value) {
    result_.push_back(option);
    if (!value.empty()) result_.push_back(value);
  }

  void output() {
    if (files_.output.empty()) throw Error("-o: this verb writes no file");
    if (at_ == words_.size() || is_option(words_[at_]))
      throw Error("-o needs the name of the file to write");
    add(files_.output, words_[at_++]);
  }

  void short_option(const std::string& word) {
    const auto equals = word.find('=');
    const auto [option, name] = named(word.substr(0, equals));
    if (equals != std::string::npos) return add(name, word.substr(equals + 1));
    const Words choices = split(option->choices, '|');
    const auto is_choice = [&](const std::string& w) {
      return std::find(choices.begin(), choices.end(), w) != choices.end();
    };
    // Flags and choices with a yes may stand alone.
    if (option->type == "flag" || is_choice("yes")) {
      const bool is_value = at_ < words_.size() && is_choice(words_[at_]);
      return add(name, is_value ? words_[at_++] : "yes");
    }
    if (at_ == words_.size() || is_option(words_[at_]))
      throw Error(word + " needs a value (--help-all lists all options)");
    add(name, words_[at_++]);
  }

  /// An option, and PETSc's name of it.
  std::pair<const Option*, std::string> named(std::string word) const {
    std::replace(word.begin(), word.end(), '_', '-');
    Words known;
    for (const Option& option : options_) {
      const std::string name = short_name(option.name);
      if (word == name || word == name + "-hz") return {&option, option.name};
      if (option.type == "numbered") { // --mumps-icntl-14
        const std::size_t start = name.size() - 1;
        if (word.size() > start && word.compare(0, start, name, 0, start) == 0)
          return {&option,
                  option.name.substr(0, option.name.size() - 1) + word.substr(start)};
      }
      known.push_back(name);
    }
    throw Error(text("unknown option %s: did you mean %s? (--help-all lists all; PETSc's "
                     "have one dash)",
                     word.c_str(), nearest(word, known).c_str()));
  }

  void petsc_option(const std::string& word) {
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
    const Words& files = files_.inputs;
    while (next_file_ < files.size() && is_named(files[next_file_])) ++next_file_;
    if (next_file_ < files.size()) return add(files[next_file_++], word);
    throw Error("stray word " + word +
                ": an option takes one word, lists have commas (--band 10,500)");
  }

  const Words& words_;
  const std::vector<Option>& options_;
  const VerbFiles& files_;
  Words result_;
  std::size_t at_ = 0, next_file_ = 0;
};

} // namespace

Words petsc_words(const Words& words, const std::vector<Option>& options,
                  const VerbFiles& files) {
  return Translation(words, options, files).all();
}

} // namespace flexgram
