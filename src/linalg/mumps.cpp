#include "linalg/mumps.hpp"

#include "base/event.hpp"
#include "base/index.hpp"
#include "base/process.hpp"
#include "base/text.hpp"

#include <cmumps_c.h>
#include <dmumps_c.h>
#include <smumps_c.h>
#include <zmumps_c.h>

#include <algorithm>

namespace flexgram {

namespace {

template <class Scalar>
struct Arithmetic;

#define FG_MUMPS_ARITHMETIC(Scalar, PREFIX, prefix)                                      \
  template <>                                                                            \
  struct Arithmetic<Scalar> {                                                            \
    using Struct = PREFIX##MUMPS_STRUC_C;                                                \
    using Value = PREFIX##MUMPS_COMPLEX;                                                 \
    using Real = PREFIX##MUMPS_REAL;                                                     \
    static void call(Struct* s) { prefix##mumps_c(s); }                                  \
  }
FG_MUMPS_ARITHMETIC(float, S, s);
FG_MUMPS_ARITHMETIC(double, D, d);
FG_MUMPS_ARITHMETIC(std::complex<float>, C, c);
FG_MUMPS_ARITHMETIC(std::complex<double>, Z, z);
#undef FG_MUMPS_ARITHMETIC

std::string explain(int info1, int info2) {
  switch (info1) {
  case -5:
  case -7:
  case -13:
    return text("the operating system refused an allocation of %s (INFOG(1:2) = %d, %d)",
                info2 < 0 ? text("%.0f MB", -static_cast<double>(info2) * 8).c_str()
                          : text("%d words", info2).c_str(),
                info1, info2);
  case -10:
    return text("the matrix is numerically singular (INFOG(1:2) = -10, %d)", info2);
  case -90:
    return "out-of-core files could not be written";
  default:
    return text("MUMPS failed with INFOG(1:2) = %d, %d", info1, info2);
  }
}

/// Each row's owner, for sending the distributed solution home.
int owner_of(const std::vector<PetscInt>& starts, PetscInt row) {
  return static_cast<int>(std::upper_bound(starts.begin(), starts.end(), row) -
                          starts.begin()) -
         1;
}

} // namespace

std::string mumps_version() { return MUMPS_VERSION; }

template <class Scalar>
struct Mumps<Scalar>::Instance {
  using Traits = Arithmetic<Scalar>;
  using Value = typename Traits::Value;

  Instance(MPI_Comm communicator, const MumpsOptions& settings, MatrixKind kind)
      : comm(communicator), options(settings) {
    s.par = 1;
    s.sym = kind == MatrixKind::symmetric ? 2 : 0;
    s.comm_fortran = MPI_Comm_c2f(comm);
    run(-1);
    icntl(1) = icntl(2) = icntl(3) = -1; // no output: errors come as exceptions
    icntl(4) = 0;
    icntl(14) = options.workspace_percent;
    icntl(18) = 3; // distributed entries
    pivot_threshold = s.cntl[0];
    for (auto [n, value] : options.icntl) icntl(n) = static_cast<int>(value);
    for (auto [n, value] : options.cntl)
      s.cntl[n - 1] = static_cast<typename Traits::Real>(value);
  }
  ~Instance() {
    int finalized = 0;
    MPI_Finalized(&finalized);
    if (!finalized) run(-2);
  }

