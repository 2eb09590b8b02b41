#include "linalg/basis.hpp"

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

Dense symmetric_inner(const Basis& x, const Basis& y) {
  Dense result(static_cast<int>(x.columns()), static_cast<int>(y.columns()));
  y.for_each([&](const Block& right, int column) {
    x.for_each([&](const Block& left, int row) {
      if (row > column) return;
      Dense part = inner(left, right);
      if (row == column) symmetrise(part);
      set_part(result, row, column, part);
      set_part(result, column, row, transpose(part));
    });
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
