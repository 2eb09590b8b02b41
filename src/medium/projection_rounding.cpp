#include "medium/projection_rounding.hpp"

#include "linalg/accurate_inner.hpp"
#include "linalg/last_turn.hpp"
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

std::vector<double> scaled(std::vector<double> values, double factor) {
  for (double& v : values) v *= factor;
  return values;
}

double scalar(const std::vector<double>& a, const std::vector<double>& b,
              std::size_t first) {
  double sum = 0;
  for (std::size_t i = first; i < a.size(); ++i) sum += a[i] * b[i];
  return sum;
}

EntryRounding turned(const EntryRounding& rounding, const Dense& Q) {
  return {turned_weights(Q, rounding.plain), turned_weights(Q, rounding.force),
          turned_weights(Q, rounding.sharp)};
}

std::vector<double> added(std::vector<double> a, const std::vector<double>& b) {
  for (std::size_t i = 0; i < a.size(); ++i) a[i] += b[i];
  return a;
}

/// s with |A_ij| ε/2 <= s_i s_j: by the diagonal where A is positive semidefinite, as far as one
/// sees.
std::vector<double> rounding_to_doubles(const Dense& a) {
  const auto root = [&](int j) { return std::sqrt(std::max(a(j, j), 0.0)); };
  bool semidefinite = true;
  std::vector<double> largest(static_cast<std::size_t>(a.rows), 0.0), result;
  for (int j = 0; j < a.columns; ++j)
    for (int i = 0; i < a.rows; ++i) {
      double& here = largest[static_cast<std::size_t>(i)];
      here = std::max(here, std::abs(a(i, j)));
      semidefinite = semidefinite && std::abs(a(i, j)) <= 1.01 * root(i) * root(j);
    }
  for (int j = 0; j < a.columns; ++j)
    result.push_back(
        std::sqrt(0.52 * epsilon *
                  (semidefinite ? a(j, j) : largest[static_cast<std::size_t>(j)])));
  return result;
}

EntryRounding of_plain_sums(std::vector<double> weights) {
  const std::vector<double> none(weights.size(), 0.0);
  return {std::move(weights), none, none};
}

/// Entries beside the diagonal of an elastic part: the largest, and their norm.
struct Beside {
  double largest = 0, norm = 0;

  void take(const Dense& a, double factor, int first) {
    double square = 0;
    for (int j = first; j < a.columns; ++j)
      for (int i = first; i < a.rows; ++i) {
        if (i == j) continue;
        largest = std::max(largest, factor * std::abs(a(i, j)));
        square += a(i, j) * a(i, j);
      }
    norm = std::max(norm, factor * std::sqrt(square));
  }
  void add(double rounding, int order) {
    largest += rounding;
    norm += rounding * order;
  }
};

} // namespace

double EntryRounding::form(const std::vector<double>& x, const std::vector<double>& y,
                           std::size_t first) const {
  const double plain_x = scalar(plain, x, first), plain_y = scalar(plain, y, first);
  return plain_x * plain_y + plain_x * scalar(force, y, first) +
         scalar(force, x, first) * plain_y +
         scalar(sharp, x, first) * scalar(sharp, y, first);
}

std::vector<double> EntryRounding::times(const std::vector<double>& x) const {
  const double of_plain = scalar(plain, x, 0), of_force = scalar(force, x, 0),
               of_sharp = scalar(sharp, x, 0);
  std::vector<double> result;
  for (std::size_t i = 0; i < x.size(); ++i)
    result.push_back(plain[i] * (of_plain + of_force) + force[i] * of_plain +
                     sharp[i] * of_sharp);
  return result;
}

