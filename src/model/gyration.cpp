#include "model/gyration.hpp"

#include "base/text.hpp"
#include "linalg/decompositions.hpp"
#include "linalg/orthonormal.hpp"
#include "linalg/sparse.hpp"
#include "linalg/sparse_product.hpp"

#include <algorithm>
#include <cmath>

namespace flexgram {
namespace {

/// Σ iG over iω: all skew terms together. They have the same factor.
Matrix sum_of_skew_terms(const SecondOrderModel& body) {
  Matrix sum;
  for (const auto& [law, G] : body.terms) {
    if (!law.is_skew()) continue;
    if (sum)
      FG_CALL(MatAXPY(sum, 1.0, G, DIFFERENT_NONZERO_PATTERN));
    else
      FG_CALL(MatDuplicate(G, MAT_COPY_VALUES, sum.out()));
  }
  return sum;
}

enum class Pair {
  equal, ///< [A, 0; 0, A]
  turned ///< [0, −A; A, 0], symmetric for a skew A
};

/// A real symmetric matrix with the forms of A, or of iA, on u + iv of the vectors (u, v).
Matrix pair_of(Mat a, Pair kind) {
  const LocalRows rows = local_rows(a);
  const RowRange owned = owned_rows(a);
  PetscInt n = 0;
  FG_CALL(MatGetSize(a, &n, nullptr));
  LocalRows both;
  for (PetscInt i = 0; i < owned.size(); ++i)
    for (const PetscInt part : {0, 1}) { // dofs u, v beside each other
      for (auto k = as_size(rows.start[as_size(i)]);
           k < as_size(rows.start[as_size(i) + 1]); ++k) {
        const bool turned = kind == Pair::turned;
        both.column.push_back(2 * rows.column[k] + (turned ? 1 - part : part));
        both.value.push_back(turned && part == 0 ? -rows.value[k] : rows.value[k]);
      }
      both.start.push_back(static_cast<PetscInt>(both.column.size()));
    }
  return make_sparse(PetscObjectComm(reinterpret_cast<PetscObject>(a)),
                     {2 * owned.begin, 2 * owned.end}, 2 * n, both);
}

/// Nearly the largest γ with xᴴ(iG)x = γ xᴴ(M + κK)x: that on a Krylov space, so not above it.
double nearly_largest(const SecondOrderModel& body, Mat G, double kappa,
                      const SolverOptions& options) {
  constexpr int steps = 12, width = 2;
  ShiftedSolver solver(body.K, body.M, {}, body.node, options);
  solver.factorise({kappa, 1.0});
  const InnerProduct product{body.M, body.K, kappa};
  const auto next = [&](const Block& x) {
    return solver.solve(multiply(G, x), ShiftedSolver::Verify::none).x;
  };
  Basis V;
  Block newest = next(random_block(body.B, width, 7));
  for (int step = 0; step < steps; ++step) {
    Orthonormalised added = orthonormalise(std::move(newest), V, product, 1e-8);
    if (added.vectors.columns() == 0) break;
    V.append(added.vectors.share());
    newest = next(added.vectors);
  }
  if (!V) return 0;
  const Block all = combine(V, identity(static_cast<int>(V.columns())));
  const Dense g = inner(all, multiply(G, all));
  ComplexDense hermitian(g.rows, g.columns);
  for (int j = 0; j < g.columns; ++j)
    for (int i = 0; i < g.rows; ++i) hermitian(i, j) = {0, 0.5 * (g(i, j) - g(j, i))};
  std::vector<double> values = hermitian_eigenvalues(std::move(hermitian));
  share_from_first(body.comm, values);
  return values.empty() ? 0 : values.back();
}

} // namespace

Gyration gyration_of(const SecondOrderModel& body, double omega, double tau,
                     const SolverOptions& options) {
  if (is_symmetric(body.terms)) return {};
  constexpr double rounding =
      1e-8; // of the entries of G, beside M's smallest eigenvalues
  if (body.coriolis > 0) return {(1 + rounding) * body.coriolis, 0};

  const Matrix G = sum_of_skew_terms(body);
  PetscReal norm = 0;
  FG_CALL(MatNorm(G, NORM_INFINITY, &norm));
  if (norm == 0) return {};

  // Dofs without mass need some stiffness; the less, the closer the bound of the others.
  constexpr double little = 0.01; // of the bound
  Gyration best;
  double least = HUGE_VAL, seen = 0;
  for (const double part : {1e-3, 1e-5, 1e-7}) {
    const double kappa = part / std::max(omega * omega, 2 * tau),
                 most = nearly_largest(body, G, kappa, options);
    const Gyration here{most, most * kappa};
    seen = std::max(seen, most);
    if (here.needed_square(omega) < least) {
      best = here;
      least = here.needed_square(omega);
    }
    if (best.mass > 0 && omega * best.stiffness <= little) break;
  }
  const Matrix K = pair_of(body.K, Pair::equal), M = pair_of(body.M, Pair::equal),
               turned = pair_of(G, Pair::turned);
  ShiftedSolver solver(K, M, {turned}, {}, counting(options));
  solver.count_pivots(true);
  constexpr double first = 1.02, more = 1.1;
  double factor = first;
  for (int attempt = 0; attempt < 24; ++attempt, factor *= more) {
    const Gyration tried{factor * best.mass, factor * best.stiffness};
    if (best.mass == 0 || !std::isfinite(tried.needed_square(omega))) break;
    solver.factorise({tried.stiffness, tried.mass, {1.0}});
    if (solver.negative_pivots() == 0 && solver.null_pivots() == 0) return tried;
  }
  throw Error(
      text("gyroscopic forces up to %.3g rad/s of the inertia beside a band up to %.4g "
           "Hz: no bound of them was found by mass and stiffness. Do they act on dofs "
           "without both?",
           seen, omega / (2 * M_PI)));
}

} // namespace flexgram
