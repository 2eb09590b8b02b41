/// Verbs of the Python package under the same command: `flexgram import …` becomes
/// `python3 -m flexgram import …`.

#pragma once

#include <string>
#include <utility>
#include <vector>

namespace flexgram {

/// Name and what it does, as python/flexgram/commands.py has them.
const std::vector<std::pair<std::string, std::string>>& python_verbs();
bool is_python_verb(const std::string& verb);

/// Becomes Python: the one that FLEXGRAM_PYTHON names, that of the environment that this
/// command lies in (python3 beside the program or the link to it by which it was called),
/// the one that it was built for, or the first of PATH.
/// @return exit status 1, with a message, where there is none.
int run_python(char** argv);

} // namespace flexgram
