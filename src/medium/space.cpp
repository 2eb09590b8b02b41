#include "medium/space.hpp"

#include "linalg/sparse.hpp"
#include "linalg/sparse_product.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

namespace flexgram {
namespace {

/// [A, c; cᵀ, d] from the new columns [c; d].
Dense grown(const Dense& a, const Dense& columns) {
  const int old = columns.rows - columns.columns;
  Dense result(columns.rows, columns.rows);
  if (old > 0) set_part(result, 0, 0, a);
  set_part(result, 0, old, columns);
  for (int j = old; j < result.columns; ++j)
    for (int i = 0; i < old; ++i) result(j, i) = result(i, j);
  Dense corner = part_of(result, old, columns.columns, old, columns.columns);
  symmetrise(corner);
  set_part(result, old, old, corner);
  return result;
}

} // namespace

MediumSpace::MediumSpace(const SecondOrderModel& fom, double kappa, double tau)
    : fom_(fom.share()), product_{fom_.M, fom_.K, kappa}, tau_(tau),
      K_diagonal_(diagonal(fom_.K)),
      // Roundings of n entries are random: they add up like √n of them, not n.
      rounding_(16 * std::numeric_limits<double>::epsilon() /
                std::sqrt(static_cast<double>(fom_.n))),
      printed_rounding_(fom_.printed_rounding()) {
  const auto m = diagonal(fom_.M);
  for (std::size_t i = 0; i < m.size(); ++i) {
    const double d = K_diagonal_[i] + tau * m[i];
    root_diagonal_.push_back(d > 0 ? std::sqrt(d) : 1.0);
  }
}

void MediumSpace::scale(Block& x) const {
  std::vector<double> inverse;
  for (double d : root_diagonal_) inverse.push_back(1 / d);
  scale_rows(x, inverse);
}

void MediumSpace::unscale(Block& x) const { scale_rows(x, root_diagonal_); }

void MediumSpace::start_with_rigid_modes(Block Phi, Dense stiffness) {
  const int count = static_cast<int>(Phi.columns());
  if (count == 0) return;
  KV_.append(Block(Phi.comm(), Phi.local_rows(), Phi.rows(), count)); // zero
  K_ = Dense(count, count);
  rigid_stiffness_ = std::move(stiffness);
  if (fom_.D) {
    DV_.append(multiply(fom_.D, Phi));
    D_ = inner(Phi, DV_.pieces().front());
    symmetrise(D_);
  }
  add_rounding_weights(Phi);
  keep_rigid_forces(Phi);
  V_.append(std::move(Phi));
  rigid_ = count;
}

void MediumSpace::keep_rigid_forces(const Block& Phi) {
  rigid_forces_ = multiply_accurately(fom_.K, Phi).product;
}

void MediumSpace::add_rounding_weights(const Block& X) {
  std::vector<double> squares(static_cast<std::size_t>(X.columns()), 0.0);
  {
    const Block::Access x(X);
    for (PetscInt j = 0; j < X.columns(); ++j)
      for (std::size_t i = 0; i < K_diagonal_.size(); ++i)
        squares[static_cast<std::size_t>(j)] +=
            K_diagonal_[i] * x.column(j)[i] * x.column(j)[i];
  }
  MPI_Allreduce(MPI_IN_PLACE, squares.data(), static_cast<int>(squares.size()),
                MPI_DOUBLE, MPI_SUM, X.comm());
  for (double s : squares) g_.push_back(std::sqrt(s));
}

void MediumSpace::extend_projection(const Block& X, const Block& KX, const Block& DX) {
  const int k = static_cast<int>(X.columns()), old = columns() - k;
  add_rounding_weights(X);
  Dense columns = inner(V_, KX);
  if (rigid_ > 0)
    rigid_stiffness_ = beside(rigid_stiffness_, inner(rigid_forces_, X));
  for (int j = 0; j < k; ++j) {
    for (int i = 0; i < rigid_; ++i) columns(i, j) = 0;
    for (int i = 0; i < j; ++i) {
      const double weight =
          g_[static_cast<std::size_t>(old + i)] * g_[static_cast<std::size_t>(old + j)];
      if (weight > 0)
        rounding_ = std::max(
            rounding_, std::abs(columns(old + i, j) - columns(old + j, i)) / weight);
    }
  }
  K_ = grown(K_, columns);
  if (DX) D_ = grown(D_, inner(V_, DX));
}

void MediumSpace::restore(Block X) {
  if (X.columns() == 0) return;
  newest_weighted_ = Block();
  Block KX = multiply(fom_.K, X), DX;
  if (fom_.D) DX = multiply(fom_.D, X);
  V_.append(X.share());
  extend_projection(X, KX, DX);
  KV_.append(std::move(KX));
  if (fom_.D) DV_.append(std::move(DX));
}

/// Y ← Y − W V c for c = VᵀY, rows scaled: what is residual of it.
void MediumSpace::project(Block& image, const Dense& coordinates) const {
  add_product(image, -1.0, product_.apply(combine(V_, coordinates)),
              identity(coordinates.columns));
  scale(image);
}

Block MediumSpace::mass_of_newest() const {
  if (product_.kappa != 0 || !newest_weighted_)
    return multiply(fom_.M, V_.pieces().back());
  return newest_weighted_.share();
}

std::vector<double> MediumSpace::append(Block X, double tolerance) {
  Orthonormalised added = orthonormalise(std::move(X), V_, product_, tolerance);
  const int k = static_cast<int>(added.vectors.columns());
  if (k == 0) return std::move(added.outside);
  V_.append(added.vectors.share());
  Block KX = multiply(fom_.K, added.vectors), DX;
  if (fom_.D) DX = multiply(fom_.D, added.vectors);
  extend_projection(added.vectors, KX, DX);
  if (!tracks_) {
    newest_weighted_ = std::move(added.weighted);
    KV_.append(std::move(KX));
    if (fom_.D) DV_.append(std::move(DX));
    return std::move(added.outside);
  }

  // S loses what the new vectors take out of it; their own parts join.
  const int old = columns() - k, width = static_cast<int>(residual_.S.columns());
  Block dual = copy(added.vectors), weighted = copy(added.weighted);
  unscale(dual); // S is scaled: Xᵀ(unscaled S) = (D^½X)ᵀS
  scale(weighted);
  residual_.S.for_each(
      [&](Block& piece, int) { add_product(piece, -1.0, weighted, inner(dual, piece)); });
  const auto join = [&](Block image, const Dense& projected) {
    project(image, part_of(projected, 0, columns(), old, k));
    residual_.S.append(std::move(image));
  };
  join(std::move(KX), K_);
  if (fom_.D) join(std::move(DX), D_);
  const int total = static_cast<int>(residual_.S.columns());
  const auto widened = [&](const Dense& a, int more, int first) {
    Dense wide(total, a.columns + more);
    set_part(wide, 0, 0, a);
    for (int j = 0; j < more; ++j) wide(first + j, a.columns + j) = 1;
    return wide;
  };
  residual_.lost_K.resize(residual_.lost_K.size() + static_cast<std::size_t>(k), 0.0);
  if (fom_.D) residual_.lost_D.resize(residual_.lost_K.size(), 0.0);
  residual_.B = widened(residual_.B, 0, 0);
  residual_.K = widened(residual_.K, k, width);
  if (fom_.D) residual_.D = widened(residual_.D, k, width + k);
  return std::move(added.outside);
}

void MediumSpace::track_residual(const Block& ports) {
  tracks_ = true;
  newest_weighted_ = Block();
  Block PB = copy(ports);
  project(PB, inner(V_, ports));
  residual_.S.append(std::move(PB));
  const auto take_over = [&](Basis& images, const Dense& projected) {
    images.for_each([&](Block& piece, int first) {
      const int k = static_cast<int>(piece.columns());
      project(piece, part_of(projected, 0, columns(), first, k));
      residual_.S.append(piece.share());
    });
    images = Basis();
  };
  KV_.for_each([&](Block& piece, int first) { // K moves rigid modes by rounding only
    std::vector<double> keep(static_cast<std::size_t>(piece.columns()), 1.0);
    for (int j = first; j < std::min(rigid_, first + static_cast<int>(keep.size())); ++j)
      keep[static_cast<std::size_t>(j - first)] = 0;
    if (first < rigid_) scale_columns(piece, keep);
  });
  take_over(KV_, K_);
  if (fom_.D) take_over(DV_, D_);
  const int p = static_cast<int>(ports.columns()), N = columns(),
            total = static_cast<int>(residual_.S.columns());
  const auto unit = [&](int first, int count) {
    Dense e(total, count);
    for (int j = 0; j < count; ++j) e(first + j, j) = 1;
    return e;
  };
  residual_.B = unit(0, p);
  residual_.K = unit(p, N);
  if (fom_.D) residual_.D = unit(p + N, N);
  residual_.lost_B.assign(static_cast<std::size_t>(p), 0.0);
  residual_.lost_K.assign(static_cast<std::size_t>(N), 0.0);
  if (fom_.D) residual_.lost_D = residual_.lost_K;
}

void MediumSpace::rotate_to_rigid(const Dense& Q, int count, Dense stiffness) {
  const auto congruence = [&](const Dense& a) {
    Dense result = multiply_transposed(Q, multiply(a, Q));
    symmetrise(result);
    return result;
  };
  for (Basis* basis : {&V_, &KV_, &DV_})
    if (*basis) *basis = combine(*basis, Q);
  newest_weighted_ = Block();
  K_ = congruence(K_);
  if (!D_.data.empty()) D_ = congruence(D_);
  std::vector<double> rotated; // as if the parts had random signs
  for (int j = 0; j < Q.columns; ++j) {
    double square = 0;
    for (int i = 0; i < Q.rows; ++i)
      square += std::pow(Q(i, j) * g_[static_cast<std::size_t>(i)], 2);
    rotated.push_back(std::sqrt(square));
  }
  g_ = std::move(rotated);
  keep_rigid_forces(combine(V_, first_columns(identity(columns()), count)));
  rigid_stiffness_ = inner(rigid_forces_, V_);
  set_part(rigid_stiffness_, 0, 0, stiffness);
  rigid_ = count;
  for (int j = 0; j < columns(); ++j)
    for (int i = 0; i < columns(); ++i)
      if (i < count || j < count) K_(i, j) = 0;
}

Dense MediumSpace::M() const {
  Dense m = identity(columns());
  for (std::size_t i = 0; i < m.data.size(); ++i)
    m.data[i] -= product_.kappa * K_.data[i];
  return m;
}

} // namespace flexgram
