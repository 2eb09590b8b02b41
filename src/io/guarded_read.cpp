#include "io/guarded_read.hpp"

#include "base/parallel.hpp"

#include <sys/time.h>
#include <unistd.h>

#include <csignal>
#include <cstdio>
#include <cstring>
#include <iterator>

namespace flexgram {
namespace {

char last_words[1024];
bool speaks = false;

/// The process's memory is damaged: nothing but to say why and to end.
void give_up(int) {
  if (speaks) {
    [[maybe_unused]] const auto written =
        ::write(STDERR_FILENO, last_words, std::strlen(last_words));
  } else {
    ::sleep(20); // or mpirun would end the rank that speaks
  }
  ::_exit(1);
}

} // namespace

bool guarded(MPI_Comm comm, const std::string& what, const std::function<bool()>& read) {
  speaks = comm_rank(comm) == 0;
  std::snprintf(last_words, sizeof last_words, "flexgram: %s\n", what.c_str());
  struct sigaction guard = {};
  guard.sa_handler = give_up;
  sigemptyset(&guard.sa_mask);
  constexpr int signals[] = {SIGSEGV, SIGBUS, SIGABRT, SIGVTALRM};
  struct sigaction before[std::size(signals)] = {};
  for (std::size_t i = 0; i < std::size(signals); ++i)
    sigaction(signals[i], &guard, &before[i]);
  itimerval limit = {{0, 0}, {10, 0}};
  setitimer(ITIMER_VIRTUAL, &limit, nullptr);
  const bool good = read();
  limit.it_value.tv_sec = 0;
  setitimer(ITIMER_VIRTUAL, &limit, nullptr);
  for (std::size_t i = 0; i < std::size(signals); ++i)
    sigaction(signals[i], &before[i], nullptr);
  return good;
}

} // namespace flexgram
