#include "base/parallel.hpp"

#include "base/error.hpp"
#include "base/index.hpp"
#include "base/text.hpp"

#include <algorithm>
#include <complex>

namespace flexgram {

int comm_rank(MPI_Comm comm) {
  int rank = 0;
  MPI_Comm_rank(comm, &rank);
  return rank;
}

int comm_size(MPI_Comm comm) {
  int size = 1;
  MPI_Comm_size(comm, &size);
  return size;
}

void throw_if_any_failed(MPI_Comm comm, const char* local_message) {
  const int rank = comm_rank(comm), size = comm_size(comm);
  int mine = local_message ? rank : size, first = size;
  MPI_Request request;
  MPI_Iallreduce(&mine, &first, 1, MPI_INT, MPI_MIN, comm, &request);
  if (local_message) {
    // The others may be in work that has lost its sense, or wait for this rank inside it.
    const double start = MPI_Wtime();
    for (int done = 0; !done;) {
      MPI_Test(&request, &done, MPI_STATUS_IGNORE);
      if (!done && MPI_Wtime() - start > 10) {
        tell_error(text("%s (rank %d)", option_names(local_message).c_str(), rank));
        MPI_Abort(comm, 1);
      }
    }
  } else {
    MPI_Wait(&request, MPI_STATUS_IGNORE);
  }
  if (first == size) return;
  std::string message = local_message ? local_message : "";
  int length = static_cast<int>(message.size());
  MPI_Bcast(&length, 1, MPI_INT, first, comm);
  message.resize(as_size(length));
  MPI_Bcast(message.data(), length, MPI_CHAR, first, comm);
  throw Error(message);
}

void share_text(MPI_Comm comm, std::string& value) {
  int length = static_cast<int>(value.size());
  MPI_Bcast(&length, 1, MPI_INT, 0, comm);
  value.resize(as_size(length));
  MPI_Bcast(value.data(), length, MPI_CHAR, 0, comm);
}

Communicator::~Communicator() {
  int finalized = 0;
  MPI_Finalized(&finalized);
  if (comm_ != MPI_COMM_NULL && !finalized) MPI_Comm_free(&comm_);
}

Groups::Groups(MPI_Comm world_comm, int group_count)
    : world(world_comm), count(group_count) {
  const int size = comm_size(world);
  if (count < 1 || count > size)
    throw Error(
        text("{groups} %d: must be between 1 and the number of ranks (%d)", count, size));
  const int rank = comm_rank(world);
  mine = static_cast<int>(static_cast<long>(rank) * count / size);
  MPI_Comm split = MPI_COMM_NULL;
  MPI_Comm_split(world, mine, rank, &split);
  comm = Communicator(split);
}

std::vector<RowRange> batches_of(RowRange rows, std::int64_t columns) {
  constexpr std::int64_t numbers = 1 << 20;
  const auto most = static_cast<PetscInt>(
      std::max<std::int64_t>(1, numbers / std::max<std::int64_t>(1, columns)));
  std::vector<RowRange> batches;
  for (PetscInt begin = rows.begin; begin < rows.end; begin += batches.back().size())
    batches.push_back({begin, begin + std::min(most, rows.end - begin)});
  return batches;
}

RowRange even_rows(MPI_Comm comm, PetscInt n) {
  PetscInt local = PETSC_DECIDE;
  FG_CALL(PetscSplitOwnership(comm, &local, &n));
  PetscInt end = 0;
  MPI_Scan(&local, &end, 1, MPIU_INT, MPI_SUM, comm);
  return {end - local, end};
}

std::vector<PetscInt> row_starts(MPI_Comm comm, RowRange mine) {
  std::vector<PetscInt> starts(as_size(comm_size(comm)) + 1, 0);
  MPI_Allgather(&mine.end, 1, MPIU_INT, starts.data() + 1, 1, MPIU_INT, comm);
  return starts;
}

namespace {

struct Offer {
  PetscInt begin, end, columns, first_column, wanted_begin, wanted_end;
};

RowRange common_rows(PetscInt begin_a, PetscInt end_a, PetscInt begin_b, PetscInt end_b) {
  const PetscInt begin = std::max(begin_a, begin_b);
  return {begin, std::max(begin, std::min(end_a, end_b))};
}

} // namespace

template <class T>
std::vector<T> exchange_rows(MPI_Comm comm, RowRange offered, std::span<const T> values,
                             PetscInt columns, PetscInt first_column, RowRange wanted,
                             PetscInt total_columns) {
  const int size = comm_size(comm);
  const Offer mine{offered.begin, offered.end,  columns,
                   first_column,  wanted.begin, wanted.end};
  std::vector<Offer> all(as_size(size));
  MPI_Allgather(&mine, 6, MPIU_INT, all.data(), 6, MPIU_INT, comm);

  // One message a pair of ranks: point to point, so that counts stay below MPI's int.
  std::vector<std::vector<T>> outbox(as_size(size));
  std::vector<std::vector<T>> inbox(as_size(size));
  std::vector<MPI_Request> requests;
  const auto post = [&](auto&& call) {
    requests.emplace_back();
    call(&requests.back());
  };
  MPI_Datatype element;
  MPI_Type_contiguous(sizeof(T), MPI_BYTE, &element);
  MPI_Type_commit(&element);
  requests.reserve(2 * as_size(size));
  for (int rank = 0; rank < size; ++rank) {
    const Offer& other = all[as_size(rank)];
    const RowRange in =
        common_rows(other.begin, other.end, mine.wanted_begin, mine.wanted_end);
    if (in.size() > 0 && other.columns > 0) {
      auto& buffer = inbox[as_size(rank)];
      buffer.resize(as_size(in.size() * other.columns));
      post([&](MPI_Request* request) {
        MPI_Irecv(buffer.data(), static_cast<int>(buffer.size()), element, rank, 0, comm,
                  request);
      });
    }
    const RowRange out =
        common_rows(mine.begin, mine.end, other.wanted_begin, other.wanted_end);
    if (out.size() > 0 && columns > 0) {
      auto& buffer = outbox[as_size(rank)];
      buffer.reserve(as_size(out.size() * columns));
      for (PetscInt column = 0; column < columns; ++column) {
        const T* first =
            values.data() + column * offered.size() + (out.begin - mine.begin);
        buffer.insert(buffer.end(), first, first + out.size());
      }
      post([&](MPI_Request* request) {
        MPI_Isend(buffer.data(), static_cast<int>(buffer.size()), element, rank, 0, comm,
                  request);
      });
    }
  }
  MPI_Waitall(static_cast<int>(requests.size()), requests.data(), MPI_STATUSES_IGNORE);
  MPI_Type_free(&element);

  std::vector<T> result(as_size(wanted.size() * total_columns));
  for (int rank = 0; rank < size; ++rank) {
    const Offer& other = all[as_size(rank)];
    const auto& buffer = inbox[as_size(rank)];
    if (buffer.empty()) continue;
    const RowRange in = common_rows(other.begin, other.end, wanted.begin, wanted.end);
    for (PetscInt column = 0; column < other.columns; ++column)
      std::copy_n(buffer.data() + column * in.size(), in.size(),
                  result.data() + (other.first_column + column) * wanted.size() +
                      (in.begin - wanted.begin));
  }
  return result;
}

template std::vector<double> exchange_rows(MPI_Comm, RowRange, std::span<const double>,
                                           PetscInt, PetscInt, RowRange, PetscInt);
template std::vector<std::int64_t> exchange_rows(MPI_Comm, RowRange,
                                                 std::span<const std::int64_t>, PetscInt,
                                                 PetscInt, RowRange, PetscInt);

template <class T>
std::vector<T> gathered(MPI_Comm comm, std::span<const T> mine) {
  const int count = static_cast<int>(mine.size() * sizeof(T));
  std::vector<int> counts(as_size(comm_size(comm))), starts(counts.size() + 1, 0);
  MPI_Allgather(&count, 1, MPI_INT, counts.data(), 1, MPI_INT, comm);
  std::partial_sum(counts.begin(), counts.end(), starts.begin() + 1);
  std::vector<T> all(as_size(starts.back()) / sizeof(T));
  MPI_Allgatherv(mine.data(), count, MPI_BYTE, all.data(), counts.data(), starts.data(),
                 MPI_BYTE, comm);
  return all;
}
template std::vector<double> gathered(MPI_Comm, std::span<const double>);
template std::vector<std::int64_t> gathered(MPI_Comm, std::span<const std::int64_t>);
template std::vector<int> gathered(MPI_Comm, std::span<const int>);

double sum_over(MPI_Comm comm, double value) {
  double sum = 0;
  MPI_Allreduce(&value, &sum, 1, MPI_DOUBLE, MPI_SUM, comm);
  return sum;
}

double max_over(MPI_Comm comm, double value) {
  double maximum = 0;
  MPI_Allreduce(&value, &maximum, 1, MPI_DOUBLE, MPI_MAX, comm);
  return maximum;
}

std::int64_t sum_over(MPI_Comm comm, std::int64_t value) {
  std::int64_t sum = 0;
  MPI_Allreduce(&value, &sum, 1, MPI_INT64_T, MPI_SUM, comm);
  return sum;
}

} // namespace flexgram
