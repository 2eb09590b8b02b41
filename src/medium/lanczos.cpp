#include "medium/lanczos.hpp"

#include "base/event.hpp"
#include "base/index.hpp"
#include "base/text.hpp"
#include "linalg/sparse_product.hpp"

#include <algorithm>
#include <cmath>

namespace flexgram {
namespace {

/// Directions of S Q that the last blocks leave are new if they are larger than this part of it: the
/// others are rounding, of a space that is exhausted.
constexpr double rounding = 1e-9;
/// What a pass removes of orthonormal vectors, so that no other pass is needed.
constexpr double nearly_orthogonal = 1e-7;
/// Pieces of the basis are joined up to so many columns: products with them are faster.
constexpr int wide_piece = 192;

/// F with FᵀGF = 1, without directions whose square, each column divided by its size, is below `floor`,
/// or rounding beside the largest.
Dense orthonormalising(Dense gram, const std::vector<double>& sizes, double floor) {
  symmetrise(gram);
  const auto inverse = [&](int j) {
    return sizes[as_size(j)] > 0 ? 1 / sizes[as_size(j)] : 0.0;
  };
  double trace = 0;
  for (int j = 0; j < gram.columns; ++j) {
    for (int i = 0; i < gram.rows; ++i) gram(i, j) *= inverse(i) * inverse(j);
    trace += gram(j, j);
  }
  double least = 0;
  Dense F = kept_directions(gram, std::max(floor, 1e-12 * trace), least);
  for (int j = 0; j < F.columns; ++j)
    for (int i = 0; i < F.rows; ++i) F(i, j) *= inverse(i);
  return F;
}

/// The Krylov space: W-orthonormal blocks Q_0, Q_1, … and T = VᵀWSV, block tridiagonal.
class Krylov {
public:
  Krylov(const LanczosSpec& spec, RealFactors& factors, const Block& deflated,
         Block start)
      : spec_(spec), factors_(factors) {
    if (deflated && deflated.columns() > 0) V_.append(deflated.share());
    deflated_ = static_cast<int>(V_.columns());
    const Block weighted = spec.product.apply(start);
    take_over(orthonormalise(std::move(start), V_, spec.product, 1e-7));
    responses_ = first_columns(inner(newest_.vectors, weighted), spec.ports);
  }

  MPI_Comm comm() const { return V_.pieces().front().comm(); }
  /// The responses of the start in the coordinates of Q_0.
  const Dense& responses() const { return responses_; }

  /// Columns of the space, and of the newest block, which T does not know yet.
  int columns() const { return known_; }
  int newest() const {
    return newest_.vectors ? static_cast<int>(newest_.vectors.columns()) : 0;
  }
  int solves() const { return solves_; }

  /// S times the newest block: T knows it then, and there is a newer one.
  void step() {
    const Block& Q = newest_.vectors;
    const int b = newest();
    Block Z = factors_.solve(spec_.product.kappa == 0 ? newest_.weighted.share()
                                                      : multiply(spec_.product.M, Q),
                             ShiftedSolver::Verify::none);
    solves_ += b;
    Block WZ = spec_.product.apply(Z);
    const Block image = copy(WZ);
    const Dense squares = inner(Z, WZ);
    std::vector<double> sizes;
    for (int j = 0; j < b; ++j) sizes.push_back(std::sqrt(std::max(squares(j, j), 0.0)));
    Dense alpha = inner(Q, WZ);
    const auto remove = [&](const Orthonormalised& from, const Dense& c) {
      add_product(Z, -1.0, from.vectors, c);
      add_product(WZ, -1.0, from.weighted, c);
    };
    if (before_.vectors) remove(before_, inner(before_.vectors, WZ));
    remove(newest_, alpha);
    symmetrise(alpha);
    diagonal_.push_back(std::move(alpha));
    known_ += b;
    Orthonormalised next = outside(std::move(Z), std::move(WZ), sizes);
    below_.push_back(next.vectors ? inner(next.vectors, image) : Dense(0, b));
    before_ = std::move(newest_);
    take_over(std::move(next));
  }

