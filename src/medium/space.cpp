#include "medium/space.hpp"

#include "base/index.hpp"
#include "linalg/accurate_inner.hpp"
#include "linalg/sparse.hpp"
#include "linalg/sparse_product.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>

namespace flexgram {

MediumSpace::MediumSpace(const SecondOrderModel& fom, double kappa, double tau)
    : fom_(fom.share()), product_{fom_.M, fom_.K, kappa}, tau_(tau) {
  rows_.K_diagonal = diagonal(fom_.K);
  // Roundings of n entries are random: they add up like √n of them, not n.
  entries_.unit = 16 * std::numeric_limits<double>::epsilon() /
                  std::sqrt(static_cast<double>(fom_.n));
  entries_.printed = fom_.printed_rounding();
  const auto m = diagonal(fom_.M);
  for (std::size_t i = 0; i < m.size(); ++i) {
    const double d = rows_.K_diagonal[i] + tau * m[i];
    rows_.root_diagonal.push_back(d > 0 ? std::sqrt(d) : 1.0);
  }
  double longest = 0;
  std::vector<Mat> matrices{fom_.K, fom_.M};
  for (Mat term : fom_.term_matrices()) matrices.push_back(term);
  for (Mat a : matrices) {
    rows_.weights.push_back(row_weights(a));
    longest = std::max(longest, static_cast<double>(longest_row(a)));
  }
  images_.TV.resize(fom_.terms.size());
  projected_.terms.resize(fom_.terms.size());
  rounding_of_sums_.terms.resize(fom_.terms.size());
  // Of a product with a matrix, of a sum within a strip, of these sums, and of the ranks.
  const double rows = max_over(fom_.comm, static_cast<double>(fom_.rows.size()));
  rounding_of_sums_.unit =
      0.5 * std::numeric_limits<double>::epsilon() *
      (longest + std::min(rows, static_cast<double>(rows_in_a_sum)) +
       static_cast<double>(rows_at_a_time / rows_in_a_sum) + comm_size(fom_.comm) + 8);
}

/// R with |x|ᵀ|A||y| <= √(xᵀRx) √(yᵀRy), by the Cauchy-Schwarz inequality: R_i = s_i Σ_j
/// |a_ij|/s_j for any s > 0. Here s is the root of the diagonal of K + τM, so that units do not
/// matter.
std::vector<double> MediumSpace::row_weights(Mat a) const {
  std::vector<double> inverse;
  for (double s : rows_.root_diagonal) inverse.push_back(1 / s);
  std::vector<double> rows = absolute_product(a, inverse);
  for (std::size_t i = 0; i < rows.size(); ++i) rows[i] *= rows_.root_diagonal[i];
  return rows;
}

std::vector<double> MediumSpace::norms_by(const std::vector<double>& rows, const Block& x,
                                          bool dual) {
  constexpr std::size_t lanes = 8;
  constexpr double tiny = 1e-300; // where a row is empty, so is the force
  std::vector<double> squares(as_size(x.columns()), 0.0), factor(rows);
  if (dual)
    for (double& f : factor) f = 1 / std::max(f, tiny);
  {
    const Block::Access access(x);
    const std::size_t whole = rows.size() - rows.size() % lanes;
    for (PetscInt j = 0; j < x.columns(); ++j) {
      const double* const column = access.column(j);
      double sums[lanes] = {};
      for (std::size_t i = 0; i < whole; i += lanes)
        for (std::size_t l = 0; l < lanes; ++l)
          sums[l] += column[i + l] * column[i + l] * factor[i + l];
      for (std::size_t i = whole; i < rows.size(); ++i)
        sums[0] += column[i] * column[i] * factor[i];
      squares[as_size(j)] = std::accumulate(sums, sums + lanes, 0.0);
    }
  }
  MPI_Allreduce(MPI_IN_PLACE, squares.data(), static_cast<int>(squares.size()),
                MPI_DOUBLE, MPI_SUM, x.comm());
  for (double& s : squares) s = std::sqrt(s) * (1 + 1e-10);
  return squares;
}

std::vector<double> MediumSpace::weights(std::size_t matrix, const Block& x) const {
  return norms_by(rows_.weights[matrix], x, false);
}

Dense MediumSpace::projected_ports(const Block& ports) const {
  Dense all = inner(V_, ports);
  if (rigid_.count == 0) return all;
  const Block rigid = combine(V_, first_columns(identity(columns()), rigid_.count));
  const Dense accurate = inner_accurately(rigid, ports, Block()).hi;
  set_part(all, 0, 0, accurate);
  return all;
}

std::vector<double> MediumSpace::dual_weights_of_ports(const Block& f) const {
  std::vector<double> rows = rows_.weights[0];
  for (std::size_t i = 0; i < rows.size(); ++i) rows[i] += tau_ * rows_.weights[1][i];
  return norms_by(rows, f, true);
}

std::vector<double> MediumSpace::dual_weights(std::size_t matrix, const Block& f) const {
  return norms_by(rows_.weights[matrix], f, true);
}

void MediumSpace::scale(Block& x) const {
  std::vector<double> inverse;
  for (double d : rows_.root_diagonal) inverse.push_back(1 / d);
  scale_rows(x, inverse);
}

void MediumSpace::unscale(Block& x) const { scale_rows(x, rows_.root_diagonal); }

void MediumSpace::start_with_rigid_modes(Block Phi, Dense stiffness, int geometric) {
  const int count = static_cast<int>(Phi.columns());
  if (count == 0) return;
  images_.KV.append(Block(Phi.comm(), Phi.local_rows(), Phi.rows(), count)); // zero
  projected_.K = Dense(count, count);
  projected_.W = identity(count);
  rigid_.stiffness = std::move(stiffness);
  take_deviation(Phi);
  std::vector<Block> TX = times_terms(Phi);
  for (std::size_t t = 0; t < TX.size(); ++t) {
    projected_.terms[t] = inner(Phi, TX[t]);
    symmetrise(projected_.terms[t], fom_.terms[t].law.symmetry());
    images_.TV[t].append(std::move(TX[t]));
  }
  add_rounding_weights(Phi);
  keep_rigid_forces(Phi);
  V_.append(std::move(Phi));
  rigid_.count = count;
  rigid_.geometric = geometric;
}

void MediumSpace::take_deviation(const Block& Phi) {
  const AccurateProduct MPhi = multiply_accurately(fom_.M, Phi, {.rest = true});
  const AccurateDense mass = inner_accurately(Phi, MPhi.product, MPhi.rest);
  double square = 0;
  for (int j = 0; j < mass.hi.columns; ++j)
    for (int i = 0; i < mass.hi.rows; ++i)
      square += std::pow((mass.hi(i, j) - (i == j ? 1 : 0)) + mass.lo(i, j), 2);
  rigid_.mass_deviation = std::sqrt(square);
}

void MediumSpace::keep_rigid_forces(const Block& Phi) {
  rigid_.forces = multiply_accurately(fom_.K, Phi).product;
}

void MediumSpace::add_rounding_weights(const Block& X) {
  std::vector<double> squares(as_size(X.columns()), 0.0);
  {
    const Block::Access x(X);
    for (PetscInt j = 0; j < X.columns(); ++j)
      for (std::size_t i = 0; i < rows_.K_diagonal.size(); ++i)
        squares[as_size(j)] +=
            std::abs(rows_.K_diagonal[i]) * x.column(j)[i] * x.column(j)[i];
  }
  MPI_Allreduce(MPI_IN_PLACE, squares.data(), static_cast<int>(squares.size()),
                MPI_DOUBLE, MPI_SUM, X.comm());
  for (double s : squares) entries_.weights.push_back(std::sqrt(s));
  std::size_t matrix = 0;
  const auto extend = [&](std::vector<double>& all) {
    const std::vector<double> more = weights(matrix++, X);
    all.insert(all.end(), more.begin(), more.end());
  };
  extend(rounding_of_sums_.K);
  extend(rounding_of_sums_.M);
  for (auto& of_term : rounding_of_sums_.terms) extend(of_term);
}

std::vector<Block> MediumSpace::times_terms(const Block& X) const {
  std::vector<Block> TX;
  for (const auto& [law, T] : fom_.terms) TX.push_back(multiply(T, X));
  return TX;
}

void MediumSpace::extend_projection(const Block& X, const Block& KX, const Block& WX,
                                    const std::vector<Block>& TX) {
  const int k = static_cast<int>(X.columns()), old = columns() - k;
  add_rounding_weights(X);
  Dense columns = inner(V_, KX);
  if (rigid_.count > 0)
    rigid_.stiffness = beside(rigid_.stiffness, inner(rigid_.forces, X));
  for (int j = 0; j < k; ++j) {
    for (int i = 0; i < rigid_.count; ++i) columns(i, j) = 0;
    for (int i = 0; i < j; ++i) {
      const double weight =
          entries_.weights[as_size(old + i)] * entries_.weights[as_size(old + j)];
      if (weight > 0)
        entries_.unit = std::max(
            entries_.unit, std::abs(columns(old + i, j) - columns(old + j, i)) / weight);
    }
  }
  projected_.K = bordered(projected_.K, columns);
  Dense mass = inner(V_, WX);
  for (int j = 0; j < k; ++j)
    for (int i = 0; i < rigid_.count; ++i) mass(i, j) = 0;
  projected_.W = bordered(projected_.W, mass);
  for (std::size_t t = 0; t < TX.size(); ++t)
    projected_.terms[t] =
        bordered(projected_.terms[t], inner(V_, TX[t]), fom_.terms[t].law.symmetry());
}

void MediumSpace::restore(Block X) {
  if (X.columns() == 0) return;
  images_.newest_weighted = Block();
  Block KX = multiply(fom_.K, X);
  std::vector<Block> TX = times_terms(X);
  V_.append(X.share());
  extend_projection(X, KX, product_.apply(X), TX);
  images_.KV.append(std::move(KX));
  for (std::size_t t = 0; t < TX.size(); ++t) images_.TV[t].append(std::move(TX[t]));
}

/// Y ← Y − W V c for c = VᵀY, rows scaled: what is residual of it.
void MediumSpace::project(Block& image, const Dense& coordinates) const {
  add_product(image, -1.0, product_.apply(combine(V_, coordinates)),
              identity(coordinates.columns));
  scale(image);
}

Block MediumSpace::mass_of_newest() const {
  if (product_.kappa != 0 || !images_.newest_weighted)
    return multiply(fom_.M, V_.pieces().back());
  return images_.newest_weighted.share();
}

std::vector<double> MediumSpace::append(Block X, double tolerance) {
  Orthonormalised added = orthonormalise(std::move(X), V_, product_, tolerance);
  const int k = static_cast<int>(added.vectors.columns());
  if (k == 0) return std::move(added.outside);
  V_.append(added.vectors.share());
  Block KX = multiply(fom_.K, added.vectors);
  std::vector<Block> TX = times_terms(added.vectors);
  extend_projection(added.vectors, KX, added.weighted, TX);
  if (!tracks_) {
    images_.newest_weighted = std::move(added.weighted);
    images_.KV.append(std::move(KX));
    for (std::size_t t = 0; t < TX.size(); ++t) images_.TV[t].append(std::move(TX[t]));
    return std::move(added.outside);
  }

  // With P' = P − W X Xᵀ the parts that S holds lose a combination of W X, which joins S with
  // the parts of X.
  const int old = columns() - k, width = static_cast<int>(residual_.S.columns());
  Block dual = copy(added.vectors);
  unscale(dual); // S is scaled: Xᵀ(unscaled S) = (D^½X)ᵀS
  const Dense taken = inner(dual, residual_.S);
  scale(added.weighted);
  residual_.S.append(std::move(added.weighted));
  const auto join = [&](Block image, const Dense& projected) {
    project(image, part_of(projected, 0, columns(), old, k));
    residual_.S.append(std::move(image));
  };
  join(std::move(KX), projected_.K);
  for (std::size_t t = 0; t < TX.size(); ++t) join(std::move(TX[t]), projected_.terms[t]);
  const int total = static_cast<int>(residual_.S.columns());
  const auto widened = [&](const Dense& a, int more, int first) {
    Dense wide(total, a.columns + more), of_WX = multiply(taken, a);
    for (double& v : of_WX.data) v = -v;
    set_part(wide, 0, 0, a);
    set_part(wide, width, 0, of_WX);
    for (int j = 0; j < more; ++j) wide(first + j, a.columns + j) = 1;
    return wide;
  };
  residual_.lost_K.resize(residual_.lost_K.size() + as_size(k), 0.0);
  for (auto& lost : residual_.lost_terms) lost.resize(residual_.lost_K.size(), 0.0);
  residual_.B = widened(residual_.B, 0, 0);
  residual_.K = widened(residual_.K, k, width + k);
  int first = width + 2 * k;
  for (Dense& T : residual_.terms) {
    T = widened(T, k, first);
    first += k;
  }
  return std::move(added.outside);
}

void MediumSpace::track_residual(const Block& ports) {
  tracks_ = true;
  images_.newest_weighted = Block();
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
  images_.KV.for_each(
      [&](Block& piece, int first) { // K moves rigid modes by rounding only
        std::vector<double> keep(as_size(piece.columns()), 1.0);
        for (int j = first;
             j < std::min(rigid_.count, first + static_cast<int>(keep.size())); ++j)
          keep[as_size(j - first)] = 0;
        if (first < rigid_.count) scale_columns(piece, keep);
      });
  take_over(images_.KV, projected_.K);
  for (std::size_t t = 0; t < images_.TV.size(); ++t)
    take_over(images_.TV[t], projected_.terms[t]);
  const int p = static_cast<int>(ports.columns()), N = columns(),
            total = static_cast<int>(residual_.S.columns());
  const auto unit = [&](int first, int count) {
    Dense e(total, count);
    for (int j = 0; j < count; ++j) e(first + j, j) = 1;
    return e;
  };
  residual_.B = unit(0, p);
  residual_.K = unit(p, N);
  for (std::size_t t = 0; t < fom_.terms.size(); ++t)
    residual_.terms.push_back(unit(p + N * (static_cast<int>(t) + 1), N));
  residual_.lost_B.assign(as_size(p), 0.0);
  residual_.lost_K.assign(as_size(N), 0.0);
  residual_.lost_terms.assign(fom_.terms.size(), residual_.lost_K);
}

Dense MediumSpace::M() const {
  Dense m = projected_.W;
  for (std::size_t i = 0; i < m.data.size(); ++i)
    m.data[i] -= product_.kappa * projected_.K.data[i];
  return m;
}

} // namespace flexgram