double ProjectionRounding::of_response(double a_k, double omega, const Sizes& outputs,
                                       const Sizes& inputs) const {
  const double square = omega * omega;
  const auto apart = static_cast<std::size_t>(rigid);
  double sum = a_k * K.form(outputs, inputs, apart) +
               square * M.form(outputs, inputs, apart) +
               omega * D.form(outputs, inputs, 0);
  double all_out = 0, all_in = 0, same = 0, out_square = 0, in_square = 0;
  for (std::size_t i = apart; i < lambda.size(); ++i) {
    all_out += outputs[i];
    all_in += inputs[i];
    same += outputs[i] * inputs[i];
    out_square += outputs[i] * outputs[i];
    in_square += inputs[i] * inputs[i];
    sum += a_k * lambda[i] * outputs[i] * inputs[i];
  }
  sum += (a_k + square / tau) * std::min(mixed * std::max(all_out * all_in - same, 0.0),
                                         mixed_norm * std::sqrt(out_square * in_square));
  if (rigid == 0) return sum;
  // Of rigid with elastic modes.
  const auto of = [&](const std::vector<double>& w, const Sizes& x, bool is_rigid) {
    double part = 0;
    for (std::size_t i = is_rigid ? 0 : apart; i < (is_rigid ? apart : w.size()); ++i)
      part += w[i] * x[i];
    return part;
  };
  const auto across = [&](const Sizes& x, const Sizes& y) { // rigid x, elastic y
    return of(M.plain, x, true) * (of(M.plain, y, false) + of(M.force, y, false)) +
           of(M.force, x, true) * of(M.plain, y, false) +
           of(M.sharp, x, true) * of(M.sharp, y, false);
  };
  return sum + square * (across(outputs, inputs) + across(inputs, outputs));
}

double ProjectionRounding::of_rigid_modes(double omega, const Sizes& outputs,
                                          const Sizes& inputs) const {
  double out = 0, in = 0;
  for (std::size_t i = 0; i < static_cast<std::size_t>(rigid); ++i) {
    out += outputs[i] * outputs[i];
    in += inputs[i] * inputs[i];
  }
  return omega * omega * rigid_mass * std::sqrt(out * in);
}

ProjectionRounding::Sizes ProjectionRounding::of_equations(double a_k, double omega,
                                                           const Sizes& x) const {
  const Sizes of_K = K.times(x), of_M = M.times(x), of_D = D.times(x);
  double all = 0;
  for (double each : x) all += each;
  const double square = omega * omega;
  Sizes result;
  for (std::size_t i = 0; i < x.size(); ++i)
    result.push_back(a_k * (of_K[i] + lambda[i] * x[i]) + square * of_M[i] +
                     omega * of_D[i] + (a_k + square / tau) * mixed * (all - x[i]));
  return result;
}

std::array<std::vector<double>, 2> ProjectionRounding::row_sums() const {
  const Sizes ones(lambda.size(), 1.0);
  std::array<std::vector<double>, 2> sums{K.times(ones), M.times(ones)};
  for (std::size_t i = 0; i < lambda.size(); ++i) {
    const bool is_rigid = i < static_cast<std::size_t>(rigid);
    const double beside = is_rigid ? 0.0 : mixed * static_cast<double>(lambda.size());
    sums[0][i] = is_rigid ? 0.0 : sums[0][i] + lambda[i] + beside;
    sums[1][i] += beside / tau + (is_rigid ? rigid_mass * rigid : 0.0);
  }
  return sums;
}

bool ProjectionRounding::fits(int order, int ports_count) const {
  const auto holds = [](const std::vector<double>& v, int count) {
    return v.size() == static_cast<std::size_t>(count);
  };
  for (const EntryRounding* of : {&K, &M, &D})
    if (!holds(of->plain, order) || !holds(of->force, order) || !holds(of->sharp, order))
      return false;
  return holds(lambda, order) && holds(strain, order) && ports.rows == order &&
         ports.columns == ports_count && rigid >= 0 && rigid <= order;
}

