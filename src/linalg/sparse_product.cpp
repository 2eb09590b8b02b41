#include "linalg/sparse_product.hpp"

#include "base/event.hpp"
#include "base/index.hpp"
#include "linalg/lanes.hpp"

#include <petscsf.h>

#include <algorithm>
#include <cmath>
#include <new>
#include <optional>

namespace flexgram {
namespace {

constexpr int line = accurate_lanes; ///< columns that fill a cache line
constexpr int widest = 12;           ///< columns of a strip: two bodies' joints

/// CSR rows of one process's part of a matrix.
struct Rows {
  PetscInt count = 0;
  const PetscInt *start = nullptr, *column = nullptr;
  const PetscScalar* value = nullptr;
};

/// Two sums: an addition waits for the one before it.
template <class Sums>
[[gnu::always_inline]] inline void add_row(Sums& sum, int width, const Rows& rows,
                                           PetscInt i, const double* x) {
  const auto add = [&](Sums & to, PetscInt k) __attribute__((always_inline)) {
    Sums value, lanes;
    value.fill(rows.value[k]);
    lanes.load(x + width * static_cast<std::ptrdiff_t>(rows.column[k]));
    to.add_product(value, lanes);
  };
  Sums odd;
  PetscInt k = rows.start[i];
  for (; k + 1 < rows.start[i + 1]; k += 2) {
    add(sum, k);
    add(odd, k + 1);
  }
  if (k < rows.start[i + 1]) add(sum, k);
  sum += odd;
}

/// y ← A_here x + A_away halo, x and halo row by row with `width` columns side by side.
template <int width>
struct PlainProduct {
  template <int native>
  [[gnu::always_inline]] static void run(const Rows* here, const double* x,
                                         const Rows* away, const double* halo, double* y,
                                         PetscInt columns) {
    for (PetscInt i = 0; i < here->count; ++i) {
      Lanes<width, native> sum;
      add_row(sum, width, *here, i, x);
      if (away->count > 0) add_row(sum, width, *away, i, halo);
      double sums[as_size(width)];
      sum.store(sums);
      for (PetscInt c = 0; c < columns; ++c)
        y[c * static_cast<std::ptrdiff_t>(here->count) + i] = sums[c];
    }
  }
};

/// The same in columns of eight with twice the digits; adds x_i² Σ_j (a_ij x_j)² to
/// `spread`, and stores Σ_j (a_ij x_j)² of each row and what rounding y took off, unless
/// `row_squares` or `rest` is null.
struct AccurateProductOf8 {
  template <int native>
  [[gnu::always_inline]] static void
  run(const Rows* here, const double* x, const Rows* away, const double* halo, double* y,
      PetscInt columns, double* spread, double* row_squares, double* rest) {
    using Sum = AccurateSum<native>;
    using Numbers = typename Sum::Numbers;
    Numbers spreads;
    double sums[line];
    for (PetscInt i = 0; i < here->count; ++i) {
      Sum sum;
      const auto add = [&](const Rows& part, const double* from)
          __attribute__((always_inline)) {
        for (PetscInt k = part.start[i]; k < part.start[i + 1]; ++k) {
          Numbers value, lanes;
          value.fill(part.value[k]);
          lanes.load(from + line * static_cast<std::ptrdiff_t>(part.column[k]));
          sum.add(value, lanes);
        }
      };
      add(*here, x);
      if (away->count > 0) add(*away, halo);
      Numbers mine;
      mine.load(x + line * static_cast<std::ptrdiff_t>(i));
      spreads.add_product(mine * mine, sum.squares);
      const Numbers total = sum.hi + sum.lo, lost = (sum.hi - total) + sum.lo;
      const auto store = [&](const Numbers& lanes, double* to)
          __attribute__((always_inline)) {
        if (!to) return;
        lanes.store(sums);
        for (PetscInt c = 0; c < columns; ++c)
          to[c * static_cast<std::ptrdiff_t>(here->count) + i] = sums[c];
      };
      store(total, y);
      store(sum.squares, row_squares);
      store(lost, rest);
    }
    spreads.store(sums);
    for (PetscInt c = 0; c < columns; ++c) spread[c] += sums[c];
  }
};

/// Read access to the rows of a SEQAIJ matrix.
class RowsOf {
public:
  explicit RowsOf(Mat a) : a_(a) {
    PetscBool done = PETSC_FALSE;
    FG_CALL(MatGetRowIJ(a_, 0, PETSC_FALSE, PETSC_FALSE, &rows_.count, &rows_.start,
                        &rows_.column, &done));
    FG_CALL(MatSeqAIJGetArrayRead(a_, &rows_.value));
  }
  ~RowsOf() {
    PetscBool done = PETSC_FALSE;
    MatSeqAIJRestoreArrayRead(a_, &rows_.value);
    MatRestoreRowIJ(a_, 0, PETSC_FALSE, PETSC_FALSE, &rows_.count, &rows_.start,
                    &rows_.column, &done);
  }
  RowsOf(const RowsOf&) = delete;
  RowsOf& operator=(const RowsOf&) = delete;
  const Rows& operator*() const { return rows_; }

private:
  Mat a_;
  Rows rows_;
};

/// Room for rows of a strip's columns; those of eight each on a cache line of their own.
class Strip {
public:
  explicit Strip(PetscInt rows)
      : data_(static_cast<double*>(::operator new[](
            sizeof(double) * widest * as_size(rows) + 64, std::align_val_t(64)))) {}
  ~Strip() { ::operator delete[](data_, std::align_val_t(64)); }
  Strip(const Strip&) = delete;
  Strip& operator=(const Strip&) = delete;
  double* data() { return data_; }

private:
  double* data_;
};

/// The rows of x that other ranks hold and this rank's entries of a ask for. Made once
/// and kept with the matrix.
PetscSF halo_of(Mat a, PetscInt wanted, const PetscInt* global_row) {
  const char* const name = "flexgram_halo";
  PetscObject kept = nullptr;
  FG_CALL(PetscObjectQuery(reinterpret_cast<PetscObject>(a), name, &kept));
  if (kept) return reinterpret_cast<PetscSF>(kept);
  PetscSF halo = nullptr;
  PetscLayout columns = nullptr;
  FG_CALL(PetscSFCreate(PetscObjectComm(reinterpret_cast<PetscObject>(a)), &halo));
  FG_CALL(MatGetLayouts(a, nullptr, &columns));
  FG_CALL(PetscSFSetGraphLayout(halo, columns, wanted, nullptr, PETSC_COPY_VALUES,
                                global_row));
  FG_CALL(PetscObjectCompose(reinterpret_cast<PetscObject>(a), name,
                             reinterpret_cast<PetscObject>(halo)));
  FG_CALL(PetscObjectDereference(reinterpret_cast<PetscObject>(halo)));
  return halo;
}

/// A strip's columns as one datum of MPI.
MPI_Datatype row_of(int width) {
  static MPI_Datatype types[widest + 1] = {};
  if (!types[width]) {
    MPI_Type_contiguous(width, MPI_DOUBLE, &types[width]);
    MPI_Type_commit(&types[width]);
  }
  return types[width];
}

/// x row by row, `width` columns side by side, those that x does not have zero.
template <int width>
void pack(const double* x, PetscInt rows, PetscInt columns, double* strip) {
  for (PetscInt i = 0; i < rows; ++i)
    for (int c = 0; c < width; ++c)
      strip[static_cast<std::ptrdiff_t>(i) * width + c] =
          c < columns ? x[static_cast<std::ptrdiff_t>(c) * rows + i] : 0.0;
}

} // namespace

namespace {

/// The rows of an AIJ matrix on this rank, and of x those that other ranks hold.
struct LocalProduct {
  LocalProduct(Mat a, bool shared) {
    Mat mine = a, others = nullptr;
    const PetscInt* global_row = nullptr;
    if (shared) {
      FG_CALL(MatMPIAIJGetSeqAIJ(a, &mine, &others, &global_row));
      FG_CALL(MatGetSize(others, nullptr, &wanted));
      halo = halo_of(a, wanted, global_row);
    }
    here.emplace(mine);
    if (others) away.emplace(others);
  }
  const Rows& rest() const { return away ? **away : nothing; }
  /// Rows of x from other ranks, `width` numbers each.
  void fetch(int width, const double* x, double* from_others) const {
    if (!halo) return;
    const MPI_Datatype row = row_of(width);
    FG_CALL(PetscSFBcastBegin(halo, row, x, from_others, MPI_REPLACE));
    FG_CALL(PetscSFBcastEnd(halo, row, x, from_others, MPI_REPLACE));
  }

