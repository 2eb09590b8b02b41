#include "medium/inverse_norm.hpp"

#include "linalg/sparse_product.hpp"

#include <algorithm>
#include <cmath>

namespace flexgram {

namespace {

/// (−uᵀEu)^−½ uᵀg of the modes u below the cutoff, for each column g: the sum of their
/// squares is what gᵀE⁻¹g has less for them.
Dense along_modes(const ModalSpace& modal, const DenseResponse& response,
                  const Block& g) {
  const Dense U = first_columns(response.U(), modal.modes());
  Dense along = multiply_transposed(U, inner(modal.space->V(), g));
  for (int j = 0; j < along.rows; ++j) {
    const double e = -response.energy(j, modal.cutoff * modal.cutoff);
    for (int i = 0; i < along.columns; ++i) along(j, i) /= std::sqrt(std::max(e, 1e-300));
  }
  return along;
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
  const Dense along = along_modes(modal, response, g);
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

NormAndImage inverse_norm(const CertifyRun& run, const ModalSpace& modal,
                          const DenseResponse& response, const InverseBounds& bounds,
                          const Block& T) {
  NormAndImage result;
  ResidualNorm& norm = result.norm;
  norm.of_rounding = bounds.of_rounding;
  if (T.columns() == 0) return result;
  result.image = run.factors.solve(T, ShiftedSolver::Verify::first_column);
  const Block& X = result.image;
  const Dense one = identity(static_cast<int>(T.columns()));
  Block rest = copy(T); // F
  add_product(rest, -1.0, multiply(run.fom.K, X), one);
  add_product(rest, modal.cutoff * modal.cutoff, multiply(run.fom.M, X), one);
  norm.gram = inner(T, X);
  add_to(norm.gram, inner(X, rest));
  symmetrise(norm.gram);
  modal.space->scale(rest);
  const Dense left = inner(rest, rest);
  double trace = 0;
  for (int i = 0; i < left.rows; ++i) trace += left(i, i);
  const double most = trace / bounds.least_eigenvalue; // of ± FᵀE⁻¹F, which has any sign
  for (int i = 0; i < left.rows; ++i) norm.gram(i, i) += most;
  norm.added = 2 * most;
  // What rounding left of the modes in T, where E⁻¹ is negative, is taken out again.
  const Dense along = along_modes(modal, response, T);
  add_to(norm.gram, multiply_transposed(along, along));
  share_from_first(run.fom.comm, norm.gram.data);
  return result;
}

} // namespace flexgram
