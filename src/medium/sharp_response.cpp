#include "medium/sharp_response.hpp"

#include "base/index.hpp"
#include "linalg/accurate_inner.hpp"
#include "linalg/decompositions.hpp"
#include "linalg/last_turn.hpp"
#include "linalg/sparse_product.hpp"

#include <algorithm>
#include <limits>

namespace flexgram {

namespace {

constexpr double epsilon = std::numeric_limits<double>::epsilon();

/// s with |A_ij| ε/2 <= s_i s_j: by the diagonal where A is positive semidefinite, as far as one
/// sees.
std::vector<double> rounding_to_doubles(const Dense& a) {
  const auto root = [&](int j) { return std::sqrt(std::max(a(j, j), 0.0)); };
  bool semidefinite = true;
  std::vector<double> largest(as_size(a.rows), 0.0), result;
  for (int j = 0; j < a.columns; ++j)
    for (int i = 0; i < a.rows; ++i) {
      double& here = largest[as_size(i)];
      here = std::max(here, std::abs(a(i, j)));
      semidefinite = semidefinite && std::abs(a(i, j)) <= 1.01 * root(i) * root(j);
    }
  for (int j = 0; j < a.columns; ++j)
    result.push_back(
        std::sqrt(0.52 * epsilon * (semidefinite ? a(j, j) : largest[as_size(j)])));
  return result;
}

std::vector<double> added(std::vector<double> a, const std::vector<double>& b) {
  for (std::size_t i = 0; i < a.size(); ++i) a[i] += b[i];
  return a;
}

/// The steps of `sharpened`, in the order of `sharpen`.
class Sharpener {
public:
  Sharpener(const MediumSpace& space, const DenseResponse& response,
            const ProjectionRounding& sums, const SharpSums& chosen)
      : space_(space), response_(response), chosen_(chosen), N_(response.U().columns),
        rigid_(space.rigid()), result_{nullptr, sums, identity(N_)} {}

  SharpResponse sharpen(const Block& loads) {
    project();
    turn();
    const LastTurn last = last_turn(K_.hi, M_.hi);
    const AccurateDense ports = project_ports(loads);
    make_response(last.Z, ports);
    finish_rounding(last);
    add_null_vectors(result_.rounding, space_, *result_.response);
    return std::move(result_);
  }

private:
  static constexpr std::size_t of_K = 0, of_M = 1; ///< as MediumSpace counts; then terms

  Block vectors(const std::vector<int>& some) const {
    return some.empty() ? Block() : combine(space_.V(), columns_of(response_.U(), some));
  }
  void project();
  AccurateDense project(std::size_t which, Mat a, const Dense& plain, const Block& Y,
                        EntryRounding& of, Symmetry symmetry = Symmetry::symmetric) const;
  void turn();
  AccurateDense project_ports(const Block& loads);
  void make_response(const Dense& Z, const AccurateDense& ports);
  void finish_rounding(const LastTurn& last);

