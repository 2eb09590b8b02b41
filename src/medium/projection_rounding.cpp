#include "medium/projection_rounding.hpp"

#include "linalg/accurate_inner.hpp"
#include "linalg/sparse_product.hpp"

#include <algorithm>
#include <limits>

namespace flexgram {
namespace {

constexpr double epsilon = std::numeric_limits<double>::epsilon();

/// Σ_k |U_kj| w_k.
std::vector<double> turned_weights(const Dense& U, const std::vector<double>& w) {
  std::vector<double> result;
  for (int j = 0; j < U.columns; ++j) {
    double sum = 0;
    for (int k = 0; k < U.rows; ++k)
      sum += std::abs(U(k, j)) * w[static_cast<std::size_t>(k)];
    result.push_back(sum);
  }
  return result;
}

Dense congruence(const Dense& a, const Dense& Q) {
  Dense result = multiply_transposed(Q, multiply(a, Q));
  symmetrise(result);
  return result;
}

/// The largest entry beside the diagonal, and on it beside what it should be, with what the
/// products for it may have lost.
double beside_diagonal(const Dense& a, const std::vector<double>& diagonal, int first) {
  double largest = 0;
  for (int j = first; j < a.columns; ++j)
    for (int i = first; i < a.rows; ++i)
      if (i != j) largest = std::max(largest, std::abs(a(i, j)));
  double size = 0;
  for (double d : diagonal) size = std::max(size, std::abs(d));
  return largest + 2 * epsilon * (a.rows + 2) * size;
}

/// xᵀ(hi + lo)x with the digits of long double.
long double energy(const AccurateDense& a, const double* x) {
  long double sum = 0;
  for (int j = 0; j < a.hi.columns; ++j) {
    long double column = 0;
    for (int i = 0; i < a.hi.rows; ++i)
      column +=
          (static_cast<long double>(a.hi(i, j)) + static_cast<long double>(a.lo(i, j))) *
          static_cast<long double>(x[i]);
    sum += column * static_cast<long double>(x[j]);
  }
  return sum;
}

} // namespace

double ProjectionRounding::of_response(double a_k, double omega, const Sizes& outputs,
                                       const Sizes& inputs) const {
  const double square = omega * omega;
  const auto product = [&](const std::vector<double>& w, std::size_t first) {
    double out = 0, in = 0;
    for (std::size_t i = first; i < w.size(); ++i) {
      out += w[i] * outputs[i];
      in += w[i] * inputs[i];
    }
    return std::array<double, 2>{out, in};
  };
  const auto apart = static_cast<std::size_t>(rigid);
  const auto [K_out, K_in] = product(K, apart);
  const auto [M_out, M_in] = product(M, apart);
  const auto [D_out, D_in] = product(D, 0);
  double sum = a_k * K_out * K_in + square * M_out * M_in + omega * D_out * D_in;
  double all_out = 0, all_in = 0, same = 0;
  for (std::size_t i = apart; i < K.size(); ++i) {
    all_out += outputs[i];
    all_in += inputs[i];
    same += outputs[i] * inputs[i];
    sum += a_k * lambda[i] * outputs[i] * inputs[i];
  }
  sum += (a_k + square / tau) * mixed * std::max(all_out * all_in - same, 0.0);
  double rigid_out = 0, rigid_in = 0, M_rigid_out = 0, M_rigid_in = 0;
  for (std::size_t i = 0; i < apart; ++i) {
    rigid_out += outputs[i] * outputs[i];
    rigid_in += inputs[i] * inputs[i];
    M_rigid_out += M[i] * outputs[i];
    M_rigid_in += M[i] * inputs[i];
  }
  return sum + square * (rigid_mass * std::sqrt(rigid_out * rigid_in) +
                         M_rigid_out * M_in + M_out * M_rigid_in);
}

ProjectionRounding::Sizes ProjectionRounding::of_equations(double a_k, double omega,
                                                           const Sizes& x) const {
  double of_K = 0, of_M = 0, of_D = 0, all = 0;
  for (std::size_t i = 0; i < x.size(); ++i) {
    of_K += K[i] * x[i];
    of_M += M[i] * x[i];
    of_D += D[i] * x[i];
    all += x[i];
  }
  const double square = omega * omega;
  Sizes result;
  for (std::size_t i = 0; i < x.size(); ++i)
    result.push_back(a_k * (K[i] * of_K + lambda[i] * x[i]) + square * M[i] * of_M +
                     omega * D[i] * of_D + (a_k + square / tau) * mixed * (all - x[i]));
  return result;
}

bool ProjectionRounding::fits(int order, int ports_count) const {
  const auto holds = [](const std::vector<double>& v, int count) {
    return v.size() == static_cast<std::size_t>(count);
  };
  return holds(K, order) && holds(M, order) && holds(D, order) && holds(lambda, order) &&
         holds(ports, order) && holds(port_sizes, ports_count) && rigid >= 0 &&
         rigid <= order;
}

ProjectionRounding plain_rounding(const MediumSpace& space, const DenseResponse& response,
                                  const Block& loads) {
  const MediumSpace::Rounding& sums = space.rounding_of_sums();
  const Dense& U = response.U();
  const int N = U.columns, rigid = space.rigid();
  const double unit = sums.unit + 2 * epsilon * (N + 2), root = std::sqrt(unit);
  ProjectionRounding result;
  result.rigid = rigid;
  result.tau = space.tau();
  result.K = turned_weights(U, sums.K);
  result.M = turned_weights(U, sums.M);
  result.D = turned_weights(U, sums.D);
  const double tau = space.tau(), kappa = space.kappa();
  for (int j = 0; j < N; ++j) {
    const auto at = static_cast<std::size_t>(j);
    const double k = result.K[at], m = result.M[at];
    // Those of rigid modes are summed accurately: their rounding is with that of their mass.
    result.ports.push_back(j < rigid ? 0.0 : unit * std::sqrt(k * k + tau * m * m));
    result.M[at] = root * std::sqrt(m * m + 2 * kappa * k * k);
    result.K[at] = j < rigid ? 0.0 : root * k;
    result.D[at] *= root;
    const double lambda = response.lambda()[at];
    result.lambda.push_back(
        j < rigid ? 0.0
                  : epsilon * std::abs(std::isfinite(lambda) ? lambda * response.mu()[at]
                                                             : 1.0));
  }
  const std::vector<double> of_K = space.dual_weights_of_ports(loads);
  result.port_sizes = of_K;
  std::vector<double> k(response.mu().size(), 1.0);
  result.mixed =
      std::max(beside_diagonal(congruence(space.K(), U), k, rigid),
               tau * beside_diagonal(congruence(space.M(), U), response.mu(), rigid));
  // Of (K + τM)-normalised rigid modes.
  result.rigid_mass = (space.rigid_mass_deviation() + 3 * epsilon) / tau;
  return result;
}

SharpResponse sharpened(const MediumSpace& space, const DenseResponse& response,
                        const ProjectionRounding& plain, const std::vector<int>& chosen) {
  const Dense& U = response.U();
  const SecondOrderModel& fom = space.fom();
  const int N = U.columns, rigid = space.rigid(), count = N - rigid,
            J = static_cast<int>(chosen.size());
  const double tau = space.tau(),
               unit = space.rounding_of_sums().unit + 2 * epsilon * (N + 2),
               twice = std::pow(epsilon * (static_cast<double>(fom.n) + 1e3), 2);
  Dense of_chosen(N, J);
  for (int j = 0; j < J; ++j)
    std::copy_n(U.column(chosen[static_cast<std::size_t>(j)]), N, of_chosen.column(j));
  const Block Y = combine(space.V(), of_chosen);

  SharpResponse result{nullptr, plain, identity(N)};
  ProjectionRounding& rounding = result.rounding;
  /// UᵀAU, its plain sums replaced where accurate ones are known, and the weights with them.
  const auto projected = [&](int matrix, Mat a, const Dense& sums,
                             std::vector<double>& weights) {
    AccurateDense all{congruence(sums, U), Dense(N, N)};
    const AccurateProduct AY = multiply_accurately(a, Y, {.rest = true});
    const AccurateDense among = inner_accurately(Y, AY.product, AY.rest);
    const Dense with_all = multiply_transposed(U, inner(space.V(), AY.product));
    const std::vector<double> force = space.dual_weights(matrix, AY.product),
                              size = space.weights(matrix, Y);
    for (int j = 0; j < J; ++j) {
      const int column = chosen[static_cast<std::size_t>(j)];
      for (int i = 0; i < N; ++i) all.hi(i, column) = all.hi(column, i) = with_all(i, j);
    }
    for (int j = 0; j < J; ++j)
      for (int i = 0; i < J; ++i) {
        const int row = chosen[static_cast<std::size_t>(i)],
                  column = chosen[static_cast<std::size_t>(j)];
        const long double value = 0.5L * (static_cast<long double>(among.hi(i, j)) +
                                          static_cast<long double>(among.hi(j, i)) +
                                          static_cast<long double>(among.lo(i, j)) +
                                          static_cast<long double>(among.lo(j, i)));
        all.hi(row, column) = static_cast<double>(value);
        all.lo(row, column) =
            static_cast<double>(value - static_cast<long double>(all.hi(row, column)));
      }
    for (int j = 0; j < J; ++j) {
      const auto at = static_cast<std::size_t>(j);
      weights[static_cast<std::size_t>(chosen[at])] =
          std::sqrt(unit * force[at] * force[at] + twice * size[at] * size[at]);
    }
    for (int j = 0; j < N; ++j) // rigid modes are apart by definition
      for (int i = 0; i < N; ++i)
        if (i < rigid || j < rigid) all.hi(i, j) = all.lo(i, j) = 0;
    return all;
  };
  const AccurateDense K = projected(0, fom.K, space.K(), rounding.K),
                      M = projected(1, fom.M, space.M(), rounding.M);
  Dense D;
  if (fom.D) D = projected(2, fom.D, space.D(), rounding.D).hi;

  const auto elastic = [&](const Dense& a) {
    return part_of(a, rigid, count, rigid, count);
  };
  const Dense K_e = elastic(K.hi), M_e = elastic(M.hi);
  Dense E = K_e;
  for (std::size_t i = 0; i < E.data.size(); ++i) E.data[i] += tau * M_e.data[i];
  SymmetricEigen eigen = symmetric_eigen(M_e, E);
  share_from_first(fom.comm, eigen.values);
  share_from_first(fom.comm, eigen.vectors.data);
  std::vector<double> lambda(static_cast<std::size_t>(rigid), 0.0);
  for (int j = 0; j < count; ++j) {
    double* column = result.turned.column(rigid + j);
    std::fill_n(column, N, 0.0);
    std::copy_n(eigen.vectors.column(count - 1 - j), count, column + rigid);
    const double mu = eigen.values[static_cast<std::size_t>(count - 1 - j)];
    double value = mu > 0 ? 1 / mu - tau : std::numeric_limits<double>::infinity();
    if (value < 64 * tau)
      value = static_cast<double>(energy(K, column) / energy(M, column));
    lambda.push_back(value);
  }
  share_from_first(fom.comm, lambda);
  result.response = std::make_shared<DenseResponse>(
      response.system(), tau, multiply(U, result.turned), lambda,
      D.data.empty() ? Dense() : congruence(D, result.turned));
  for (auto* weights : {&rounding.K, &rounding.M, &rounding.D})
    *weights = turned_weights(result.turned, *weights);
  std::fill_n(rounding.K.begin(), rigid, 0.0);
  // K y was rounded once before it met the others; λ is rounded to a double.
  for (int j = rigid; j < N; ++j) {
    const auto at = static_cast<std::size_t>(j);
    const double l = lambda[at];
    rounding.lambda[at] =
        0.51 * epsilon *
        (std::isfinite(l) ? std::abs(l) * result.response->mu()[at] : 2.0);
  }
  const std::vector<double> k(lambda.size(), 1.0);
  rounding.mixed = std::max(beside_diagonal(congruence(K.hi, result.turned), k, rigid),
                            tau * beside_diagonal(congruence(M.hi, result.turned),
                                                  result.response->mu(), rigid));
  return result;
}

} // namespace flexgram