  PetscInt wanted = 0;
  PetscSF halo = nullptr;
  std::optional<RowsOf> here, away;
  Rows nothing;
};

bool is_type(Mat a, const char* type) {
  PetscBool is = PETSC_FALSE;
  FG_CALL(PetscObjectTypeCompare(reinterpret_cast<PetscObject>(a), type, &is));
  return is;
}

} // namespace

Block multiply(Mat a, const Block& x) {
  Block y(x.comm(), x.local_rows(), x.rows(), x.columns());
  if (x.columns() == 0) return y;
  static Event event("SparseProduct");
  const auto timed = event.timed();
  const bool shared = is_type(a, MATMPIAIJ);
  if (!shared && !is_type(a, MATSEQAIJ)) {
    FG_CALL(BVMatMult(x.bv(), a, y.bv()));
    return y;
  }
  const LocalProduct local(a, shared);
  const PetscInt rows = x.local_rows().size();
  Strip strip(rows), from_others(local.wanted);
  const Block::Access from(x);
  Block::Access to(y);
  for (PetscInt j = 0, columns = 0; j < x.columns(); j += columns) {
    const PetscInt left = x.columns() - j;
    const int width = left <= 4 ? 4 : left <= 8 || (left > 12 && left <= 16) ? 8 : 12;
    columns = std::min<PetscInt>(width, left);
    const auto pack_in = width == 12 ? pack<12> : width == 8 ? pack<8> : pack<4>;
    const auto run = [&](auto product) {
      run_on_processor<decltype(product)>(
          &**local.here, static_cast<const double*>(strip.data()), &local.rest(),
          static_cast<const double*>(from_others.data()), to.column(j), columns);
    };
    pack_in(from.column(j), rows, columns, strip.data());
    local.fetch(width, strip.data(), from_others.data());
    if (width == 12)
      run(PlainProduct<12>());
    else if (width == 8)
      run(PlainProduct<8>());
    else
      run(PlainProduct<4>());
  }
  return y;
}

AccurateProduct multiply_accurately(Mat a, const Block& x, AccurateParts with) {
  static Event event("AccurateProduct");
  const auto timed = event.timed();
  const bool shared = is_type(a, MATMPIAIJ);
  if (!shared && !is_type(a, MATSEQAIJ)) throw Error("an accurate product needs AIJ");
  AccurateProduct result{Block(x.comm(), x.local_rows(), x.rows(), x.columns()),
                         std::vector<double>(as_size(x.columns()), 0.0), Block(),
                         Block()};
  const auto like_x = [&] {
    return Block(x.comm(), x.local_rows(), x.rows(), x.columns());
  };
  if (with.row_spread) result.row_spread = like_x();
  if (with.rest) result.rest = like_x();
  const LocalProduct local(a, shared);
  const PetscInt rows = x.local_rows().size();
  Strip strip(rows), from_others(local.wanted);
  {
    const Block::Access from(x);
    Block::Access to(result.product);
    std::optional<Block::Access> of_rows, rest;
    if (with.row_spread) of_rows.emplace(result.row_spread);
    if (with.rest) rest.emplace(result.rest);
    for (PetscInt j = 0; j < x.columns(); j += line) {
      const PetscInt columns = std::min<PetscInt>(line, x.columns() - j);
      pack<line>(from.column(j), rows, columns, strip.data());
      local.fetch(line, strip.data(), from_others.data());
      run_on_processor<AccurateProductOf8>(
          &**local.here, strip.data(), &local.rest(), from_others.data(), to.column(j),
          columns, result.spread.data() + j, of_rows ? of_rows->column(j) : nullptr,
          rest ? rest->column(j) : nullptr);
    }
    if (of_rows)
      for (double& s : of_rows->all()) s = std::sqrt(s);
  }
  MPI_Allreduce(MPI_IN_PLACE, result.spread.data(),
                static_cast<int>(result.spread.size()), MPI_DOUBLE, MPI_SUM, x.comm());
  for (double& s : result.spread) s = std::sqrt(s);
  return result;
}

std::vector<double> absolute_product(Mat a, const std::vector<double>& x) {
  const bool shared = is_type(a, MATMPIAIJ);
  if (!shared && !is_type(a, MATSEQAIJ)) throw Error("an absolute product needs AIJ");
  const LocalProduct local(a, shared);
  const auto rows = static_cast<PetscInt>(x.size());
  Strip strip(rows), from_others(local.wanted);
  pack<4>(x.data(), rows, 1, strip.data());
  local.fetch(4, strip.data(), from_others.data());
  std::vector<double> result;
  for (PetscInt i = 0; i < rows; ++i) {
    double sum = 0;
    const auto add = [&](const Rows& part, const double* from) {
      for (PetscInt k = part.start[i]; k < part.start[i + 1]; ++k)
        sum += std::abs(part.value[k]) *
               from[4 * static_cast<std::ptrdiff_t>(part.column[k])];
    };
    add(**local.here, strip.data());
    if (local.away) add(local.rest(), from_others.data());
    result.push_back(sum);
  }
  return result;
}

PetscInt longest_row(Mat a) {
  const LocalProduct local(a, is_type(a, MATMPIAIJ));
  const Rows &here = **local.here, &away = local.rest();
  PetscInt longest = 0;
  for (PetscInt i = 0; i < here.count; ++i)
    longest = std::max(longest, here.start[i + 1] - here.start[i] +
                                    (local.away ? away.start[i + 1] - away.start[i] : 0));
  return static_cast<PetscInt>(max_over(PetscObjectComm(reinterpret_cast<PetscObject>(a)),
                                        static_cast<double>(longest)));
}

} // namespace flexgram
