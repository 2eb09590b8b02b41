#pragma once

#include <mpi.h>

#include <functional>
#include <string>
#include <vector>

namespace flexgram {

/// A program with verbs.
struct Program {
  std::vector<std::string> verbs;
  /// The words behind a verb as PETSc takes them. @throws Error for what is no command.
  std::function<std::vector<std::string>(const std::string& verb,
                                         const std::vector<std::string>& words)>
      petsc_words;
  /// Of a verb, or of the whole program for any other word; with all options, or those that
  /// most people use.
  std::function<std::string(const std::string& verb, bool all_options)> help;
  /// @return the exit status.
  std::function<int(const std::string& verb, MPI_Comm comm)> run;
};

/// One run: starts MPI, PETSc and SLEPc, runs the verb, and turns any exception into one
/// message on standard error and exit status 1 on every rank.
/// Ranks that fail alone end the whole run instead of leaving the others waiting.
int run_session(int argc, char** argv, const Program& program);

} // namespace flexgram
