#pragma once

#include "linalg/block.hpp"
#include "model/second_order_model.hpp"

#include <array>
#include <vector>

namespace flexgram {

/// M = Σ_c E_cᵀ M_s E_c + R: what is the same in three directions, and the rest. E_c takes the
/// displacement (or the rotation) in direction c of each node. M of solid elements is all M_s but
/// near interfaces and constraints, a third of the entries: products with it cost a third.
class MassByDirections {
public:
  /// @pre has_coordinates(model). Collective.
  explicit MassByDirections(const SecondOrderModel& model);

  bool has_same() const { return static_cast<bool>(same_); }
  bool has_rest() const { return static_cast<bool>(rest_); }
  Mat same() const { return same_; } ///< M_s
  /// R among the rows where it has entries.
  Mat rest() const { return rest_; }
  /// E_c v, as M_s takes it.
  Block direction(const Block& v, int c) const {
    return taken(v, rows_[as_size(c)], triples_);
  }
  /// The rows of v that R has.
  Block rest_of(const Block& v) const { return taken(v, rest_rows_, rest_range_); }

private:
  Block taken(const Block& v, const std::vector<PetscInt>& rows, RowRange range) const;

  Matrix same_, rest_;
  std::array<std::vector<PetscInt>, 3> rows_; ///< of each direction, on this rank from 0
  std::vector<PetscInt> rest_rows_;
  RowRange triples_, rest_range_;
};

} // namespace flexgram
