#pragma once

#include <mpi.h>

#include <csignal>
#include <string>

namespace flexgram {

/// Ranks of comm on this node, and hardware threads of the node that each may use.
struct NodeShare {
  int ranks = 1;
  int cores_per_rank = 1;
};
NodeShare node_share(MPI_Comm comm);

/// Makes malloc keep freed pages: large work arrays are reused by each factorisation, and
/// the first touch of fresh memory is dear in virtual machines.
void keep_freed_pages();
/// Gives them back all the same, now: where memory is what is short.
void give_back_freed_pages();

/// Name of this machine, and the time as 2026-01-31T12:00:00Z.
std::string host_name();
std::string utc_time();

/// Peak resident memory of this process [MB].
double peak_memory_mb();

/// Resident memory of this process now [MB].
double resident_memory_mb();

/// Memory that this rank may still use [MB]: the node's available memory divided by the
/// ranks of comm on that node; the limit of the control group, if any, counts too.
double available_memory_mb(MPI_Comm comm);

/// From now on SIGTERM (a batch system's time limit) only asks the work to end.
void let_sigterm_ask();
/// The same of the first Ctrl-C, unless it is ignored (a job in the background).
void let_ctrl_c_ask();
/// Whether it did, on this rank.
bool asked_to_end();

/// While it lives, the first SIGINT (Ctrl-C) only asks this process to end, see
/// stop_if_interrupted(); a second one ends it. For work on one rank: mpirun ends several.
class InterruptGuard {
public:
  InterruptGuard();
  ~InterruptGuard();
  InterruptGuard(const InterruptGuard&) = delete;
  InterruptGuard& operator=(const InterruptGuard&) = delete;

private:
  struct sigaction before_ {};
  bool installed_ = false;
};
/// Called between the steps of long work.
/// @throws Interrupted if Ctrl-C asked this rank to end.
void stop_if_interrupted();

/// Wall clock [s].
double now();

} // namespace flexgram
