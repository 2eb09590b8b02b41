#include "medium/projection_rounding.hpp"

#include "base/index.hpp"

#include <algorithm>
#include <limits>

namespace flexgram {
namespace {

constexpr double epsilon = std::numeric_limits<double>::epsilon();

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

EntryRounding of_plain_sums(std::vector<double> weights) {
  const std::vector<double> none(weights.size(), 0.0);
  return {std::move(weights), none, none};
}

} // namespace

std::vector<double> turned_weights(const Dense& U, const std::vector<double>& w) {
  std::vector<double> result;
  for (int j = 0; j < U.columns; ++j) {
    double sum = 0;
    for (int k = 0; k < U.rows; ++k) sum += std::abs(U(k, j)) * w[as_size(k)];
    result.push_back(sum);
  }
  return result;
}

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

double ProjectionRounding::of_response(double a_k, const std::vector<double>& of_terms,
                                       double omega, const Sizes& outputs,
                                       const Sizes& inputs) const {
  const double square = omega * omega;
  const auto apart = as_size(rigid);
  double sum =
      a_k * K.form(outputs, inputs, apart) + square * M.form(outputs, inputs, apart);
  for (std::size_t t = 0; t < terms.size(); ++t)
    sum += of_terms[t] * terms[t].form(outputs, inputs, 0);
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
  for (std::size_t i = 0; i < as_size(rigid); ++i) {
    out += outputs[i] * outputs[i];
    in += inputs[i] * inputs[i];
  }
  return omega * omega * rigid_mass * std::sqrt(out * in);
}

ProjectionRounding::Sizes ProjectionRounding::of_equations(double a_k, double omega,
                                                           const Sizes& x) const {
  const Sizes of_K = K.times(x), of_M = M.times(x); // the field has no claim with terms
  double all = 0;
  for (double each : x) all += each;
  const double square = omega * omega;
  Sizes result;
  for (std::size_t i = 0; i < x.size(); ++i)
    result.push_back(a_k * (of_K[i] + lambda[i] * x[i]) + square * of_M[i] +
                     (a_k + square / tau) * mixed * (all - x[i]));
  return result;
}

std::array<std::vector<double>, 2> ProjectionRounding::row_sums() const {
  const Sizes ones(lambda.size(), 1.0);
  std::array<std::vector<double>, 2> sums{K.times(ones), M.times(ones)};
  for (std::size_t i = 0; i < lambda.size(); ++i) {
    const bool is_rigid = i < as_size(rigid);
    const double beside = is_rigid ? 0.0 : mixed * static_cast<double>(lambda.size());
    sums[0][i] = is_rigid ? 0.0 : sums[0][i] + lambda[i] + beside;
    sums[1][i] += beside / tau + (is_rigid ? rigid_mass * rigid : 0.0);
  }
  return sums;
}

bool ProjectionRounding::fits(int order, int ports_count, std::size_t terms_count) const {
  const auto holds = [](const std::vector<double>& v, int count) {
    return v.size() == as_size(count);
  };
  const auto is_whole = [&](const EntryRounding& of) {
    return holds(of.plain, order) && holds(of.force, order) && holds(of.sharp, order);
  };
  if (!is_whole(K) || !is_whole(M) || terms.size() != terms_count ||
      !std::all_of(terms.begin(), terms.end(), is_whole))
    return false;
  return holds(lambda, order) && holds(strain, order) && ports.rows == order &&
         ports.columns == ports_count && rigid >= 0 && rigid <= order;
}

double ProjectionRounding::of_ports(std::size_t i, const std::vector<int>& some,
                                    const std::vector<double>& scale) const {
  double square = 0;
  for (int j : some) {
    const double here = ports(static_cast<int>(i), j) / scale[as_size(j)];
    square += here * here;
  }
  return std::sqrt(square);
}

void ProjectionRounding::take_mixed(const Dense& of_K, const Dense& of_M, int first,
                                    double added) {
  mixed = mixed_norm = 0;
  const auto take = [&](const Dense& a, double factor) {
    double square = 0;
    for (int j = first; j < a.columns; ++j)
      for (int i = first; i < a.rows; ++i) {
        if (i == j) continue;
        mixed = std::max(mixed, factor * std::abs(a(i, j)));
        square += a(i, j) * a(i, j);
      }
    mixed_norm = std::max(mixed_norm, factor * std::sqrt(square));
  };
  take(of_K, 1);
  take(of_M, tau);
  mixed += added;
  mixed_norm += added * of_K.columns;
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
    const auto at = as_size(j);
    const bool apart = j < rigid; // ports of rigid modes: with their mass
    for (int p = 0; !apart && p < result.ports.columns; ++p)
      result.ports(j, p) = unit * std::sqrt(k[at] * k[at] + space.tau() * m[at] * m[at]) *
                           sizes[as_size(p)];
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
  for (const auto& of_term : sums.terms)
    result.terms.push_back(of_plain_sums(scaled(turned_weights(U, of_term), root)));
  // Of (K + τM)-normalised rigid modes.
  result.rigid_mass = (space.rigid_mass_deviation() + 3 * epsilon) / space.tau();
  return result;
}

} // namespace

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
      const auto at = as_size(j);
      const double lambda = response.lambda()[at], mu = response.mu()[at],
                   share = std::abs(forces(r, j)) /
                           (std::isfinite(lambda) ? lambda * mu : 1.0),
                   in_M = std::sqrt(share * mu);
      for (int p = 0; p < ports.columns; ++p)
        rounding.ports(r, p) += share * std::abs(ports(j, p));
      for (int mode : {r, j}) {
        double& sharp = rounding.M.sharp[as_size(mode)];
        sharp = std::max(sharp, in_M);
      }
    }
}

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
  result.take_mixed(turn(space.K()), turn(space.M()), space.rigid(), dense);
  add_null_vectors(result, space, response);
  return result;
}

} // namespace flexgram
