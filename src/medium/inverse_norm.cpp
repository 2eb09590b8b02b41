#include "medium/inverse_norm.hpp"

#include "linalg/sparse_product.hpp"

#include <algorithm>
#include <cmath>

namespace flexgram {

namespace {

/// (−uᵀEu)^−½ uᵀg of the modes u below the cutoff, for each column g: the sum of their
/// squares is what gᵀE⁻¹g has less for them. @param along  uᵀg.
Dense by_root_of_energy(const ModalSpace& modal, const DenseResponse& response,
                        Dense along) {
  for (int j = 0; j < along.rows; ++j) {
    const double e = -response.energy(j, modal.cutoff * modal.cutoff);
    for (int i = 0; i < along.columns; ++i) along(j, i) /= std::sqrt(std::max(e, 1e-300));
  }
  return along;
}

double sum_of_squares(const Block& x) {
  const PetscInt rows = x.local_rows().size();
  double sum = 0;
  {
    const Block::Access access(x);
    for (PetscInt j = 0; j < x.columns(); ++j)
      for (PetscInt i = 0; i < rows; ++i)
        sum += access.column(j)[i] * access.column(j)[i];
  }
  MPI_Allreduce(MPI_IN_PLACE, &sum, 1, MPI_DOUBLE, MPI_SUM, x.comm());
  return sum;
}

} // namespace

InverseBounds inverse_bounds(const CertifyRun& run, const ModalSpace& modal,
                             const DenseResponse& response) {
  constexpr double t = 0.1;
  constexpr int vectors = 8;
  const MediumSpace& space = *modal.space;
  Block g = random_block(run.fom.B, vectors, 77);
  space.unscale(g);
  Block x = run.factors.solve(g);
  Dense energy = inner(g, x);
  const Dense U = first_columns(response.U(), modal.modes());
  const Dense along =
      by_root_of_energy(modal, response, multiply_transposed(U, inner(space.V(), g)));
  for (int i = 0; i < vectors; ++i)
    for (int j = 0; j < along.rows; ++j) energy(i, i) += along(j, i) * along(j, i);
  space.unscale(x);
  const Dense size = inner(x, x);
  double largest = 0, longest = 0;
  for (int i = 0; i < vectors; ++i) {
    largest = std::max(largest, energy(i, i));
    longest = std::max(longest, size(i, i));
  }
  // gᵀE⁻¹g is a third of the trace of E⁻¹ on average: what a random vector of norm 1 has
  // in E⁻¹ is the n-th part of the trace. Ten times that for safety.
  std::vector<double> shared{t / std::sqrt(longest),
                             std::sqrt(30 * largest / static_cast<double>(run.fom.n))};
  share_from_first(run.fom.comm, shared);
  return {shared[0], shared[1]};
}

void ResidualImages::extend(const CertifyRun& run, const ModalSpace& modal,
                            const Basis& T) {
  Basis before; // columns of T that have images
  T.for_each([&](const Block& piece, int first) {
    if (first >= X_.columns()) {
      Block added = copy(piece);
      modal.space->unscale(added);
      Block X = run.factors.solve(added, ShiftedSolver::Verify::first_column);
      add(run, modal, before, std::move(added), std::move(X));
    }
    before.append(piece.share());
  });
}

void ResidualImages::turn(const CertifyRun& run, const ModalSpace& modal, const Dense& Q,
                          const Basis& T) {
  if (!X_) return;
  Block X = combine(X_, Q), turned = combine(T, identity(Q.columns));
  modal.space->unscale(turned);
  *this = ResidualImages();
  add(run, modal, Basis(), std::move(turned), std::move(X));
}

void ResidualImages::add(const CertifyRun& run, const ModalSpace& modal,
                         const Basis& before, Block added, Block X) {
  const MediumSpace& space = *modal.space;
  const int k = static_cast<int>(X.columns()), first = static_cast<int>(X_.columns());
  const Dense one = identity(k);
  Dense corner = inner(added, X);
  Block rest = std::move(added); // F
  add_product(rest, -1.0, multiply(run.fom.K, X), one);
  add_product(rest, modal.cutoff * modal.cutoff, multiply(run.fom.M, X), one);
  add_to(corner, inner(X, rest));
  symmetrise(corner);
  Dense columns(first + k, k);
  set_part(columns, first, 0, corner);
  if (first > 0) {
    Block dual = copy(X);
    space.unscale(dual); // T is scaled
    Dense beside = inner(before, dual);
    add_to(beside, inner(X_, rest));
    set_part(columns, 0, 0, beside);
  }
  gram_ = bordered(gram_, columns);
  space.scale(rest);
  missed_ += sum_of_squares(rest);
  X_.append(std::move(X));
}

ResidualNorm ResidualImages::norm(const CertifyRun& run, const ModalSpace& modal,
                                  const DenseResponse& response,
                                  const InverseBounds& bounds, const Basis& T) const {
  ResidualNorm norm;
  norm.of_rounding = bounds.of_rounding;
  if (!X_) return norm;
  norm.gram = gram_;
  const double most =
      missed_ / bounds.least_eigenvalue; // of ± FᵀE⁻¹F, which has any sign
  for (int i = 0; i < norm.gram.rows; ++i) norm.gram(i, i) += most;
  norm.added = 2 * most;
  // What rounding left of the modes in residuals, and what T holds of them, where E⁻¹ is
  // negative, is taken out again.
  Block modes = combine(modal.space->V(), first_columns(response.U(), modal.modes()));
  modal.space->unscale(modes); // T is scaled
  const Dense along = by_root_of_energy(modal, response, inner(modes, T));
  add_to(norm.gram, multiply_transposed(along, along));
  share_from_first(run.fom.comm, norm.gram.data);
  return norm;
}

} // namespace flexgram
