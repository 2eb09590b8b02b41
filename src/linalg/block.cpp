#include "linalg/block.hpp"

#include "base/index.hpp"
#include "base/text.hpp"
#include "linalg/decompositions.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>

namespace flexgram {

Block::Block(MPI_Comm comm, RowRange rows, PetscInt n, PetscInt columns)
    : n_(n), columns_(columns), local_(rows) {
  if (static_cast<double>(rows.size()) * static_cast<double>(columns) >
      static_cast<double>(PETSC_MAX_INT))
    throw Error(
        text("%lld rows × %lld columns are too many numbers for one rank: use more "
             "ranks or fewer samples",
             static_cast<long long>(rows.size()), static_cast<long long>(columns)));
  FG_CALL(BVCreate(comm, bv_.out()));
  FG_CALL(BVSetType(bv_, BVMAT));
  FG_CALL(BVSetSizes(bv_, rows.size(), n, std::max<PetscInt>(columns, 1)));
#if SLEPC_VERSION_GE(3, 22, 0)
  FG_CALL(BVSetLeadingDimension(
      bv_, std::max<PetscInt>(rows.size(), 1))); // else columns may be padded
#endif
  if (columns == 0) FG_CALL(BVSetActiveColumns(bv_, 0, 0));
}

Block Block::share() const {
  Block other;
  other.bv_ = bv_.share();
  other.n_ = n_;
  other.columns_ = columns_;
  other.local_ = local_;
  return other;
}

Block::Access::Access(const Block& block)
    : bv_(block.bv()), ld_(block.local_rows().size()), columns_(block.columns()) {
  FG_CALL(BVGetArray(bv_, &data_));
}

Block::Access::~Access() { BVRestoreArray(bv_, &data_); }

void share_from_first(MPI_Comm comm, std::vector<double>& values) {
  MPI_Bcast(values.data(), static_cast<int>(values.size()), MPI_DOUBLE, 0, comm);
}

void share_list(MPI_Comm comm, std::vector<double>& values) {
  auto count = static_cast<std::int64_t>(values.size());
  MPI_Bcast(&count, 1, MPI_INT64_T, 0, comm);
  values.resize(as_size(count));
  share_from_first(comm, values);
}

namespace {

Matrix wrap(const Dense& q) {
  Matrix matrix;
  FG_CALL(MatCreateSeqDense(PETSC_COMM_SELF, q.rows, q.columns,
                            const_cast<double*>(q.data.data()), matrix.out()));
  return matrix;
}

} // namespace

Block combine(const Block& x, const Dense& q) {
  Block y(x.comm(), x.local_rows(), x.rows(), q.columns);
  if (q.columns > 0) FG_CALL(BVMult(y.bv(), 1.0, 0.0, x.bv(), wrap(q)));
  return y;
}

Dense inner(const Block& x, const Block& y) {
  Dense result(static_cast<int>(x.columns()), static_cast<int>(y.columns()));
  if (result.data.empty()) return result;
  // BVDot(Y, X) is XᴴY.
  FG_CALL(BVDot(y.bv(), x.bv(), wrap(result)));
  return result;
}

void add_product(Block& y, double scale, const Block& x, const Dense& q) {
  if (!q.data.empty()) FG_CALL(BVMult(y.bv(), scale, 1.0, x.bv(), wrap(q)));
}

Block concatenate(const Block& x, const Block& y) {
  if (!x || x.columns() == 0) return y.share();
  if (!y || y.columns() == 0) return x.share();
  Block both(x.comm(), x.local_rows(), x.rows(), x.columns() + y.columns());
  const Block::Access left(x), right(y);
  Block::Access to(both);
  const PetscInt rows = x.local_rows().size();
  std::copy_n(left.column(0), rows * x.columns(), to.column(0));
  std::copy_n(right.column(0), rows * y.columns(), to.column(x.columns()));
  return both;
}

void scale_rows(Block& x, std::span<const double> weights) {
  Block::Access access(x);
  for (PetscInt j = 0; j < x.columns(); ++j)
    for (std::size_t i = 0; i < weights.size(); ++i) access.column(j)[i] *= weights[i];
}

void scale_columns(Block& x, std::span<const double> weights) {
  Block::Access access(x);
  for (PetscInt j = 0; j < x.columns(); ++j)
    for (PetscInt i = 0; i < x.local_rows().size(); ++i)
      access.column(j)[i] *= weights[as_size(j)];
}

Block random_block(const Block& layout, PetscInt columns, unsigned seed) {
  Block x(layout.comm(), layout.local_rows(), layout.rows(), columns);
  Block::Access access(x);
  for (PetscInt j = 0; j < columns; ++j)
    for (PetscInt i = 0; i < x.local_rows().size(); ++i) {
      // splitmix64 of (seed, row, column)
      auto z = static_cast<std::uint64_t>(layout.local_rows().begin + i) * 1000003u +
               static_cast<std::uint64_t>(j) + (static_cast<std::uint64_t>(seed) << 44);
      z += 0x9e3779b97f4a7c15u;
      z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9u;
      z = (z ^ (z >> 27)) * 0x94d049bb133111ebu;
      z ^= z >> 31;
      access.column(j)[i] = static_cast<double>(z >> 11) * 0x1p-52 - 1.0;
    }
  return x;
}

Block select_columns(const Block& x, const std::vector<int>& columns) {
  Block y(x.comm(), x.local_rows(), x.rows(), static_cast<PetscInt>(columns.size()));
  const Block::Access from(x);
  Block::Access to(y);
  for (std::size_t j = 0; j < columns.size(); ++j)
    std::copy_n(from.column(columns[j]), x.local_rows().size(),
                to.column(static_cast<PetscInt>(j)));
  return y;
}

Block copy(const Block& x) {
  Block y(x.comm(), x.local_rows(), x.rows(), x.columns());
  Block::Access from(x), to(y);
  std::copy(from.all().begin(), from.all().end(), to.all().begin());
  return y;
}

std::vector<double> column_maxima(const Block& x) {
  std::vector<double> local(as_size(x.columns())), all(local);
  const Block::Access access(x);
  for (PetscInt j = 0; j < x.columns(); ++j)
    for (PetscInt i = 0; i < x.local_rows().size(); ++i) {
      const double size = std::abs(access.column(j)[i]); // a NaN must not get lost
      local[as_size(j)] = std::isnan(size) ? std::numeric_limits<double>::infinity()
                                           : std::max(local[as_size(j)], size);
    }
  MPI_Allreduce(local.data(), all.data(), static_cast<int>(all.size()), MPI_DOUBLE,
                MPI_MAX, x.comm());
  return all;
}

Block move_block(MPI_Comm exchange, const Block& x, MPI_Comm comm_to, RowRange wanted) {
  Block::Access from(x);
  const std::vector<double> rows = exchange_rows<double>(
      exchange, x.local_rows(), from.all(), x.columns(), 0, wanted, x.columns());
  Block y(comm_to, wanted, x.rows(), x.columns());
  Block::Access to(y);
  std::copy(rows.begin(), rows.end(), to.all().begin());
  return y;
}

Dense tsqr(Block& z) {
  Dense r(static_cast<int>(z.columns()), static_cast<int>(z.columns()));
  FG_CALL(BVSetOrthogonalization(z.bv(), BV_ORTHOG_CGS, BV_ORTHOG_REFINE_IFNEEDED,
                                 PETSC_DEFAULT, BV_ORTHOG_BLOCK_TSQR));
  FG_CALL(BVOrthogonalize(z.bv(), wrap(r)));
  return r;
}

namespace {

int count_above(const std::vector<double>& values, double relative_floor) {
  return static_cast<int>(std::count_if(values.begin(), values.end(), [&](double s) {
    return s > relative_floor * values.front();
  }));
}

/// Z of one rank with fewer rows than columns: nothing to gain from a QR first.
BlockSvd wide_svd(const Block& z, double relative_floor) {
  Dense a(static_cast<int>(z.rows()), static_cast<int>(z.columns()));
  std::copy_n(Block::Access(z).all().begin(), a.data.size(), a.data.begin());
  LeftSvd svd = left_svd(a);
  const Dense kept = first_columns(svd.vectors, count_above(svd.values, relative_floor));
  Block left(z.comm(), z.local_rows(), z.rows(), kept.columns);
  Block::Access to(left);
  std::copy(kept.data.begin(), kept.data.end(), to.all().begin());
  return {std::move(svd.values), std::move(left)};
}

/// Householder QR is backward stable column by column, so small snapshots keep their
/// digits.
BlockSvd tall_svd(Block z, double relative_floor) {
  const Dense r = tsqr(z);
  LeftSvd svd = left_svd(r);
  share_from_first(z.comm(), svd.values);
  share_from_first(z.comm(), svd.vectors.data);
  const int kept = count_above(svd.values, relative_floor);
  return {std::move(svd.values), combine(z, first_columns(svd.vectors, kept))};
}

} // namespace

BlockSvd left_svd(Block z, double relative_floor) {
  const MPI_Comm comm = z.comm();
  const PetscInt mine = z.local_rows().size();
  PetscInt fewest = 0;
  MPI_Allreduce(&mine, &fewest, 1, MPIU_INT, MPI_MIN, comm);
  if (fewest >= z.columns()) return tall_svd(std::move(z), relative_floor);
  if (comm_size(comm) == 1) return wide_svd(z, relative_floor);

  const bool first = comm_rank(comm) == 0;
  const RowRange everything =
      first ? RowRange{0, z.rows()} : RowRange{z.rows(), z.rows()};
  std::vector<double> gathered =
      exchange_rows<double>(comm, z.local_rows(), Block::Access(z).all(), z.columns(), 0,
                            everything, z.columns());
  BlockSvd result;
  std::vector<double> left;
  int kept = 0, count = 0;
  agree(comm, [&] {
    if (!first) return;
    Block whole(PETSC_COMM_SELF, everything, z.rows(), z.columns());
    std::copy(gathered.begin(), gathered.end(), Block::Access(whole).all().begin());
    result = left_svd(std::move(whole), relative_floor);
    kept = static_cast<int>(result.left.columns());
    count = static_cast<int>(result.values.size());
    const Block::Access access(result.left);
    left.assign(access.column(0), access.column(kept));
  });
  MPI_Bcast(&kept, 1, MPI_INT, 0, comm);
  MPI_Bcast(&count, 1, MPI_INT, 0, comm);
  result.values.resize(as_size(count));
  share_from_first(comm, result.values);
  const std::vector<double> mine_again =
      exchange_rows<double>(comm, everything, left, kept, 0, z.local_rows(), kept);
  result.left = Block(comm, z.local_rows(), z.rows(), kept);
  std::copy(mine_again.begin(), mine_again.end(),
            Block::Access(result.left).all().begin());
  return result;
}

} // namespace flexgram
