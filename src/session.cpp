#include "session.hpp"

#include "base/blas.hpp"
#include "base/error.hpp"
#include "base/parallel.hpp"
#include "base/process.hpp"
#include "base/text.hpp"
#include "io/hdf5_file.hpp"
#include "io/versions.hpp"

#include <slepcsys.h>

#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <csignal>
#include <cstdio>
#include <cstring>
#include <fstream>
#include <initializer_list>
#include <sstream>
#include <thread>

namespace flexgram {
namespace {

/// True if all ranks arrive here within some seconds: then they failed together.
bool all_ranks_failed(MPI_Comm handshake) {
  MPI_Request request;
  MPI_Ibarrier(handshake, &request);
  const double start = now();
  for (int done = 0; now() - start < 10.0;) {
    MPI_Test(&request, &done, MPI_STATUS_IGNORE);
    if (done) return true;
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  }
  return false;
}

bool is_one_of(const std::string& word, std::initializer_list<const char*> spellings) {
  return std::any_of(spellings.begin(), spellings.end(),
                     [&](const char* spelling) { return word == spelling; });
}

/// PETSc's -help tells all, as everywhere in PETSc.
bool asks_for_all(const std::string& word) {
  return is_one_of(word, {"-help", "--help-all"});
}

bool asks_for_help(const std::string& word) {
  return asks_for_all(word) || is_one_of(word, {"--help", "-h", "help"});
}

/// Words as a C program takes them, which live as long as this does.
class Arguments {
public:
  explicit Arguments(std::vector<std::string> words) : words_(std::move(words)) {
    for (std::string& word : words_) pointers_.push_back(word.data());
    pointers_.push_back(nullptr);
  }
  int count() const { return static_cast<int>(words_.size()); }
  char** words() { return pointers_.data(); }

private:
  std::vector<std::string> words_;
  std::vector<char*> pointers_;
};

/// PETSc would answer a missing file, or a line that is none, with pages.
void require_options_file(const std::vector<std::string>& all) {
  for (std::size_t i = 0; i + 1 < all.size(); ++i) {
    if (all[i] != "-options_file") continue;
    const std::string& path = all[i + 1];
    if (access(path.c_str(), R_OK) != 0)
      throw Error("-options_file " + path + ": " + std::strerror(errno));
    const std::string end = path.substr(path.find_last_of('.') + 1);
    if (end == "yaml" || end == "yml") continue; // PETSc reads these too
    std::ifstream file(path);
    int number = 1;
    for (std::string line; std::getline(file, line); ++number) {
      line.erase(std::min(line.find('#'), line.size()));
      std::istringstream words(line);
      std::string option, value, more;
      words >> option >> value >> more;
      if (!option.empty() && option[0] != '-' && option[0] != '!' && option[0] != '%' &&
          option[0] != ';' && option != "alias")
        throw Error(
            text("-options_file %s, line %d: %s: each line begins with an option, "
                 "such as -mor_band_hz 10,500",
                 path.c_str(), number, option.c_str()));
      if (!option.empty() && option[0] == '-' && !more.empty() && value[0] != '"' &&
          value[0] != '\'' && value[0] != '-' && more[0] != '-')
        throw Error(text("-options_file %s, line %d: %s %s %s: an option takes one word, "
                         "lists have commas and no spaces",
                         path.c_str(), number, option.c_str(), value.c_str(),
                         more.c_str()));
    }
  }
}

/// Options that nobody read: misspelt ones without a prefix of ours.
void warn_of_unused_options() {
  PetscInt count = 0;
  char **names = nullptr, **values = nullptr;
  FG_CALL(PetscOptionsLeftGet(nullptr, &count, &names, &values));
  for (PetscInt i = 0; i < count; ++i)
    PetscPrintf(PETSC_COMM_WORLD, "warning: option -%s was not used by anything\n",
                names[i]);
  FG_CALL(PetscOptionsLeftRestore(nullptr, &count, &names, &values));
}

/// PETSc 3.22 names options at its end that nobody read. After an error these are all of them, and
/// else warn_of_unused_options() has named them.
void keep_petsc_silent_about_options() {
  PetscBool is_given = PETSC_FALSE;
  PetscOptionsHasName(nullptr, nullptr, "-options_left", &is_given);
  if (!is_given) PetscOptionsSetValue(nullptr, "-options_left", "no");
}

volatile int exit_status = 1;

/// Open MPI's own handler would wait for ever for the memory that malloc has locked.
void aborted(int) {
  constexpr char words[] =
      "flexgram: aborted: the memory is damaged (by a damaged file?) "
      "or a library gave up\n";
  [[maybe_unused]] const auto written = ::write(STDERR_FILENO, words, sizeof words - 1);
  ::_exit(1);
}

/// Bytes of damaged files that are no text, as '?'.
std::string printable(const std::string& message) {
  std::string clean;
  for (std::size_t i = 0; i < message.size();) {
    const auto lead = static_cast<unsigned char>(message[i]);
    const std::size_t size = lead < 0x80   ? 1
                             : lead < 0xc2 ? 0
                             : lead < 0xe0 ? 2
                             : lead < 0xf0 ? 3
                             : lead < 0xf5 ? 4
                                           : 0;
    bool good = size > 0 && i + size <= message.size();
    for (std::size_t k = 1; good && k < size; ++k)
      good = (static_cast<unsigned char>(message[i + k]) & 0xc0) == 0x80;
    clean += good ? message.substr(i, size) : "?";
    i += good ? size : 1;
  }
  return clean;
}

} // namespace

int run_session(int argc, char** argv, const Program& program) {
  const std::vector<std::string> given(argv + std::min(argc, 1), argv + argc);
  const std::string verb = given.empty() ? "" : given.front();

  std::signal(SIGXFSZ, SIG_IGN); // a file size limit is an error of write, not a crash
  MPI_Init(&argc, &argv);
  std::signal(SIGABRT, aborted);
  const int rank = comm_rank(MPI_COMM_WORLD);
  const auto tell_and_end = [&](const std::string& error) {
    if (rank == 0) tell_error(error);
    MPI_Finalize();
    return 1;
  };
  if (given.empty() || std::any_of(given.begin(), given.end(), asks_for_help)) {
    const std::string of_verb = verb == "help" && given.size() > 1 ? given[1] : verb;
    if (of_verb != verb && std::find(program.verbs.begin(), program.verbs.end(),
                                     of_verb) == program.verbs.end())
      return tell_and_end("unknown verb " + of_verb + suggestion(of_verb, program.verbs));
    const bool all = std::any_of(given.begin(), given.end(), asks_for_all);
    if (rank == 0) std::fputs(program.help(of_verb, all).c_str(), stdout);
    MPI_Finalize();
    return 0;
  }
  if (verb == "-version" || verb == "--version" || verb == "version") {
    if (rank == 0)
      for (const auto& [name, version] : versions())
        std::printf("%-9s %s\n", name.c_str(), version.c_str());
    MPI_Finalize();
    return 0;
  }
  const auto& verbs = program.verbs;
  if (std::find(verbs.begin(), verbs.end(), verb) == verbs.end())
    return tell_and_end(access(verb.c_str(), F_OK) == 0
                            ? "name a verb first: flexgram reduce " + quoted(verb)
                            : "unknown verb " + verb +
                                  (verb == "-V" || verb == "-v"
                                       ? ": did you mean --version?"
                                       : suggestion(verb, verbs)) +
                                  " (there are " + join(verbs) + ")");
  std::vector<std::string> words;
  try {
    words = program.petsc_words(verb, {given.begin() + 1, given.end()});
    require_options_file(words);
  } catch (const Error& error) {
    return tell_and_end(error.what());
  }
  words.insert(words.begin(), {argv[0], verb});
  Arguments arguments(std::move(words));
  argc = arguments.count();
  argv = arguments.words();
  int status = 0;
  MPI_Comm handshake;
  MPI_Comm_dup(MPI_COMM_WORLD, &handshake);
  std::string message;
  try {
    const PetscErrorCode started = SlepcInitialize(&argc, &argv, nullptr, nullptr);
    if (started) throw Error("PETSc or SLEPc did not start; see the message above");
    install_petsc_error_handler();
    std::signal(SIGPIPE, SIG_IGN); // a closed pipe (| head) ends the talk, not the work
    reserve_blas_buffers();
    FG_CALL(PetscLogDefaultBegin());
    status = program.run(verb, PETSC_COMM_WORLD);
    warn_of_unused_options();
  } catch (const std::bad_alloc&) {
    message = out_of_memory;
    status = 1;
  } catch (const Interrupted& ended) {
    message = option_names(ended.what());
    status = 3;
  } catch (const std::exception& error) {
    message = option_names(error.what());
    status = 1;
  }
  if (!message.empty()) {
    const bool together = all_ranks_failed(handshake);
    if (rank == 0 || !together) tell_error(printable(message));
    if (!together) MPI_Abort(MPI_COMM_WORLD, 1);
  }
  MPI_Comm_free(&handshake);
  PetscBool running = PETSC_FALSE;
  PetscInitialized(&running);
  if (running) {
    keep_petsc_silent_about_options();
    SlepcFinalize();
  }
  // The work is done and told: what a library does on its way out changes nothing (HDF5
  // after a damaged file; Open MPI, once in some thousand runs on a busy machine).
  exit_status = status;
  for (int signal : {SIGSEGV, SIGABRT})
    std::signal(signal, [](int) { ::_exit(exit_status); });
  MPI_Finalize();
  return status;
}

} // namespace flexgram