  struct Pairs {
    SymmetricEigen ritz;          ///< of T
    std::vector<double> residual; ///< ‖Sφ − θφ‖_W
  };
  Pairs pairs() const {
    Dense T(known_, known_);
    int first = 0;
    for (std::size_t j = 0; j < diagonal_.size(); ++j) {
      const int b = diagonal_[j].rows;
      set_part(T, first, first, diagonal_[j]);
      if (j + 1 < diagonal_.size()) {
        set_part(T, first + b, first, below_[j]);
        set_part(T, first, first + b, transpose(below_[j]));
      }
      first += b;
    }
    Pairs result{symmetric_eigen(std::move(T)), {}};
    share_from_first(comm(), result.ritz.values);
    share_from_first(comm(), result.ritz.vectors.data);
    const int b = diagonal_.back().rows;
    const Dense rest =
        multiply(below_.back(), part_of(result.ritz.vectors, known_ - b, b, 0, known_));
    for (int j = 0; j < known_; ++j) {
      double square = 0;
      for (int i = 0; i < rest.rows; ++i) square += rest(i, j) * rest(i, j);
      result.residual.push_back(std::sqrt(square));
    }
    return result;
  }

  /// V s for the columns of s.
  Block vectors(const Dense& s) const {
    const auto all = static_cast<int>(V_.columns());
    Dense q(all, s.columns);
    set_part(q, deflated_, 0, s); // the newest block is not in T
    return combine(V_, q);
  }

private:
  /// Of Z, which is orthogonal to the last two blocks but for rounding, an orthonormal basis
  /// that is so to all. @param sizes  of Z's columns before these were taken out.
  Orthonormalised outside(Block Z, Block WZ, const std::vector<double>& sizes) const {
    const auto turn = [&](const Dense& F) {
      Z = combine(Z, F);
      WZ = combine(WZ, F);
    };
    Dense F = orthonormalising(inner(Z, WZ), sizes, rounding * rounding);
    share_from_first(Z.comm(), F.data);
    if (F.columns == 0) return {};
    turn(F);
    for (int pass = 0; pass < 4; ++pass) {
      const Dense c = inner(V_, WZ);
      add_product(Z, -1.0, V_, c);
      WZ = spec_.product.apply(Z);
      // Of length 1 before, so that what is short now was in the space already.
      const std::vector<double> one(as_size(Z.columns()), 1.0);
      Dense again = orthonormalising(inner(Z, WZ), one, 0.1);
      share_from_first(Z.comm(), again.data);
      if (again.columns == 0) return {};
      turn(again);
      if (max_norm(c) < nearly_orthogonal) break;
    }
    return {std::move(Z), std::move(WZ), {}};
  }

  void take_over(Orthonormalised next) {
    newest_ = std::move(next);
    if (newest() == 0) return;
    V_.append(newest_.vectors.share());
    V_.join_last(wide_piece);
  }