  const MediumSpace& space_;
  const DenseResponse& response_;
  const SharpSums& chosen_;
  const int N_, rigid_;
  Block Y_; ///< the vectors whose stiffness and ports are summed again
  AccurateDense K_, M_;
  std::vector<AccurateDense> terms_;
  SharpResponse result_;
};

/// UᵀAU, its plain sums replaced where accurate ones are known, and its rounding with them.
AccurateDense Sharpener::project(std::size_t which, Mat a, const Dense& plain,
                                 const Block& Y, EntryRounding& of,
                                 Symmetry symmetry) const {
  const Dense& U = response_.U();
  const double unit = space_.rounding_of_sums().unit + epsilon, // and to a double
      twice = epsilon * (static_cast<double>(space_.fom().n) + 1e3);
  Congruence product = congruence({plain, Dense(N_, N_)}, U);
  AccurateDense all = std::move(product.product);
  of.sharp = std::move(product.rounding);
  const std::vector<int>& modes = which == of_M ? chosen_.M : chosen_.K;
  const int J = static_cast<int>(modes.size());
  if (J == 0) return all;
  const AccurateProduct AY = multiply_accurately(a, Y, {.rest = true});
  const bool skew = symmetry == Symmetry::skew;
  const double mirrored = skew ? -1 : 1;
  const AccurateDense among =
      inner_accurately(Y, AY.product, AY.rest, skew ? Triangle::both : Triangle::upper);
  const AccurateDense with_all =
      multiply_accurately(transpose(U), inner(space_.V(), AY.product));
  const std::vector<double> force = space_.dual_weights(which, AY.product),
                            size = space_.weights(which, Y);
  for (int j = 0; j < J; ++j) {
    const int column = modes[as_size(j)];
    for (int i = 0; i < N_; ++i) {
      all.hi(i, column) = with_all.hi(i, j);
      all.lo(i, column) = with_all.lo(i, j);
      all.hi(column, i) = mirrored * with_all.hi(i, j);
      all.lo(column, i) = mirrored * with_all.lo(i, j);
    }
  }
  for (int j = 0; j < J; ++j)
    for (int i = 0; i < J; ++i) {
      const int row = modes[as_size(i)], column = modes[as_size(j)];
      all.hi(row, column) = among.hi(i, j);
      all.lo(row, column) = among.lo(i, j);
    }
  for (int j = 0; j < J; ++j) {
    const auto at = as_size(j), mode = as_size(modes[at]);
    of.plain[mode] = 0;
    of.force[mode] = std::sqrt(unit) * force[at];
    of.sharp[mode] += twice * size[at];
  }
  return all;
}

/// K, M and the terms between Ritz vectors; rigid modes are apart by definition.
void Sharpener::project() {
  const SecondOrderModel& fom = space_.fom();
  ProjectionRounding& rounding = result_.rounding;
  Y_ = vectors(chosen_.K);
  K_ = project(of_K, fom.K, space_.K(), Y_, rounding.K);
  M_ = project(of_M, fom.M, space_.M(), vectors(chosen_.M), rounding.M);
  for (std::size_t t = 0; t < fom.terms.size(); ++t)
    terms_.push_back(project(of_M + 1 + t, fom.terms[t].matrix, space_.terms()[t], Y_,
                             rounding.terms[t], fom.terms[t].law.symmetry()));
  for (int j = 0; j < N_; ++j)
    for (int i = 0; i < N_; ++i) {
      if (i < rigid_ || j < rigid_) K_.hi(i, j) = K_.lo(i, j) = 0;
      if (i < rigid_ && j < rigid_) M_.hi(i, j) = M_.lo(i, j) = 0;
    }
  for (int j = 0; j < rigid_; ++j) M_.hi(j, j) = 1 / space_.tau();
}

/// To the eigenvectors of the elastic part, (K + τM)-normalised, M descending.
void Sharpener::turn() {
  const SecondOrderModel& fom = space_.fom();
  const int count = N_ - rigid_;
  const auto elastic = [&](const Dense& a) {
    return part_of(a, rigid_, count, rigid_, count);
  };
  const Dense M_e = elastic(M_.hi);
  Dense E = elastic(K_.hi);
  add_to(E, M_e, space_.tau());
  SymmetricEigen eigen = symmetric_eigen(M_e, E);
  share_from_first(fom.comm, eigen.values);
  share_from_first(fom.comm, eigen.vectors.data);
  for (int j = 0; j < count; ++j) {
    double* column = result_.turned.column(rigid_ + j);
    std::fill_n(column, N_, 0.0);
    std::copy_n(eigen.vectors.column(count - 1 - j), count, column + rigid_);
  }
  const auto turn = [&](AccurateDense& a, EntryRounding& of) {
    Congruence product = congruence(a, result_.turned);
    a = std::move(product.product);
    of = of.turned(result_.turned);
    of.sharp = added(of.sharp, product.rounding);
  };
  turn(K_, result_.rounding.K);
  turn(M_, result_.rounding.M);
  for (std::size_t t = 0; t < terms_.size(); ++t)
    turn(terms_[t], result_.rounding.terms[t]);
}

/// Coordinates of the ports, of the chosen vectors by accurate sums.
AccurateDense Sharpener::project_ports(const Block& loads) {
  AccurateDense ports =
      multiply_accurately(transpose(response_.U()), response_.system().B);
  if (!Y_) return ports;
  const AccurateDense of_chosen = inner_accurately(Y_, loads, Block());
  for (std::size_t j = 0; j < chosen_.K.size(); ++j)
    for (int p = 0; p < ports.hi.columns; ++p) {
      ports.hi(chosen_.K[j], p) = of_chosen.hi(static_cast<int>(j), p);
      ports.lo(chosen_.K[j], p) = of_chosen.lo(static_cast<int>(j), p);
      result_.rounding.ports(chosen_.K[j], p) = 0;
    }
  return ports;
}

/// The first turn is rounded to doubles; the last one, I + Z, is no longer in U, but in what
/// follows. Modes need not have an energy of exactly one: their ports and terms make up for it.
void Sharpener::make_response(const Dense& Z, const AccurateDense& ports) {
  const SecondOrderModel& fom = space_.fom();
  const auto tau = static_cast<long double>(space_.tau());
  const auto diagonal = [](const AccurateDense& a, int j) {
    return static_cast<long double>(a.hi(j, j)) + static_cast<long double>(a.lo(j, j));
  };
  std::vector<double> lambda(as_size(rigid_), 0.0);
  std::vector<long double> scale(as_size(rigid_), 1.0L);
  for (int j = rigid_; j < N_; ++j) {
    const long double k = diagonal(K_, j), m = diagonal(M_, j);
    const bool massless = !(tau * m > 1e-14L * k);
    lambda.push_back(massless ? std::numeric_limits<double>::infinity()
                              : static_cast<double>(k / m));
    scale.push_back(1 / std::sqrt(k + tau * std::max(m, 0.0L)));
  }
  const Dense turned_back = transpose(result_.turned);
  AccurateDense in_modes = multiply_accurately(turned_back, ports.hi);
  add_to(in_modes.lo, multiply(turned_back, ports.lo));
  add_to(in_modes.lo, multiply_transposed(Z, in_modes.hi));
  Dense B(N_, ports.hi.columns);
  for (int p = 0; p < B.columns; ++p)
    for (int j = 0; j < N_; ++j)
      B(j, p) = static_cast<double>((static_cast<long double>(in_modes.hi(j, p)) +
                                     static_cast<long double>(in_modes.lo(j, p))) *
                                    scale[as_size(j)]);
  std::vector<Dense> terms;
  for (std::size_t t = 0; t < terms_.size();
       ++t) { // (I + Z)ᵀT(I + Z), rounded to doubles; and of modes with an energy of one
    Dense T = std::move(terms_[t].hi);
    add_to(T, multiply(T, Z));
    add_to(T, multiply_transposed(Z, T));
    EntryRounding& of = result_.rounding.terms[t];
    std::vector<double> twice = rounding_to_doubles(T); // of the sum and of the product
    for (double& x : twice) x *= std::sqrt(2.0);
    of.sharp = added(of.sharp, twice);
    for (int j = 0; j < N_; ++j)
      for (int i = 0; i < N_; ++i)
        T(i, j) = static_cast<double>(static_cast<long double>(T(i, j)) *
                                      (scale[as_size(i)] * scale[as_size(j)]));
    terms.push_back(std::move(T));
  }
  for (auto* values : {&lambda, &B.data}) share_from_first(fom.comm, *values);
  result_.response = std::make_shared<DenseResponse>(
      response_.system(), space_.tau(), multiply(response_.U(), result_.turned), lambda,
      std::move(B), std::move(terms));
}

/// What both turns do to the bounds, and what the last one leaves.
void Sharpener::finish_rounding(const LastTurn& last) {
  ProjectionRounding& rounding = result_.rounding;
  const DenseResponse& response = *result_.response;
  const Dense by_last = absolute(last.Z);
  rounding.strain = turned_weights(result_.turned, rounding.strain);
  for (int j = rigid_; j < N_; ++j) // modes have a strain energy of one at most
    for (int i = rigid_; i < N_; ++i) rounding.strain[as_size(j)] += by_last(i, j);
  rounding.ports = multiply_transposed(absolute(result_.turned), rounding.ports);
  for (int p = 0; p < rounding.ports.columns; ++p)
    for (int j = rigid_; j < N_; ++j)
      rounding.ports(j, p) += 0.8 * epsilon * std::abs(response.modal_inputs()(j, p));
  for (auto* of : {&rounding.K.plain, &rounding.K.force, &rounding.K.sharp})
    std::fill_n(of->begin(), rigid_, 0.0);
  for (int j = rigid_; j < N_; ++j) {
    const auto at = as_size(j);
    const double l = response.lambda()[at];
    rounding.lambda[at] =
        0.51 * epsilon * (std::isfinite(l) ? std::abs(l) * response.mu()[at] : 2.0) +
        last.rest_K(j, j);
    rounding.M.sharp[at] += std::sqrt(last.rest_M(j, j));
  }
  for (int j = rigid_; j < N_; ++j) // `mixed` is of elastic modes
    for (int i = 0; i < rigid_; ++i)
      for (int mode : {i, j}) {
        double& sharp = rounding.M.sharp[as_size(mode)];
        sharp = std::max(sharp, std::sqrt(last.rest_M(i, j)));
      }
  rounding.take_mixed(last.rest_K, last.rest_M, 0);
}

} // namespace

SharpResponse sharpened(const MediumSpace& space, const DenseResponse& response,
                        const ProjectionRounding& sums, const Block& loads,
                        const SharpSums& chosen) {
  return Sharpener(space, response, sums, chosen).sharpen(loads);
}

} // namespace flexgram
