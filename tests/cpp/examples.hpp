#pragma once

#include "base/observer.hpp"
#include "linalg/sparse.hpp"
#include "linalg/sparse_product.hpp"
#include "model/second_order_model.hpp"

#include <gtest/gtest.h>

#include <functional>

/// Bodies whose answers are known in closed form, and small helpers.
namespace flexgram::examples {

inline MPI_Comm world() { return PETSC_COMM_WORLD; }

inline Observer& silent() {
  static Observer observer(world(), Observer::Level::silent);
  return observer;
}

/// n×n sparse matrix from a function of (row, column); zeros are left out.
inline Matrix sparse(PetscInt n, const std::function<double(PetscInt, PetscInt)>& entry,
                     PetscInt half_band) {
  const RowRange rows = even_rows(world(), n);
  LocalRows local;
  for (PetscInt i = rows.begin; i < rows.end; ++i) {
    for (PetscInt j = std::max<PetscInt>(0, i - half_band);
         j <= std::min<PetscInt>(n - 1, i + half_band); ++j)
      if (const double value = entry(i, j); value != 0) {
        local.column.push_back(j);
        local.value.push_back(value);
      }
    local.start.push_back(static_cast<PetscInt>(local.column.size()));
  }
  return make_sparse(world(), rows, n, local);
}

inline Block block(PetscInt n, PetscInt columns,
                   const std::function<double(PetscInt, PetscInt)>& entry) {
  Block b(world(), even_rows(world(), n), n, columns);
  Block::Access access(b);
  for (PetscInt j = 0; j < columns; ++j)
    for (PetscInt i = b.local_rows().begin; i < b.local_rows().end; ++i)
      access.column(j)[i - b.local_rows().begin] = entry(i, j);
  return b;
}

inline Block identity_block(PetscInt n) {
  return block(n, n, [](PetscInt i, PetscInt j) { return i == j ? 1.0 : 0.0; });
}

/// A sparse matrix whole on every rank, for small n.
inline Dense whole(Mat a) {
  PetscInt n = 0;
  FG_CALL(MatGetSize(a, &n, nullptr));
  const Block I = identity_block(n);
  return inner(I, multiply(a, I));
}

inline Dense whole(const Block& b) { return inner(identity_block(b.rows()), b); }

/// Fixed-free rod of n linear elements, E A = ρ A = L = 1, consistent mass. Discrete
/// eigenvalues: λ_k = 6/h² (1 − cos θ)/(2 + cos θ), θ = (2k − 1)π/(2n).
inline SecondOrderModel rod(PetscInt n, Damping damping = {}) {
  SecondOrderModel model;
  const double h = 1.0 / static_cast<double>(n);
  const auto last = [n](PetscInt i) { return i == n - 1; };
  model.name = "rod";
  model.comm = world();
  model.n = n;
  model.rows = even_rows(world(), n);
  model.K = sparse(
      n, [=](PetscInt i, PetscInt j) { return i == j ? (last(i) ? 1 : 2) / h : -1 / h; },
      1);
  model.M = sparse(
      n,
      [=](PetscInt i, PetscInt j) { return i == j ? (last(i) ? 2 : 4) * h / 6 : h / 6; },
      1);
  model.damping = damping;
  model.B = block(n, 2, [n](PetscInt i, PetscInt j) {
    return (j == 0 && i == n - 1) || (j == 1 && i == n / 2) ? 1.0 : 0.0;
  });
  model.C = model.B.share();
  model.inputs = model.outputs = {"tip.fx", "middle.fx"};
  return model;
}

inline double rod_eigenvalue(PetscInt n, PetscInt k) {
  const double theta =
      (2.0 * static_cast<double>(k) - 1) * M_PI / (2.0 * static_cast<double>(n));
  return 6.0 * static_cast<double>(n * n) * (1 - std::cos(theta)) / (2 + std::cos(theta));
}

} // namespace flexgram::examples
