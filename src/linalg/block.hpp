#pragma once

#include "base/handle.hpp"
#include "base/index.hpp"
#include "base/parallel.hpp"
#include "linalg/decompositions.hpp"
#include "linalg/dense.hpp"

namespace flexgram {

/// A tall distributed block of real columns, n × k, rows split like the model's matrices,
/// stored column-major on each rank. A SLEPc BV underneath, so its TSQR and products
/// serve.
class Block {
public:
  Block() = default;
  Block(MPI_Comm comm, RowRange rows, PetscInt n, PetscInt columns);

  MPI_Comm comm() const {
    return PetscObjectComm(reinterpret_cast<PetscObject>(bv_.get()));
  }
  PetscInt rows() const { return n_; }
  PetscInt columns() const { return columns_; }
  RowRange local_rows() const { return local_; }
  BV bv() const { return bv_; }
  explicit operator bool() const { return static_cast<bool>(bv_); }
  Block share() const;

  /// Access to this rank's rows, column-major with leading dimension local_rows().size().
  class Access {
  public:
    explicit Access(const Block& block);
    ~Access();
    Access(const Access&) = delete;
    Access& operator=(const Access&) = delete;
    double* column(PetscInt j) { return data_ + static_cast<std::ptrdiff_t>(j) * ld_; }
    const double* column(PetscInt j) const {
      return data_ + static_cast<std::ptrdiff_t>(j) * ld_;
    }
    std::span<double> all() { return {data_, as_size(ld_) * as_size(columns_)}; }

  private:
    BV bv_;
    PetscScalar* data_ = nullptr;
    PetscInt ld_, columns_;
  };

private:
  Handle<BV> bv_;
  PetscInt n_ = 0, columns_ = 0;
  RowRange local_;
};

/// Rank 0's numbers for all ranks: dense work done on every rank may differ in the last
/// bit, and with it the vectors of equal singular values.
void share_from_first(MPI_Comm comm, std::vector<double>& values);
/// The same where the length may differ between ranks too.
void share_list(MPI_Comm comm, std::vector<double>& values);

Block combine(const Block& x, const Dense& q); ///< X Q
Dense inner(const Block& x, const Block& y);   ///< XᵀY, on every rank
/// Y ← Y + scale X Q
void add_product(Block& y, double scale, const Block& x, const Dense& q);
Block concatenate(const Block& x, const Block& y); ///< [X Y]; either may be empty
/// Row i of X times weights[i], this rank's rows.
void scale_rows(Block& x, std::span<const double> weights);
void scale_columns(Block& x, std::span<const double> weights);
/// Entries in (−1, 1) that depend on row, column and seed only, not on the ranks.
Block random_block(const Block& layout, PetscInt columns, unsigned seed);
/// The given columns of x, in that order.
Block select_columns(const Block& x, const std::vector<int>& columns);
Block copy(const Block& x);
/// Largest absolute value of each column, on every rank.
std::vector<double> column_maxima(const Block& x);

/// Rows of a block in another layout: on comm_to, with rows `wanted` here. Collective on
/// the wider communicator `exchange`, where each rank offers what it holds of x.
Block move_block(MPI_Comm exchange, const Block& x, MPI_Comm comm_to, RowRange wanted);

/// Z = Q R with orthonormal Q (SLEPc BV's TSQR); Q overwrites Z. Every rank needs at
/// least as many rows as Z has columns.
Dense tsqr(Block& z);

/// Thin singular value decomposition of a distributed block without forming ZᵀZ.
/// @return values, descending, min(n, k) of them; left: the vectors of the first `count`
/// values that exceed `relative_floor` times the first.
/// @note By TSQR where each rank has as many rows as Z has columns; smaller bodies are
/// gathered on one rank. Z is overwritten.
struct BlockSvd {
  std::vector<double> values;
  Block left;
};
BlockSvd left_svd(Block z, double relative_floor);

} // namespace flexgram
