#include "linalg/basis.hpp"

#include "linalg/sparse_product.hpp"

namespace flexgram {

void Basis::append(Block x) {
  if (!x || x.columns() == 0) return;
  columns_ += x.columns();
  pieces_.push_back(std::move(x));
}

Basis Basis::share() const {
  Basis other;
  for (const Block& piece : pieces_) other.append(piece.share());
  return other;
}

Dense inner(const Basis& x, const Block& y) {
  Dense result(static_cast<int>(x.columns()), static_cast<int>(y.columns()));
  x.for_each([&](const Block& piece, int first) {
    set_part(result, first, 0, inner(piece, y));
  });
  return result;
}

Dense inner(const Basis& x, const Basis& y) {
  Dense result(static_cast<int>(x.columns()), static_cast<int>(y.columns()));
  y.for_each([&](const Block& piece, int first) {
    set_part(result, 0, first, inner(x, piece));
  });
  return result;
}

namespace {

/// The products of the pieces of x up to column `first` with y, and their mirror image.
void set_symmetric(Dense& result, const Basis& x, const Block& y, int first) {
  x.for_each([&](const Block& piece, int row) {
    if (row > first) return;
    Dense part = inner(piece, y);
    if (row == first) symmetrise(part);
    set_part(result, row, first, part);
    set_part(result, first, row, transpose(part));
  });
}

} // namespace

Dense symmetric_inner(const Basis& x, const Basis& y) {
  Dense result(static_cast<int>(x.columns()), static_cast<int>(y.columns()));
  y.for_each(
      [&](const Block& piece, int first) { set_symmetric(result, x, piece, first); });
  return result;
}

Dense symmetric_inner(const Basis& x, Mat a) {
  Dense result(static_cast<int>(x.columns()), static_cast<int>(x.columns()));
  x.for_each([&](const Block& piece, int first) {
    set_symmetric(result, x, multiply(a, piece), first);
  });
  return result;
}

void add_product(Block& y, double scale, const Basis& x, const Dense& q) {
  x.for_each([&](const Block& piece, int first) {
    add_product(y, scale, piece,
                part_of(q, first, static_cast<int>(piece.columns()), 0, q.columns));
  });
}

Block combine(const Basis& x, const Dense& q) {
  const Block& layout = x.pieces().front();
  Block y(layout.comm(), layout.local_rows(), layout.rows(), q.columns);
  add_product(y, 1.0, x, q);
  return y;
}

} // namespace flexgram
