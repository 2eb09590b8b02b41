#include "python_verbs.hpp"

#include "base/error.hpp"

#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <sstream>

namespace flexgram {
namespace {

namespace fs = std::filesystem;

bool is_program(const fs::path& path) {
  std::error_code ignored;
  return fs::is_regular_file(path, ignored) && access(path.c_str(), X_OK) == 0;
}

/// The path by which a program was called, looked up as a shell does.
fs::path called_as(const char* name) {
  if (std::strchr(name, '/')) return name;
  const char* path = std::getenv("PATH");
  std::istringstream folders(path ? path : "");
  for (std::string folder; std::getline(folders, folder, ':');)
    if (is_program(fs::path(folder) / name)) return fs::path(folder) / name;
  return {};
}

std::string python_of(const char* called) {
  if (const char* named = std::getenv("FLEXGRAM_PYTHON")) return named;
  std::error_code ignored;
  const fs::path self = fs::read_symlink("/proc/self/exe", ignored);
  for (const fs::path& candidate :
       {called_as(called).parent_path() / "python3", self.parent_path() / "python3",
        fs::path(FLEXGRAM_PYTHON_COMMAND)})
    if (is_program(candidate)) return candidate;
  return "python3";
}

} // namespace

const std::vector<std::pair<std::string, std::string>>& python_verbs() {
  static const std::vector<std::pair<std::string, std::string>> verbs{
      {"import", "mesh description or files of an FE code -> body file"},
      {"info", "what a body, reduced or sweep file holds"},
      {"view", "show a body, a mesh or a reduced body in the browser"},
      {"report", "reduced file -> one self-contained HTML page"},
      {"plot", "reduced or sweep file -> figures"},
      {"export", "reduced file -> multibody codes and other tools"},
      {"frf", "frequency responses between ports: table, Bode plot, universal file"},
      {"modes", "natural modes of a body, compared with measured ones: table, "
                "universal file, MAC"},
      {"couple", "reduced files of several bodies -> one, with joints and springs"},
      {"at", "reduced file of a body with parameters -> the same at given values"},
      {"campbell",
       "natural frequencies, damping and whirl of a reduced body over its speed"},
      {"hotspots", "where the stress of a reduced body is largest per unit of a load"},
      {"simulate", "response of a reduced body to forces over time"},
      {"completion", "script that makes bash or zsh complete flexgram"},
  };
  return verbs;
}

bool is_python_verb(const std::string& verb) {
  return std::any_of(python_verbs().begin(), python_verbs().end(),
                     [&](const auto& known) { return known.first == verb; });
}

int run_python(char** argv) {
  const std::string python = python_of(argv[0]);
  std::vector<char*> words;
  // -P: not the modules of the folder that it is called in.
  std::string name = python, safe = "-P", module = "-m", package = "flexgram";
  for (std::string* word : {&name, &safe, &module, &package})
    words.push_back(word->data());
  for (char** word = argv + 1; *word; ++word) words.push_back(*word);
  words.push_back(nullptr);
  execvp(python.c_str(), words.data());
  tell_error(std::string(argv[1]) + " belongs to the Python package: " + python + ": " +
             std::strerror(errno));
  return 1;
}

} // namespace flexgram