namespace {

/// @param dense  what a plain product of small matrices adds to the rounding of a sum.
ProjectionRounding rounding_with(const MediumSpace& space, const DenseResponse& response,
                                 const Block& loads, double dense) {
  const MediumSpace::Rounding& sums = space.rounding_of_sums();
  const Dense& U = response.U();
  const int N = U.columns, rigid = space.rigid();
  const double unit = sums.unit + dense, root = std::sqrt(unit), kappa = space.kappa();
  ProjectionRounding result;
  result.rigid = rigid;
  result.tau = space.tau();
  const std::vector<double> k = turned_weights(U, sums.K), m = turned_weights(U, sums.M);
  std::vector<double> of_K, of_M;
  const std::vector<double> sizes = space.dual_weights_of_ports(loads);
  result.ports = Dense(N, static_cast<int>(sizes.size()));
  for (int j = 0; j < N; ++j) {
    const auto at = static_cast<std::size_t>(j);
    const bool apart = j < rigid; // ports of rigid modes: with their mass
    for (int p = 0; !apart && p < result.ports.columns; ++p)
      result.ports(j, p) = unit * std::sqrt(k[at] * k[at] + space.tau() * m[at] * m[at]) *
                           sizes[static_cast<std::size_t>(p)];
    of_M.push_back(root * std::sqrt(m[at] * m[at] + 2 * kappa * k[at] * k[at]));
    of_K.push_back(apart ? 0.0 : root * k[at]);
    // Rigid modes are columns of V, others are combinations.
    result.strain.push_back((apart ? 1 : N + 2) * epsilon * k[at]);
    const double lambda = response.lambda()[at];
    result.lambda.push_back(apart ? 0.0
                                  : epsilon * std::abs(std::isfinite(lambda)
                                                           ? lambda * response.mu()[at]
                                                           : 1.0));
  }
  result.K = of_plain_sums(std::move(of_K));
  result.M = of_plain_sums(std::move(of_M));
  result.D = of_plain_sums(scaled(turned_weights(U, sums.D), root));
  // Of (K + τM)-normalised rigid modes.
  result.rigid_mass = (space.rigid_mass_deviation() + 3 * epsilon) / space.tau();
  return result;
}

/// Null vectors φ of K differ from those of the stored numbers by δ, Kδ = Kφ: of an elastic mode
/// u they hold uᵀKφ/uᵀKu, which shows in their ports and in M.
void add_null_vectors(ProjectionRounding& rounding, const MediumSpace& space,
                      const DenseResponse& response) {
  const int rigid = space.rigid(), N = response.U().columns;
  if (space.geometric() == rigid) return;
  const Dense& U = response.U();
  const Dense forces =
      multiply_transposed(part_of(U, 0, rigid, 0, rigid),
                          multiply(space.rigid_stiffness(), U)); // UᵀVᵀKVU of rigid rows
  const Dense& ports = response.modal_inputs();
  for (int r = space.geometric(); r < rigid; ++r)
    for (int j = rigid; j < N; ++j) {
      const auto at = static_cast<std::size_t>(j);
      const double lambda = response.lambda()[at], mu = response.mu()[at],
                   share = std::abs(forces(r, j)) /
                           (std::isfinite(lambda) ? lambda * mu : 1.0),
                   in_M = std::sqrt(share * mu);
      for (int p = 0; p < ports.columns; ++p)
        rounding.ports(r, p) += share * std::abs(ports(j, p));
      for (int mode : {r, j}) {
        double& sharp = rounding.M.sharp[static_cast<std::size_t>(mode)];
        sharp = std::max(sharp, in_M);
      }
    }
}

} // namespace

ProjectionRounding rounding_of_sums(const MediumSpace& space,
                                    const DenseResponse& response, const Block& loads) {
  return rounding_with(space, response, loads, 0);
}

ProjectionRounding plain_rounding(const MediumSpace& space, const DenseResponse& response,
                                  const Block& loads) {
  const Dense& U = response.U();
  const double dense = 2 * epsilon * (U.columns + 2);
  ProjectionRounding result = rounding_with(space, response, loads, dense);
  const auto turn = [&](const Dense& a) {
    return multiply_transposed(U, multiply(a, U));
  };
  Beside beside;
  beside.take(turn(space.K()), 1, space.rigid());
  beside.take(turn(space.M()), space.tau(), space.rigid());
  beside.add(dense, U.columns);
  result.mixed = beside.largest;
  result.mixed_norm = beside.norm;
  add_null_vectors(result, space, response);
  return result;
}

