#pragma once

#include "base/error.hpp"

#include <mpi.h>
#include <petscsys.h>

#include <cstdint>
#include <new>
#include <span>
#include <vector>

namespace flexgram {

int comm_rank(MPI_Comm comm);
int comm_size(MPI_Comm comm);

/// Ends the call on every rank if it failed on any: all throw the message of the lowest
/// failing rank. If the others do not arrive within ten seconds, the run is aborted with
/// the message. Collective.
void throw_if_any_failed(MPI_Comm comm, const char* local_message);

/// Runs rank-local work that can fail; if it throws on one rank, all ranks throw
/// together. The work may communicate within a part of comm whose ranks fail together.
/// Collective on comm, always on.
template <class Work>
void agree(MPI_Comm comm, Work&& work) {
  std::string message;
  bool failed = false;
  try {
    std::forward<Work>(work)();
  } catch (const Interrupted& asked) {
    if (comm_size(comm) == 1) throw; // Ctrl-C is no error of the work
    message = asked.what();
    failed = true;
  } catch (const std::bad_alloc&) {
    message = out_of_memory;
    failed = true;
  } catch (const std::exception& error) {
    message = error.what();
    failed = true;
  }
  throw_if_any_failed(comm, failed ? message.c_str() : nullptr);
}

/// Rank 0's text on every rank.
void share_text(MPI_Comm comm, std::string& value);

/// Owns a communicator made by split or duplication.
class Communicator {
public:
  Communicator() = default;
  explicit Communicator(MPI_Comm adopted) : comm_(adopted) {}
  Communicator(Communicator&& other) noexcept
      : comm_(std::exchange(other.comm_, MPI_COMM_NULL)) {}
  Communicator& operator=(Communicator&& other) noexcept {
    std::swap(comm_, other.comm_);
    return *this;
  }
  ~Communicator();
  operator MPI_Comm() const { return comm_; }

private:
  MPI_Comm comm_ = MPI_COMM_NULL;
};

/// A world split into groups of neighbouring ranks; each group works on its own
/// frequencies.
struct Groups {
  Groups(MPI_Comm world, int count);
  MPI_Comm world;
  int count; ///< number of groups
  int mine;  ///< group of this rank, 0 … count − 1
  Communicator comm;
};

/// A contiguous range of rows; ranges of the ranks of a communicator follow each other.
struct RowRange {
  PetscInt begin = 0, end = 0;
  PetscInt size() const { return end - begin; }
};

/// The rows in batches of a million numbers or less, if a row is no longer.
std::vector<RowRange> batches_of(RowRange rows, std::int64_t columns);

/// PETSc's own even split of n rows over comm.
RowRange even_rows(MPI_Comm comm, PetscInt n);

/// First row of each rank of comm, and n at the end (size + 1 numbers). Collective.
std::vector<PetscInt> row_starts(MPI_Comm comm, RowRange mine);

/// Moves dense rows between layouts. Every rank offers the rows `offered` of `columns`
/// columns (column-major, leading dimension offered.size()), which are columns
/// first_column … of the result, and gets the rows `wanted` of all columns. Serves group
/// ← world (all offer the same columns) and world ← groups (each group offers its own).
/// Collective on comm.
template <class T>
std::vector<T> exchange_rows(MPI_Comm comm, RowRange offered, std::span<const T> values,
                             PetscInt columns, PetscInt first_column, RowRange wanted,
                             PetscInt total_columns);

/// The values of all ranks, one rank's behind another's, on every rank. Collective.
template <class T>
std::vector<T> gathered(MPI_Comm comm, std::span<const T> mine);

/// Sum, maximum over comm.
double sum_over(MPI_Comm comm, double value);
double max_over(MPI_Comm comm, double value);
std::int64_t sum_over(MPI_Comm comm, std::int64_t value);

} // namespace flexgram
