#pragma once

#include "linalg/block.hpp"

namespace flexgram {

/// A tall distributed basis that grows by whole blocks. It is kept in these pieces:
/// nothing is copied when it grows.
class Basis {
public:
  Basis() = default;
  /// @note Shares x.
  Basis(const Block& x) { append(x.share()); } // NOLINT: a block is a basis of one piece

  void append(Block x);
  /// Makes one piece of the last ones that are narrower than `wide`, if they are that wide together:
  /// products with few wide pieces are faster.
  void join_last(int wide);
  Basis share() const;
  PetscInt columns() const { return columns_; }
  explicit operator bool() const { return columns_ > 0; }
  const std::vector<Block>& pieces() const { return pieces_; }
  /// The only piece. @pre there is one.
  Block block() && { return std::move(pieces_.front()); }

  /// Calls visit(piece, number of its first column) for each piece.
  template <class Visit>
  void for_each(Visit&& visit) {
    PetscInt first = 0;
    for (Block& piece : pieces_) {
      visit(piece, static_cast<int>(first));
      first += piece.columns();
    }
  }
  template <class Visit>
  void for_each(Visit&& visit) const {
    PetscInt first = 0;
    for (const Block& piece : pieces_) {
      visit(piece, static_cast<int>(first));
      first += piece.columns();
    }
  }

private:
  std::vector<Block> pieces_;
  PetscInt columns_ = 0;
};

Block combine(const Basis& x, const Dense& q); ///< X Q
/// Rows taken at a time: those of a block that meets all pieces stay in the cache. Sums over
/// more rows are sums of these with twice the digits; sums over these are sums of sums over
/// fewer rows, whatever BLAS does within them.
inline constexpr PetscInt rows_at_a_time = 1024;
inline constexpr int rows_in_a_sum = 128;
Dense inner(const Basis& x, const Basis& y); ///< XᵀY, on every rank
/// XᵀY where it is symmetric, on every rank: half of the products, and exactly symmetric.
Dense symmetric_inner(const Basis& x, const Basis& y);
Dense symmetric_inner(const Basis& x, Mat a); ///< XᵀAX for a symmetric A
/// Y ← Y + scale X Q
void add_product(Block& y, double scale, const Basis& x, const Dense& q);

} // namespace flexgram
