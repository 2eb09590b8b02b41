/// A limit of the address space (ulimit -v) below what starting takes is refused before
/// anything else: OpenBLAS waits for ever where it gets no memory for its buffers, some of
/// which it takes while the program is loaded. So this runs before the libraries start,
/// on system calls alone.

#include "base/index.hpp"

#include <sched.h>
#include <sys/resource.h>
#include <unistd.h>

#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <initializer_list>

extern "C" __attribute__((weak)) char* openblas_get_config();

namespace {

/// Threads that OpenBLAS will start.
__attribute__((no_sanitize("address", "undefined"))) int
blas_threads(char** environment) {
  for (const char* name :
       {"OPENBLAS_NUM_THREADS=", "GOTO_NUM_THREADS=", "OMP_NUM_THREADS="})
    for (char** entry = environment; *entry; ++entry)
      if (std::strncmp(*entry, name, std::strlen(name)) == 0)
        if (const int count = std::atoi(*entry + std::strlen(name)); count > 0)
          return count < 64 ? count : 64;
  cpu_set_t cores;
  CPU_ZERO(&cores);
  if (sched_getaffinity(0, sizeof(cores), &cores) != 0) return 1;
  return CPU_COUNT(&cores) < 64 ? CPU_COUNT(&cores) : 64;
}

/// Address space of the libraries, MPI and PETSc at their start, and of OpenBLAS' buffer
/// and stack for each thread and the main one [MB], as measured (`ulimit -v` from below).
constexpr unsigned long of_libraries = 470, of_a_thread = 64;

__attribute__((no_sanitize("address", "undefined"))) void check(int, char**,
                                                                char** environment) {
  rlimit limit{};
  if (!openblas_get_config) return; // another BLAS has other needs
  if (getrlimit(RLIMIT_AS, &limit) != 0 || limit.rlim_cur == RLIM_INFINITY) return;
  const auto threads = static_cast<unsigned long>(blas_threads(environment));
  const unsigned long needed = of_libraries + of_a_thread * (threads + 1);
  const unsigned long given = static_cast<unsigned long>(limit.rlim_cur) >> 20;
  if (given >= needed) return;
  char words[256];
  const int length =
      std::snprintf(words, sizeof(words),
                    "flexgram: the address space is limited to %lu MB (ulimit -v), but "
                    "starting with %lu BLAS thread%s takes %lu MB%s\n",
                    given, threads, threads == 1 ? "" : "s", needed,
                    threads == 1 ? "" : "; OPENBLAS_NUM_THREADS=1 needs less");
  if (write(STDERR_FILENO, words, flexgram::as_size(length)) < 0) _exit(2);
  _exit(1);
}

} // namespace

__attribute__((section(".preinit_array"),
               used)) void (*const check_address_space)(int, char**, char**) = check;
