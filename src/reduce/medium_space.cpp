#include "reduce/medium_space.hpp"

#include "linalg/sparse.hpp"

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
      K_diagonal_(diagonal(fom_.K)), rounding_(std::numeric_limits<double>::epsilon()) {
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

void MediumSpace::start_with_rigid_modes(Block Phi) {
  const int count = static_cast<int>(Phi.columns());
  if (count == 0) return;
  WV_ = multiply(fom_.M, Phi);
  V_ = std::move(Phi);
  K_ = Dense(count, count);
  if (fom_.D) {
    D_ = inner(V_, multiply(fom_.D, V_));
    symmetrise(D_);
  }
  g_.assign(static_cast<std::size_t>(count), 0.0);
  rigid_ = count;
}

void MediumSpace::set_rigid(int count) {
  rigid_ = count;
  for (int j = 0; j < columns(); ++j)
    for (int i = 0; i < columns(); ++i)
      if (i < count || j < count) K_(i, j) = 0;
  std::fill_n(g_.begin(), count, 0.0);
}

void MediumSpace::extend_projection(const Block& X, const Block& KX, const Block& DX) {
  const int k = static_cast<int>(X.columns()), old = columns() - k;
  std::vector<double> squares(static_cast<std::size_t>(k), 0.0);
  {
    const Block::Access x(X);
    for (int j = 0; j < k; ++j)
      for (std::size_t i = 0; i < K_diagonal_.size(); ++i)
        squares[static_cast<std::size_t>(j)] +=
            K_diagonal_[i] * x.column(j)[i] * x.column(j)[i];
  }
  MPI_Allreduce(MPI_IN_PLACE, squares.data(), k, MPI_DOUBLE, MPI_SUM, X.comm());
  for (double s : squares) g_.push_back(std::sqrt(s));

  Dense columns = inner(V_, KX);
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

int MediumSpace::append(Block X, double tolerance) {
  Orthonormalised added = orthonormalise(std::move(X), V_, WV_, product_, tolerance);
  const int k = static_cast<int>(added.vectors.columns());
  if (k == 0) return 0;
  V_ = concatenate(V_, added.vectors);
  WV_ = concatenate(WV_, added.weighted);
  Block KX = multiply(fom_.K, added.vectors), DX;
  if (fom_.D) DX = multiply(fom_.D, added.vectors);
  extend_projection(added.vectors, KX, DX);
  if (!tracks_) return k;

  // The old parts lose what the new vectors take out of them, then the new parts join.
  const int old = columns() - k;
  const auto new_rows = [&](const Dense& projected) { // XᵀKV of the old V
    return part_of(projected, old, k, 0, old);
  };
  Block weighted = copy(added.weighted);
  scale(weighted);
  add_product(residual_B_, -1.0, weighted, inner(added.vectors, ports_));
  add_product(residual_K_, -1.0, weighted, new_rows(K_));
  residual_K_ = concatenate(residual_K_, outside(std::move(KX), K_, old));
  if (fom_.D) {
    add_product(residual_D_, -1.0, weighted, new_rows(D_));
    residual_D_ = concatenate(residual_D_, outside(std::move(DX), D_, old));
  }
  return k;
}

Block MediumSpace::outside(Block image, const Dense& projected, int first) const {
  add_product(image, -1.0, WV_,
              part_of(projected, 0, columns(), first, columns() - first));
  scale(image);
  return image;
}

void MediumSpace::track_residual(const Block& ports) {
  tracks_ = true;
  ports_ = ports.share();
  residual_B_ = copy(ports);
  add_product(residual_B_, -1.0, WV_, inner(V_, ports));
  scale(residual_B_);
  residual_K_ = outside(multiply(fom_.K, V_), K_, 0);
  if (rigid_ > 0) { // K moves them by rounding only
    std::vector<double> keep(static_cast<std::size_t>(columns()), 1.0);
    std::fill_n(keep.begin(), rigid_, 0.0);
    scale_columns(residual_K_, keep);
  }
  if (fom_.D) residual_D_ = outside(multiply(fom_.D, V_), D_, 0);
}

void MediumSpace::rotate(const Dense& Q) {
  V_ = combine(V_, Q);
  WV_ = combine(WV_, Q);
  const auto congruence = [&](const Dense& a) {
    Dense result = multiply_transposed(Q, multiply(a, Q));
    symmetrise(result);
    return result;
  };
  K_ = congruence(K_);
  if (!D_.data.empty()) D_ = congruence(D_);
  std::vector<double> rotated(static_cast<std::size_t>(Q.columns), 0.0);
  for (int j = 0; j < Q.columns; ++j) { // as if the parts had random signs
    for (int i = 0; i < Q.rows; ++i)
      rotated[static_cast<std::size_t>(j)] +=
          std::pow(Q(i, j) * g_[static_cast<std::size_t>(i)], 2);
    rotated[static_cast<std::size_t>(j)] =
        std::sqrt(rotated[static_cast<std::size_t>(j)]);
  }
  g_ = std::move(rotated);
  if (rigid_ > 0) set_rigid(rigid_);
}

Dense MediumSpace::M() const {
  Dense m = identity(columns());
  for (std::size_t i = 0; i < m.data.size(); ++i)
    m.data[i] -= product_.kappa * K_.data[i];
  return m;
}

} // namespace flexgram
