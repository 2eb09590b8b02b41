/// The command line in short words, `flexgram reduce rack.h5 --band 10,500 -o rack.rom.h5`,
/// and as PETSc takes it: `-body rack.h5 -mor_band_hz 10,500 -mor_out rack.rom.h5`. Both may be
/// mixed. Used by the program's main.

#pragma once

#include "base/options.hpp"

#include <string>
#include <vector>

namespace flexgram {

/// A verb: its name, and what it calls its files: the options for words without one, in their
/// order, and for -o.
struct VerbWords {
  std::string name;
  std::vector<std::string> inputs;
  std::string output;
};

/// The words behind the verb as PETSc takes them.
///
/// `--band` stands for -mor_band_hz, `--load-patterns=12` for -mor_load_patterns 12: the option
/// without `mor` and `_hz`, with hyphens. `-v`, `-vv` and `-q` set what is printed. Words with one
/// dash are PETSc's and stay, each with the word behind it that is no option.
/// @param options  of all verbs.
/// @throws Error for an unknown or incomplete option, one of another verb, one that is given twice,
/// and for a file too many.
std::vector<std::string> petsc_words(const std::vector<std::string>& words,
                                     const std::vector<Option>& options,
                                     const VerbWords& verb);

} // namespace flexgram