  int& icntl(int n) { return s.icntl[n - 1]; }
  int infog(int n) const { return s.infog[n - 1]; }
  int run(int job) {
    s.job = job;
    static Event analysis("MumpsAnalysis"), factor("MumpsFactor"), solve("MumpsSolve");
    if (job >= 1 && job <= 3) {
      const auto timed = (job == 1 ? analysis : job == 2 ? factor : solve).timed();
      Traits::call(&s);
      return infog(1);
    }
    Traits::call(&s);
    return infog(1);
  }
  void hand_over(const Pattern& pattern) {
    s.nnz_loc = static_cast<MUMPS_INT8>(pattern.row.size());
    s.irn_loc = const_cast<int*>(pattern.row.data());
    s.jcn_loc = const_cast<int*>(pattern.column.data());
  }
  /// MUMPS' "analysis by blocks".
  void hand_over_blocks(const PivotOrder& order) {
    icntl(15) = 1;
    block_start.clear();
    for (int start : order.block_start) block_start.push_back(start + 1);
    block_variables.resize(order.position.size());
    for (std::size_t i = 0; i < order.position.size(); ++i)
      block_variables[as_size(order.position[i] - 1)] = static_cast<int>(i) + 1;
    s.nblk = std::max(static_cast<int>(block_start.size()) - 1, 0);
    s.blkptr = block_start.data();
    s.blkvar = block_variables.data();
  }
  bool user_set(int n) const { return options.icntl.count(n) > 0; }

  void redistribute(const std::vector<int>& solution_rows,
                    const std::vector<Scalar>& solution, RowRange rows,
                    std::span<Scalar> x, int columns);
  void solve_distributed(RowRange rows, std::span<Scalar> x, int columns);