SharpResponse sharpened(const MediumSpace& space, const DenseResponse& response,
                        const ProjectionRounding& sums, const Block& loads,
                        const SharpSums& chosen) {
  const Dense& U = response.U();
  const SecondOrderModel& fom = space.fom();
  const int N = U.columns, rigid = space.rigid(), count = N - rigid;
  const double tau = space.tau(),
               // of an entry, with the rounding to a double
      unit = space.rounding_of_sums().unit + epsilon,
               twice = epsilon * (static_cast<double>(fom.n) + 1e3);
  const auto vectors = [&](const std::vector<int>& some) {
    return some.empty() ? Block() : combine(space.V(), columns_of(U, some));
  };
  const Block Y_K = vectors(chosen.K), Y_M = vectors(chosen.M);

  SharpResponse result{nullptr, sums, identity(N)};
  ProjectionRounding& rounding = result.rounding;
  /// UᵀAU, its plain sums replaced where accurate ones are known, and its rounding with them.
  const auto projected = [&](int matrix, Mat a, const Dense& plain, EntryRounding& of) {
    Congruence product = congruence({plain, Dense(N, N)}, U);
    AccurateDense& all = product.product;
    of.sharp = std::move(product.rounding);
    const std::vector<int>& modes = matrix == 1 ? chosen.M : chosen.K;
    const Block& Y = matrix == 1 ? Y_M : Y_K;
    const int J = static_cast<int>(modes.size());
    if (J == 0) return all;
    const AccurateProduct AY = multiply_accurately(a, Y, {.rest = true});
    const AccurateDense among = inner_accurately(Y, AY.product, AY.rest, Triangle::upper);
    const AccurateDense with_all =
        multiply_accurately(transpose(U), inner(space.V(), AY.product));
    const std::vector<double> force = space.dual_weights(matrix, AY.product),
                              size = space.weights(matrix, Y);
    for (int j = 0; j < J; ++j) {
      const int column = modes[static_cast<std::size_t>(j)];
      for (int i = 0; i < N; ++i) {
        all.hi(i, column) = all.hi(column, i) = with_all.hi(i, j);
        all.lo(i, column) = all.lo(column, i) = with_all.lo(i, j);
      }
    }
    for (int j = 0; j < J; ++j)
      for (int i = 0; i < J; ++i) {
        const int row = modes[static_cast<std::size_t>(i)],
                  column = modes[static_cast<std::size_t>(j)];
        all.hi(row, column) = among.hi(i, j);
        all.lo(row, column) = among.lo(i, j);
      }
    for (int j = 0; j < J; ++j) {
      const auto at = static_cast<std::size_t>(j),
                 mode = static_cast<std::size_t>(modes[at]);
      of.plain[mode] = 0;
      of.force[mode] = std::sqrt(unit) * force[at];
      of.sharp[mode] += twice * size[at];
    }
    return all;
  };
  AccurateDense K = projected(0, fom.K, space.K(), rounding.K),
                M = projected(1, fom.M, space.M(), rounding.M), D;
  if (fom.D) D = projected(2, fom.D, space.D(), rounding.D);
  for (int j = 0; j < N; ++j) // rigid modes are apart by definition
    for (int i = 0; i < N; ++i) {
      if (i < rigid || j < rigid) K.hi(i, j) = K.lo(i, j) = 0;
      if (i < rigid && j < rigid) M.hi(i, j) = M.lo(i, j) = 0;
    }
  for (int j = 0; j < rigid; ++j) M.hi(j, j) = 1 / tau;

  const auto elastic = [&](const Dense& a) {
    return part_of(a, rigid, count, rigid, count);
  };
  const Dense M_e = elastic(M.hi);
  Dense E = elastic(K.hi);
  add_to(E, M_e, tau);
  SymmetricEigen eigen = symmetric_eigen(M_e, E);
  share_from_first(fom.comm, eigen.values);
  share_from_first(fom.comm, eigen.vectors.data);
  for (int j = 0; j < count; ++j) {
    double* column = result.turned.column(rigid + j);
    std::fill_n(column, N, 0.0);
    std::copy_n(eigen.vectors.column(count - 1 - j), count, column + rigid);
  }
  for (EntryRounding* of : {&rounding.K, &rounding.M, &rounding.D})
    *of = turned(*of, result.turned);
  const auto turn = [&](AccurateDense& a, EntryRounding& of) {
    Congruence product = congruence(a, result.turned);
    a = std::move(product.product);
    of.sharp = added(of.sharp, product.rounding);
  };
  turn(K, rounding.K);
  turn(M, rounding.M);
  if (fom.D) turn(D, rounding.D);
  // The first turn is rounded to doubles; the last one is no longer in U, but in what follows.
  const LastTurn last = last_turn(K.hi, M.hi);
  const Dense& Z = last.Z;
  const auto diagonal = [](const AccurateDense& a, int j) {
    return static_cast<long double>(a.hi(j, j)) + static_cast<long double>(a.lo(j, j));
  };
  std::vector<double> lambda(static_cast<std::size_t>(rigid), 0.0);
  std::vector<long double> scale(static_cast<std::size_t>(rigid), 1.0L);
  for (int j = rigid; j < N; ++j) {
    const long double k = diagonal(K, j), m = diagonal(M, j);
    const bool massless = !(static_cast<long double>(tau) * m > 1e-14L * k);
    lambda.push_back(massless ? std::numeric_limits<double>::infinity()
                              : static_cast<double>(k / m));
    // Modes need not have an energy of exactly one: their ports make up for it.
    scale.push_back(1 / std::sqrt(k + static_cast<long double>(tau) * std::max(m, 0.0L)));
  }

  // Ports, of the chosen vectors by accurate sums.
  AccurateDense ports = multiply_accurately(transpose(U), response.system().B);
  if (Y_K) {
    const AccurateDense of_chosen = inner_accurately(Y_K, loads, Block());
    for (std::size_t j = 0; j < chosen.K.size(); ++j)
      for (int p = 0; p < ports.hi.columns; ++p) {
        ports.hi(chosen.K[j], p) = of_chosen.hi(static_cast<int>(j), p);
        ports.lo(chosen.K[j], p) = of_chosen.lo(static_cast<int>(j), p);
        rounding.ports(chosen.K[j], p) = 0;
      }
  }
  const Dense turned_back = transpose(result.turned);
  AccurateDense in_modes = multiply_accurately(turned_back, ports.hi);
  add_to(in_modes.lo, multiply(turned_back, ports.lo));
  add_to(in_modes.lo, multiply_transposed(Z, in_modes.hi));
  if (fom.D) { // (I + Z)ᵀD(I + Z), rounded to doubles
    add_to(D.hi, multiply(D.hi, Z));
    add_to(D.hi, multiply_transposed(Z, D.hi));
    rounding.D.sharp = added(rounding.D.sharp, rounding_to_doubles(D.hi));
  }
  Dense B(N, ports.hi.columns);
  for (int p = 0; p < B.columns; ++p)
    for (int j = 0; j < N; ++j)
      B(j, p) = static_cast<double>((static_cast<long double>(in_modes.hi(j, p)) +
                                     static_cast<long double>(in_modes.lo(j, p))) *
                                    scale[static_cast<std::size_t>(j)]);

  for (auto* values : {&lambda, &B.data}) share_from_first(fom.comm, *values);
  result.response =
      std::make_shared<DenseResponse>(response.system(), tau, multiply(U, result.turned),
                                      lambda, std::move(B), std::move(D.hi));

  const Dense sizes = absolute(result.turned), by_last = absolute(Z);
  rounding.strain = turned_weights(result.turned, rounding.strain);
  for (int j = rigid; j < N; ++j) // modes have a strain energy of one at most
    for (int i = rigid; i < N; ++i)
      rounding.strain[static_cast<std::size_t>(j)] += by_last(i, j);
  rounding.ports = multiply_transposed(sizes, rounding.ports);
  for (int p = 0; p < rounding.ports.columns; ++p)
    for (int j = rigid; j < N; ++j)
      rounding.ports(j, p) +=
          0.8 * epsilon * std::abs(result.response->modal_inputs()(j, p));
  for (auto* of : {&rounding.K.plain, &rounding.K.force, &rounding.K.sharp})
    std::fill_n(of->begin(), rigid, 0.0);
  for (int j = rigid; j < N; ++j) {
    const auto at = static_cast<std::size_t>(j);
    const double l = lambda[at];
    rounding.lambda[at] =
        0.51 * epsilon *
            (std::isfinite(l) ? std::abs(l) * result.response->mu()[at] : 2.0) +
        last.rest_K(j, j);
    rounding.M.sharp[at] += std::sqrt(last.rest_M(j, j));
  }
  for (int j = rigid; j < N; ++j) // `mixed` is of elastic modes
    for (int i = 0; i < rigid; ++i)
      for (int mode : {i, j}) {
        double& sharp = rounding.M.sharp[static_cast<std::size_t>(mode)];
        sharp = std::max(sharp, std::sqrt(last.rest_M(i, j)));
      }
  Beside beside;
  beside.take(last.rest_K, 1, 0);
  beside.take(last.rest_M, tau, 0);
  rounding.mixed = beside.largest;
  rounding.mixed_norm = beside.norm;
  add_null_vectors(rounding, space, *result.response);
  return result;
}

} // namespace flexgram
