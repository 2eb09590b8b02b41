#include "model/softening.hpp"

#include "base/text.hpp"
#include "linalg/decompositions.hpp"
#include "linalg/orthonormal.hpp"
#include "linalg/sparse.hpp"
#include "linalg/sparse_product.hpp"

#include <algorithm>
#include <cmath>
#include <optional>

namespace flexgram {
namespace {

/// Σ of the skew terms over iω, or of those that are neither skew nor positive semidefinite, with
/// parameters at `end`, "least" or "most"; null if there are none. Their factors vary together.
Matrix sum_of(const SecondOrderModel& body, Symmetry symmetry, const char* end) {
  Matrix sum;
  for (const auto& [own, matrix] : body.terms) {
    if (own.is_skew() != (symmetry == Symmetry::skew) || own.is_semidefinite()) continue;
    const Law law = own.varies() ? own.with("value", own.number(end)) : own;
    const double factor = law.is_skew() ? law.as_damper(1) : law.at(0).real();
    if (sum) {
      FG_CALL(MatAXPY(sum, factor, matrix, DIFFERENT_NONZERO_PATTERN));
    } else {
      FG_CALL(MatDuplicate(matrix, MAT_COPY_VALUES, sum.out()));
      FG_CALL(MatScale(sum, factor));
    }
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

/// Whether stiffness·K + mass·M + A is positive, by inertia. @pre A is in the solver's terms.
bool is_positive(ShiftedSolver& solver, double stiffness, double mass) {
  try {
    solver.factorise({stiffness, mass, {1.0}});
  } catch (const ShiftError&) {
    return false;
  }
  return solver.negative_pivots() == 0 && solver.null_pivots() == 0;
}

/// What skew terms take, their sum over iω being one of `all` or an average of them.
/// @param seen  grows to what mass alone takes.
std::optional<Softening> of_gyroscopic_forces(const SecondOrderModel& body,
                                              const std::vector<Matrix>& all,
                                              double omega, double tau,
                                              const SolverOptions& options,
                                              double& seen) {
  // Dofs without mass need some stiffness; the less, the closer the bound of the others.
  constexpr double little = 0.01; // of the bound
  Softening best;
  double least = HUGE_VAL;
  for (const double part : {1e-3, 1e-5, 1e-7}) {
    const double kappa = part / std::max(omega * omega, 2 * tau);
    double most = 0;
    for (const Matrix& G : all)
      most = std::max(most, nearly_largest(body, G, kappa, options));
    const Softening here{most, most * kappa};
    seen = std::max(seen, most);
    if (here.needed_square(omega) < least) {
      best = here;
      least = here.needed_square(omega);
    }
    if (best.gyration > 0 && omega * best.gyration_stiffness <= little) break;
  }
  if (!(best.gyration > 0)) return std::nullopt;
  const Matrix K = pair_of(body.K, Pair::equal), M = pair_of(body.M, Pair::equal);
  constexpr double first = 1.02, more = 1.1;
  double factor = first;
  int attempts = 24;
  for (const Matrix& G :
       all) { // what holds of the one with a factor does with a larger one
    const Matrix turned = pair_of(G, Pair::turned);
    ShiftedSolver solver(K, M, {turned}, {}, counting(options));
    solver.count_pivots(true);
    for (;; factor *= more, --attempts) {
      const Softening tried{factor * best.gyration, factor * best.gyration_stiffness};
      if (attempts == 0 || !std::isfinite(tried.needed_square(omega)))
        return std::nullopt;
      if (is_positive(solver, tried.gyration_stiffness, tried.gyration)) break;
    }
  }
  return Softening{factor * best.gyration, factor * best.gyration_stiffness};
}

/// What a spin takes from the stiffness, S being what it adds at the most speed. M_c is no larger
/// than M, and compressive stress takes a share of K about as large as the strain. What is taken at most
/// is positive, so that a slower spin takes a share of it.
/// @param square  [rad²/s²] of the most speed less that of the least. @param tau  K + τM is positive.
std::optional<Softening> of_spin(const SecondOrderModel& body, Mat S, double square,
                                 double tau, const SolverOptions& options) {
  ShiftedSolver solver(body.K, body.M, {S}, body.node, counting(options));
  solver.count_pivots(true);
  constexpr double rounding = 1e-6;
  struct Shares {
    double of_square, of_K;
  };
  for (const auto& [of_square, of_K] : {Shares{1 + rounding, 1e-6},
                                        {1 + rounding, 1e-4},
                                        {1 + rounding, 1e-3},
                                        {1 + rounding, 1e-2},
                                        {1.2, 0.03},
                                        {1.5, 0.05},
                                        {2, 0.07},
                                        {3, 0.1},
                                        {5, 0.15},
                                        {10, 0.2},
                                        {30, 0.3},
                                        {100, 0.5},
                                        {300, 0.6},
                                        {600, 0.7},
                                        {1e3, 0.8},
                                        {3e3, 0.8},
                                        {1e4, 0.8}})
    if (const double mass = std::max(of_square * square, of_K * tau);
        is_positive(solver, of_K, mass))
      return Softening{0, 0, mass, of_K};
  return std::nullopt;
}

PetscReal size_of(Mat a) {
  PetscReal norm = 0;
  if (a) FG_CALL(MatNorm(a, NORM_INFINITY, &norm));
  return norm;
}

} // namespace

Softening softening_of(const SecondOrderModel& body, double omega, double tau,
                       const SolverOptions& options) {
  Softening all;
  double seen = 0;
  if (body.coriolis > 0) {
    constexpr double rounding =
        1e-8; // of the entries of G, beside M's smallest eigenvalues
    all.gyration = (1 + rounding) * body.coriolis;
  } else {
    const bool varies =
        std::any_of(body.terms.begin(), body.terms.end(), [](const auto& term) {
          return term.law.is_skew() && term.law.varies();
        });
    std::vector<Matrix> ends; // between these it is an average
    for (const char* end : {"most", "least"}) {
      Matrix G = sum_of(body, Symmetry::skew, end);
      if (size_of(G) > 0) ends.push_back(std::move(G));
      if (!varies) break;
    }
    if (!ends.empty()) {
      const auto found = of_gyroscopic_forces(body, ends, omega, tau, options, seen);
      if (!found)
        throw Error(
            text("gyroscopic forces up to %.3g rad/s of the inertia beside a band up to "
                 "%.4g Hz: no bound of them was found by mass and stiffness. Do they act "
                 "on dofs without both?",
                 seen, omega / (2 * M_PI)));
      all.gyration = found->gyration;
      all.gyration_stiffness = found->gyration_stiffness;
    }
  }
  const Matrix S = sum_of(body, Symmetry::symmetric, "most");
  if (!(size_of(S) > 0)) return all;
  double square = 0;
  for (const auto& [law, matrix] : body.terms)
    if (!law.is_skew() && !law.is_semidefinite())
      square = std::max(square, law.with("value", law.number("most")).at(0).real());
  const auto found = of_spin(body, S, square, tau, options);
  if (!found)
    throw Error(text("the spin takes more from the stiffness than ten thousand times the "
                     "square of its largest speed, %.3g (rad/s)², times the mass: the "
                     "body bends far out of its shape, "
                     "or the term of spin is not that at 1 rad/s",
                     square));
  all.mass = found->mass;
  all.stiffness = found->stiffness;
  return all;
}

} // namespace flexgram
