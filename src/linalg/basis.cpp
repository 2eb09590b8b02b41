#include "linalg/basis.hpp"

#include "linalg/sparse_product.hpp"

#include <petscblaslapack.h>

#include <algorithm>
#include <memory>

namespace flexgram {
namespace {

/// Columns of one piece in this rank's rows, and the place of the first in the basis.
struct Columns {
  double* data;
  int count, first;
};

/// The pieces of a basis, open for reading.
class Pieces {
public:
  explicit Pieces(const Basis& x) {
    access_.reserve(x.pieces().size());
    x.for_each([&](const Block& piece, int first) {
      access_.push_back(std::make_unique<Block::Access>(piece));
      columns_.push_back(
          {access_.back()->column(0), static_cast<int>(piece.columns()), first});
    });
  }
  auto begin() const { return columns_.begin(); }
  auto end() const { return columns_.end(); }

private:
  std::vector<std::unique_ptr<Block::Access>> access_;
  std::vector<Columns> columns_;
};

/// Calls work(first row, number of rows) for strips of rows.
template <class Work>
void by_rows(PetscInt rows, Work&& work) {
  for (PetscInt first = 0; first < rows; first += rows_at_a_time)
    work(first, static_cast<int>(std::min(rows_at_a_time, rows - first)));
}

/// C ← C + scale op(A) B.
void add_gemm(const char* op, int m, int n, int k, double scale, const double* a, int lda,
              const double* b, int ldb, double* c, int ldc) {
  const double one = 1;
  BLASgemm_(op, "N", &m, &n, &k, &scale, a, &lda, b, &ldb, &one, c, &ldc);
}

/// This rank's part of the products of pieces of x up to column `last` with y, into columns of
/// the result. The strips are added with twice the digits.
void add_inner(Dense& result, const Pieces& x, const Columns& y, int last,
               PetscInt local_rows) {
  const int ld = static_cast<int>(local_rows);
  Dense strip(result.rows, y.count), lost(result.rows, y.count);
  double* const sum = result.column(y.first);
  by_rows(local_rows, [&](PetscInt row, int rows) {
    std::fill(strip.data.begin(), strip.data.end(), 0.0);
    for (const Columns& piece : x)
      for (int first = 0; piece.first <= last && first < rows; first += rows_in_a_sum)
        add_gemm("T", piece.count, y.count, std::min(rows_in_a_sum, rows - first), 1.0,
                 piece.data + row + first, ld, y.data + row + first, ld,
                 &strip(piece.first, 0), strip.rows);
    for (std::size_t k = 0; k < strip.data.size(); ++k) { // Knuth
      const double a = sum[k], b = strip.data[k], both = a + b, of_b = both - a;
      lost.data[k] += (a - (both - of_b)) + (b - of_b);
      sum[k] = both;
    }
  });
  for (std::size_t k = 0; k < lost.data.size(); ++k) sum[k] += lost.data[k];
}

Dense summed(MPI_Comm comm, Dense local) {
  MPI_Allreduce(MPI_IN_PLACE, local.data.data(), static_cast<int>(local.data.size()),
                MPI_DOUBLE, MPI_SUM, comm);
  return local;
}

/// The upper triangle onto the lower.
void mirror(Dense& a) {
  for (int j = 0; j < a.columns; ++j)
    for (int i = 0; i < j; ++i) a(j, i) = a(i, j);
}

MPI_Comm comm_of(const Basis& x) { return x.pieces().front().comm(); }
PetscInt local_rows_of(const Basis& x) { return x.pieces().front().local_rows().size(); }

} // namespace

void Basis::append(Block x) {
  if (!x || x.columns() == 0) return;
  columns_ += x.columns();
  pieces_.push_back(std::move(x));
}

void Basis::join_last(int wide) {
  std::size_t first = pieces_.size();
  PetscInt together = 0;
  while (first > 0 && pieces_[first - 1].columns() < wide)
    together += pieces_[--first].columns();
  if (together < wide || first + 1 >= pieces_.size()) return;
  const Block& layout = pieces_[first];
  Block joined(layout.comm(), layout.local_rows(), layout.rows(), together);
  {
    Block::Access to(joined);
    double* next = to.column(0);
    for (std::size_t i = first; i < pieces_.size(); ++i) {
      Block::Access from(pieces_[i]);
      next = std::copy(from.all().begin(), from.all().end(), next);
    }
  }
  pieces_.resize(first);
  pieces_.push_back(std::move(joined));
}

Basis Basis::share() const {
  Basis other;
  for (const Block& piece : pieces_) other.append(piece.share());
  return other;
}

Dense inner(const Basis& x, const Basis& y) {
  Dense result(static_cast<int>(x.columns()), static_cast<int>(y.columns()));
  if (result.data.empty()) return result;
  const Pieces left(x), right(y);
  for (const Columns& columns : right)
    add_inner(result, left, columns, result.rows, local_rows_of(x));
  return summed(comm_of(x), std::move(result));
}

Dense symmetric_inner(const Basis& x, const Basis& y) {
  Dense result(static_cast<int>(x.columns()), static_cast<int>(y.columns()));
  if (result.data.empty()) return result;
  const Pieces left(x), right(y);
  for (const Columns& columns : right)
    add_inner(result, left, columns, columns.first, local_rows_of(x));
  mirror(result);
  return summed(comm_of(x), std::move(result));
}

Dense symmetric_inner(const Basis& x, Mat a) {
  Dense result(static_cast<int>(x.columns()), static_cast<int>(x.columns()));
  if (result.data.empty()) return result;
  const Pieces left(x);
  x.for_each([&](const Block& piece, int first) {
    const Block image = multiply(a, piece);
    Block::Access access(image);
    add_inner(result, left, {access.column(0), static_cast<int>(image.columns()), first},
              first, local_rows_of(x));
  });
  mirror(result);
  return summed(comm_of(x), std::move(result));
}

void add_product(Block& y, double scale, const Basis& x, const Dense& q) {
  if (q.data.empty()) return;
  const Pieces pieces(x);
  Block::Access to(y);
  const int ld = static_cast<int>(y.local_rows().size());
  by_rows(ld, [&](PetscInt row, int rows) {
    for (const Columns& piece : pieces)
      add_gemm("N", rows, q.columns, piece.count, scale, piece.data + row, ld,
               q.data.data() + piece.first, q.rows, to.column(0) + row, ld);
  });
}

Block combine(const Basis& x, const Dense& q) {
  const Block& layout = x.pieces().front();
  Block y(layout.comm(), layout.local_rows(), layout.rows(), q.columns);
  add_product(y, 1.0, x, q);
  return y;
}

} // namespace flexgram
