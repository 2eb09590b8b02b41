#include "base/process.hpp"

#include "base/error.hpp"

#include <malloc.h>
#include <sys/resource.h>
#include <unistd.h>

#include <algorithm>
#include <csignal>
#include <cstdlib>
#include <ctime>
#include <fstream>
#include <limits>
#include <sched.h>
#include <string>

namespace flexgram {

namespace {

volatile std::sig_atomic_t asked = 0;

extern "C" void ask_to_end(int signal) {
  asked = 1;
  std::signal(signal, SIG_DFL); // a second one ends at once
  if (signal != SIGINT) return;
  constexpr char words[] = "\nending after the present step; Ctrl-C again ends at once\n";
  [[maybe_unused]] const auto written = ::write(STDERR_FILENO, words, sizeof words - 1);
}

volatile std::sig_atomic_t interrupted = 0;

extern "C" void ask_to_stop(int signal) {
  interrupted = 1;
  std::signal(signal, SIG_DFL); // a second one ends at once
}

} // namespace

InterruptGuard::InterruptGuard() {
  interrupted = 0;
  if (sigaction(SIGINT, nullptr, &before_) != 0 || before_.sa_handler == SIG_IGN) return;
  struct sigaction ours {};
  ours.sa_handler = ask_to_stop;
  ours.sa_flags = SA_RESTART;
  installed_ = sigaction(SIGINT, &ours, nullptr) == 0;
}

InterruptGuard::~InterruptGuard() {
  const bool late = interrupted != 0;
  interrupted = 0;
  if (installed_) sigaction(SIGINT, &before_, nullptr);
  if (late) std::raise(SIGINT); // the work was done before it looked
}

void stop_if_interrupted() {
  if (!interrupted) return;
  interrupted = 0;
  throw Interrupted("interrupted");
}

void let_sigterm_ask() { std::signal(SIGTERM, ask_to_end); }

void let_ctrl_c_ask() {
  if (std::signal(SIGINT, ask_to_end) == SIG_IGN) std::signal(SIGINT, SIG_IGN);
}

bool asked_to_end() { return asked != 0; }

NodeShare node_share(MPI_Comm comm) {
  MPI_Comm node;
  MPI_Comm_split_type(comm, MPI_COMM_TYPE_SHARED, 0, MPI_INFO_NULL, &node);
  NodeShare share;
  MPI_Comm_size(node, &share.ranks);
  // Ranks may be bound to different cores: the union of their sets is what they share.
  cpu_set_t mine, all;
  CPU_ZERO(&mine);
  sched_getaffinity(0, sizeof(mine), &mine);
  MPI_Allreduce(&mine, &all, sizeof(mine), MPI_BYTE, MPI_BOR, node);
  MPI_Comm_free(&node);
  share.cores_per_rank = std::max(1, CPU_COUNT(&all) / share.ranks);
  return share;
}

std::string host_name() {
  char name[256] = "";
  gethostname(name, sizeof(name) - 1);
  return name;
}

std::string utc_time() {
  char words[32] = "";
  const std::time_t now = std::time(nullptr);
  std::tm parts{};
  std::strftime(words, sizeof(words), "%Y-%m-%dT%H:%M:%SZ", gmtime_r(&now, &parts));
  return words;
}

void keep_freed_pages() {
#ifdef __GLIBC__
  mallopt(M_MMAP_THRESHOLD, std::numeric_limits<int>::max());
  mallopt(M_TRIM_THRESHOLD, std::numeric_limits<int>::max());
#endif
}

void give_back_freed_pages() {
#ifdef __GLIBC__
  malloc_trim(0);
#endif
}

double peak_memory_mb() {
  rusage usage{};
  getrusage(RUSAGE_SELF, &usage);
  return static_cast<double>(usage.ru_maxrss) / 1024.0;
}

double resident_memory_mb() {
  std::ifstream file("/proc/self/statm"); // pages: all, resident, …
  double all = 0, resident = 0;
  file >> all >> resident;
  return resident * static_cast<double>(sysconf(_SC_PAGESIZE)) / 1e6;
}

namespace {

double meminfo_available_mb() {
  std::ifstream file("/proc/meminfo");
  for (std::string line; std::getline(file, line);)
    if (line.rfind("MemAvailable:", 0) == 0) return std::stod(line.substr(13)) / 1024.0;
  return 1e9; // unknown system: no limit
}

double read_number(const std::string& path) {
  std::ifstream file(path);
  double value = -1;
  return file >> value ? value : -1;
}

/// Memory that the control groups (version 2) of this process still allow, from its own
/// up to the root [MB]; page cache that can be dropped counts as free.
double cgroup_available_mb() {
  std::string group;
  std::ifstream self("/proc/self/cgroup");
  for (std::string line; std::getline(self, line);)
    if (line.rfind("0::", 0) == 0) group = line.substr(3);
  double available = 1e9;
  for (;;) {
    const std::string folder = "/sys/fs/cgroup" + group;
    const double limit = read_number(folder + "/memory.max");
    const double used = read_number(folder + "/memory.current");
    if (limit > 0 && used >= 0) {
      double cache = 0;
      std::ifstream statistics(folder + "/memory.stat");
      for (std::string key; statistics >> key;) {
        double value = 0;
        statistics >> value;
        if (key == "inactive_file") cache = value;
      }
      available = std::min(available, (limit - used + cache) / 1048576.0);
    }
    if (group.empty() || group == "/") return available;
    group.resize(group.rfind('/'));
  }
}

} // namespace

/// What a limit of this process's own leaves (ulimit -v).
double address_space_mb() {
  rlimit limit{};
  if (getrlimit(RLIMIT_AS, &limit) != 0 || limit.rlim_cur == RLIM_INFINITY)
    return std::numeric_limits<double>::infinity();
  double pages = 0;
  std::ifstream("/proc/self/statm") >> pages;
  const double used = pages * static_cast<double>(sysconf(_SC_PAGESIZE));
  return std::max(0.0, (static_cast<double>(limit.rlim_cur) - used) / 1e6);
}

double available_memory_mb(MPI_Comm comm) {
  const double shared = std::min(meminfo_available_mb(), cgroup_available_mb());
  return std::min(shared / node_share(comm).ranks, address_space_mb());
}

double now() { return MPI_Wtime(); }

} // namespace flexgram
