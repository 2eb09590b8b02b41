/// The verbs of the program: their files, and their help. Used by main.

#pragma once

#include "base/command_line.hpp"

#include <string>
#include <vector>

namespace flexgram {

/// An option that most people use, in a line of help.
struct CommonOption {
  std::string option; ///< in the registry
  std::string value;  ///< what stands for its value: "FIRST,LAST"
  std::string what;
};

struct Verb {
  VerbWords words;
  std::string usage, what, example;
  std::vector<CommonOption> common;
};

const std::vector<Verb>& program_verbs();

/// @throws Error for what is no command of the verb.
std::vector<std::string> petsc_words_of(const std::string& verb,
                                        const std::vector<std::string>& words);

/// Help of a verb, with the common options or all of its own; for any other word of the whole
/// program.
std::string help_text(const std::string& asked, bool all_options);

} // namespace flexgram