  MPI_Comm comm;
  MumpsOptions options;
  typename Traits::Struct s{};
  bool tolerate_null_pivots = false;
  typename Traits::Real pivot_threshold = 0; ///< MUMPS' own CNTL(1)
  double estimated_mb = 0;
  std::vector<Scalar> values; ///< entries of the matrix, while it is factorised
  std::vector<int> block_start, block_variables; ///< BLKPTR, BLKVAR
};

template <class Scalar>
Mumps<Scalar>::Mumps(MPI_Comm comm, const MumpsOptions& options, MatrixKind kind)
    : instance_(std::make_unique<Instance>(comm, options, kind)) {}
template <class Scalar>
Mumps<Scalar>::~Mumps() = default;
template <class Scalar>
Mumps<Scalar>::Mumps(Mumps&&) noexcept = default;
template <class Scalar>
Mumps<Scalar>& Mumps<Scalar>::operator=(Mumps&&) noexcept = default;

template <class Scalar>
FactorEstimate Mumps<Scalar>::analyse(const Pattern& pattern, const PivotOrder& order) {
  auto& m = *instance_;
  const auto known = [&](bool here) {
    int there = here;
    MPI_Bcast(&there, 1, MPI_INT, 0, m.comm);
    return there != 0;
  };
  const bool given = known(!order.position.empty()),
             blocks = known(!order.block_start.empty()) && !m.user_set(15);
  m.s.n = pattern.n;
  m.hand_over(pattern);
  if (given) m.s.perm_in = const_cast<int*>(order.position.data());
  if (blocks) m.hand_over_blocks(order);
  if (!m.user_set(7)) m.icntl(7) = given ? 1 : 7;
  // An inertia is only complete if the root front is not handed to ScaLAPACK.
  if (!m.user_set(13)) m.icntl(13) = m.tolerate_null_pivots;
  if (m.run(1) < 0)
    throw Error("analysis of the matrix pattern: " + explain(m.infog(1), m.infog(2)));
  m.estimated_mb = m.infog(16);
  const auto entries = m.infog(3);
  return {m.s.rinfog[0], entries < 0 ? -1e6 * entries : entries,
          static_cast<double>(m.infog(16)), static_cast<double>(m.infog(17))};
}

template <class Scalar>
PivotOrder Mumps<Scalar>::order() const {
  if (comm_rank(instance_->comm) != 0) return {};
  return {{instance_->s.sym_perm, instance_->s.sym_perm + instance_->s.n}, {}};
}

template <class Scalar>
void Mumps<Scalar>::factorise(const Pattern& pattern, std::vector<Scalar> values,
                              bool pivoting) {
  auto& m = *instance_;
  const double estimated = m.estimated_mb;
  const double limit = m.options.memory_limit_mb;
  const bool out_of_core = m.user_set(22) && m.icntl(22);
  if (limit > 0 && estimated > limit && !out_of_core)
    throw MemoryError(text("the factorisation needs %.0f MB on a rank and only %.0f MB "
                           "may be used: use more "
                           "ranks, fewer groups ({groups}), out-of-core factors "
                           "({mumps_icntl_22} 1), or "
                           "raise {memory_limit_mb}",
                           estimated, limit));

  m.hand_over(pattern);
  m.values = std::move(values);
  m.s.a_loc = reinterpret_cast<typename Instance::Value*>(m.values.data());
  if (!m.user_set(24)) m.icntl(24) = m.tolerate_null_pivots;
  if (!m.options.cntl.count(1)) m.s.cntl[0] = pivoting ? m.pivot_threshold : 0;
  for (;;) {
    const int status = m.run(2);
    if (status >= 0) break;
    if (status == -8 || status == -9 || status == -11 || status == -12 || status == -14 ||
        status == -15 || status == -20) {
      const int limit_percent = m.options.workspace_limit, now_percent = m.icntl(14);
      if (now_percent < limit_percent) {
        m.icntl(14) =
            std::min(limit_percent, std::max(2 * now_percent, now_percent + 20));
        continue;
      }
      throw MemoryError(text("MUMPS still asked for more workspace with ICNTL(14) = %d "
                             "%% (INFOG(1:2) = %d, %d; "
                             "estimate %.0f MB on a rank): raise "
                             "{mumps_workspace_limit} or use more ranks",
                             m.icntl(14), status, m.infog(2), estimated));
    }
    if (status == -10) throw ShiftError(explain(status, m.infog(2)));
    if (status == -5 || status == -7 || status == -13 || status == -19)
      throw MemoryError(
          text("%s; the estimate was %.0f MB on a rank, the limit is %.0f MB",
               explain(status, m.infog(2)).c_str(), estimated, limit));
    throw Error(explain(status, m.infog(2)));
  }
  std::vector<Scalar>().swap(m.values); // `= {}` would keep its memory
  m.s.irn_loc = m.s.jcn_loc = nullptr;
  m.s.a_loc = nullptr;
}

template <class Scalar>
int Mumps<Scalar>::negative_pivots() const {
  return instance_->infog(12);
}
template <class Scalar>
int Mumps<Scalar>::null_pivots() const {
  return instance_->infog(28);
}
template <class Scalar>
void Mumps<Scalar>::tolerate_null_pivots(bool tolerate) {
  instance_->tolerate_null_pivots = tolerate;
}

/// MUMPS leaves the solution where its fronts live; each row goes to the rank that owns
/// it.
template <class Scalar>
void Mumps<Scalar>::Instance::redistribute(const std::vector<int>& solution_rows,
                                           const std::vector<Scalar>& solution,
                                           RowRange rows, std::span<Scalar> x,
                                           int columns) {
  const int held = static_cast<int>(solution_rows.size()), ld = std::max(held, 1);
  const auto place = [&](PetscInt row, const Scalar* source, int stride) {
    for (int j = 0; j < columns; ++j)
      x[as_size(row - rows.begin + j * rows.size())] =
          source[static_cast<std::ptrdiff_t>(j) * stride];
  };
  const int size = comm_size(comm);
  if (size == 1) {
    for (int i = 0; i < held; ++i)
      place(solution_rows[as_size(i)] - 1, solution.data() + i, ld);
    return;
  }
  const auto starts = row_starts(comm, rows);
  std::vector<std::vector<int>> indices(as_size(size));
  std::vector<std::vector<Scalar>> packed(as_size(size));
  for (int i = 0; i < held; ++i) {
    const int row = solution_rows[as_size(i)] - 1;
    const auto to = as_size(owner_of(starts, row));
    indices[to].push_back(row);
    for (int j = 0; j < columns; ++j)
      packed[to].push_back(solution[as_size(i) + as_size(j) * as_size(ld)]);
  }
  std::vector<int> send(as_size(size)), receive(send);
  for (std::size_t r = 0; r < send.size(); ++r)
    send[r] = static_cast<int>(indices[r].size());
  MPI_Alltoall(send.data(), 1, MPI_INT, receive.data(), 1, MPI_INT, comm);
  std::vector<std::vector<int>> in_indices(send.size());
  std::vector<std::vector<Scalar>> in_values(send.size());
  std::vector<MPI_Request> requests;
  MPI_Datatype block;
  MPI_Type_contiguous(static_cast<int>(sizeof(Scalar)) * columns, MPI_BYTE, &block);
  MPI_Type_commit(&block);
  for (int r = 0; r < size; ++r) {
    const auto k = as_size(r);
    if (receive[k] > 0) {
      in_indices[k].resize(as_size(receive[k]));
      in_values[k].resize(as_size(receive[k]) * as_size(columns));
      requests.resize(requests.size() + 2);
      MPI_Irecv(in_indices[k].data(), receive[k], MPI_INT, r, 1, comm,
                &requests[requests.size() - 2]);
      MPI_Irecv(in_values[k].data(), receive[k], block, r, 2, comm, &requests.back());
    }
    if (send[k] > 0) {
      requests.resize(requests.size() + 2);
      MPI_Isend(indices[k].data(), send[k], MPI_INT, r, 1, comm,
                &requests[requests.size() - 2]);
      MPI_Isend(packed[k].data(), send[k], block, r, 2, comm, &requests.back());
    }
  }
  MPI_Waitall(static_cast<int>(requests.size()), requests.data(), MPI_STATUSES_IGNORE);
  MPI_Type_free(&block);
  for (std::size_t r = 0; r < in_indices.size(); ++r)
    for (std::size_t i = 0; i < in_indices[r].size(); ++i)
      place(in_indices[r][i], in_values[r].data() + i * as_size(columns), 1);
}

template <class Scalar>
void Mumps<Scalar>::Instance::solve_distributed(RowRange rows, std::span<Scalar> x,
                                                int columns) {
  const int held = s.info[22]; // INFO(23): rows of the solution that live here
  const int ld = std::max(held, 1);
  std::vector<Scalar> values_held(as_size(ld) * as_size(columns));
  std::vector<int> rows_held(as_size(ld));
  icntl(21) = 1;
  s.nrhs = columns;
  s.lsol_loc = ld;
  s.sol_loc = reinterpret_cast<Value*>(values_held.data());
  s.isol_loc = rows_held.data();
  if (run(3) < 0) throw Error("solve: " + explain(infog(1), infog(2)));
  rows_held.resize(as_size(held));
  redistribute(rows_held, values_held, rows, x, columns);
}

template <class Scalar>
void Mumps<Scalar>::solve(RowRange rows, std::span<Scalar> x, int columns) {
  auto& m = *instance_;
  auto* const values = reinterpret_cast<typename Instance::Value*>(x.data());
  if (comm_size(m.comm) == 1) { // in place, without copies
    m.icntl(20) = m.icntl(21) = 0;
    m.s.nrhs = columns;
    m.s.lrhs = m.s.n;
    m.s.rhs = values;
    if (m.run(3) < 0) throw Error("solve: " + explain(m.infog(1), m.infog(2)));
    return;
  }
  std::vector<int> row_numbers(as_size(rows.size()));
  for (std::size_t i = 0; i < row_numbers.size(); ++i)
    row_numbers[i] = static_cast<int>(rows.begin + static_cast<PetscInt>(i)) + 1;
  m.icntl(20) = 10; // dense, distributed
  m.s.nloc_rhs = rows.size();
  m.s.lrhs_loc = std::max<int>(rows.size(), 1);
  m.s.irhs_loc = row_numbers.data();
  m.s.rhs_loc = values;
  m.solve_distributed(rows, x, columns);
}

template class Mumps<float>;
template class Mumps<double>;
template class Mumps<std::complex<float>>;
template class Mumps<std::complex<double>>;

} // namespace flexgram