  const LanczosSpec& spec_;
  RealFactors& factors_;
  Basis V_; ///< deflated modes first
  Orthonormalised newest_, before_;
  Dense responses_;
  std::vector<Dense> diagonal_, below_; ///< blocks of T
  int deflated_ = 0, known_ = 0, solves_ = 0;
};

/// Whether a Ritz value θ of S is that of a mode below the cutoff: λ = σ + 1/θ.
bool is_below(const LanczosSpec& spec, double theta) {
  return theta < 0 || theta * (spec.cutoff - spec.shift) > 1;
}

/// Directions of the responses beside the modes below the cutoff, in the coordinates of the Krylov
/// space: left singular vectors of samples, each Ritz vector by the root of its energy. Since
/// (K − σM)⁻¹(K − ω²M) = 1 + (σ − ω²)S, a Ritz vector of S with the value θ has in the response at ω
/// (1 + (σ − ω_c²)θ)/(1 + (σ − ω²)θ) times its part in the response at ω_c.
Dense directions_beside(const LanczosSpec& spec, const Krylov& krylov,
                        const Krylov::Pairs& pairs) {
  const Dense &vectors = pairs.ritz.vectors, &start = krylov.responses();
  const int N = vectors.columns, p = start.columns;
  const Dense at_cutoff =
      multiply_transposed(part_of(vectors, 0, start.rows, 0, N), start);
  Dense samples(N, p * static_cast<int>(spec.samples.size()));
  std::vector<double> root(as_size(N), 0.0); // of the energy of a Ritz vector
  for (int i = 0; i < N; ++i) {
    const double theta = pairs.ritz.values[as_size(i)];
    if (!(theta > 0) || is_below(spec, theta)) continue;
    root[as_size(i)] = std::sqrt(1 / theta + spec.shift);
    int next = 0;
    for (double square : spec.samples)
      for (int j = 0; j < p; ++j)
        samples(i, next++) = root[as_size(i)] * at_cutoff(i, j) *
                             (1 + (spec.shift - spec.cutoff) * theta) /
                             (1 + (spec.shift - square) * theta);
  }
  LeftSvd svd = left_svd(compressed(samples));
  share_from_first(krylov.comm(), svd.values);
  share_from_first(krylov.comm(), svd.vectors.data);
  int count = 0;
  while (count < svd.vectors.columns &&
         svd.values[as_size(count)] > spec.negligible * svd.values[0])
    ++count;
  Dense chosen = first_columns(svd.vectors, count);
  for (int j = 0; j < count; ++j)
    for (int i = 0; i < N; ++i)
      chosen(i, j) = root[as_size(i)] > 0 ? chosen(i, j) / root[as_size(i)] : 0.0;
  return multiply(vectors, chosen);
}

} // namespace

LanczosModes lanczos_modes(const LanczosSpec& spec, RealFactors& factors,
                           const Block& deflated, Block start, Observer& observer) {
  static Event event("Lanczos");
  const auto timed = event.timed();
  Krylov krylov(spec, factors, deflated, std::move(start));
  Progress progress(observer, "modes", spec.expected);
  int look_at = spec.expected;
  for (;;) {
    krylov.step();
    const bool is_last =
        krylov.newest() == 0 || krylov.columns() + krylov.newest() > spec.most;
    if (krylov.columns() < look_at && !is_last) continue;
    const Krylov::Pairs pairs = krylov.pairs();
    LanczosModes result;
    std::vector<int> below;
    double worst = 0;
    for (int j = 0; j < krylov.columns(); ++j) {
      const double theta = pairs.ritz.values[as_size(j)];
      if (!is_below(spec, theta)) continue;
      below.push_back(j);
      const double angle = pairs.residual[as_size(j)] / std::abs(theta);
      worst = std::max(worst, angle);
      if (angle <= spec.enough) result.lambda.push_back(spec.shift + 1 / theta);
    }
    const auto found = static_cast<int>(below.size()),
               good = static_cast<int>(result.lambda.size());
    progress.reach(good,
                   text("%d seen in a Krylov space of %d columns, largest angle %.1e",
                        found, krylov.columns(), worst));
    result.complete = found == spec.expected && good == found;
    if (result.complete || is_last || found > spec.expected) {
      result.modes = krylov.vectors(columns_of(pairs.ritz.vectors, below));
      result.beside = krylov.vectors(directions_beside(spec, krylov, pairs));
      result.columns = krylov.columns();
      result.solves = krylov.solves();
      return result;
    }
    // Looking costs the cube of the columns: not before what is missing may be there.
    look_at = krylov.columns() +
              std::max(krylov.newest(), static_cast<int>(0.4 * (spec.expected - good)));
  }
}

} // namespace flexgram
