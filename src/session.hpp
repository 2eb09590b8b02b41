#pragma once

#include <mpi.h>

#include <functional>
#include <string>
#include <vector>

namespace flexgram {

/// One run of a program with verbs: starts MPI, PETSc and SLEPc, runs the verb, and turns
/// any exception into one message on standard error and exit status 1 on every rank; else
/// the exit status is what `run` returns.
/// Ranks that fail alone end the whole run instead of leaving the others waiting.
/// @param help  of a verb, or of the whole program for any other word.
int run_session(int argc, char** argv, const std::vector<std::string>& verbs,
                const std::function<std::string(const std::string& verb)>& help,
                const std::function<int(const std::string& verb, MPI_Comm comm)>& run);

} // namespace flexgram
