#include "reduce/certificate.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numeric>

namespace flexgram {
namespace {

using Complex = std::complex<double>;
constexpr double infinity = std::numeric_limits<double>::infinity();

/// sup over λ in [first, ∞] of |(λ + τ)/(a_k λ + a_m) − c|: a quotient of two quadratic
/// polynomials in λ, whose stationary points are the roots of a third.
double largest_distance(Complex a_k, Complex a_m, double tau, double first, Complex c) {
  const auto square = [](Complex slope, Complex constant) {
    return std::array<double, 3>{
        std::norm(constant), 2 * (slope * std::conj(constant)).real(), std::norm(slope)};
  };
  const auto N = square(1.0 - c * a_k, tau - c * a_m), D = square(a_k, a_m);
  const auto value = [&](double l) {
    const double denominator = D[0] + l * (D[1] + l * D[2]);
    return denominator > 0 ? (N[0] + l * (N[1] + l * N[2])) / denominator : infinity;
  };
  double largest = std::max(value(first), N[2] / D[2]);
  const double a = N[2] * D[1] - N[1] * D[2], b = N[2] * D[0] - N[0] * D[2],
               e = N[1] * D[0] - N[0] * D[1], root = b * b - a * e; // aλ² + 2bλ + e = 0
  const auto stationary = [&](double l) {
    if (l > first) largest = std::max(largest, value(l));
  };
  if (a == 0 && b != 0) stationary(-e / (2 * b));
  if (a != 0 && root >= 0) {
    stationary((-b - std::sqrt(root)) / a);
    stationary((-b + std::sqrt(root)) / a);
  }
  return std::sqrt(std::max(largest, 0.0));
}

ComplexDense columns_of(const ComplexDense& a, const std::vector<int>& columns) {
  ComplexDense part(a.rows, static_cast<int>(columns.size()));
  for (std::size_t j = 0; j < columns.size(); ++j)
    std::copy_n(a.column(columns[j]), a.rows, part.column(static_cast<int>(j)));
  return part;
}

/// √Σ σ_i(A)² σ_i(B)², singular values in descending order.
double paired_norm(const ComplexDense& a, const ComplexDense& b) {
  const auto squares = [](const ComplexDense& w) {
    auto values = hermitian_eigenvalues(multiply_transposed(w, w, true));
    std::reverse(values.begin(), values.end());
    return values;
  };
  const auto alpha = squares(a), beta = squares(b);
  double sum = 0;
  for (std::size_t i = 0; i < std::min(alpha.size(), beta.size()); ++i)
    sum += std::max(alpha[i], 0.0) * std::max(beta[i], 0.0);
  return std::sqrt(sum);
}

/// A with each column multiplied.
void scale_columns(ComplexDense& a, const std::vector<double>& factors) {
  for (int j = 0; j < a.columns; ++j)
    for (int i = 0; i < a.rows; ++i) a(i, j) *= factors[static_cast<std::size_t>(j)];
}

/// An orthonormal basis of the columns of S: S combination, and the columns in it, from
/// SᵀS. Half the digits, which is enough: the error is the square of a residual.
struct Coordinates {
  Dense combination; ///< q×r
  Dense of_columns;  ///< r×q
};
Coordinates coordinates(MPI_Comm comm, const Basis& S) {
  const int q = static_cast<int>(S.columns());
  Dense gram = symmetric_inner(S, S);
  std::vector<double> size;
  for (int j = 0; j < q; ++j) size.push_back(std::sqrt(std::max(gram(j, j), 0.0)));
  for (int j = 0; j < q; ++j)
    for (int i = 0; i < q; ++i) {
      const double d =
          size[static_cast<std::size_t>(i)] * size[static_cast<std::size_t>(j)];
      gram(i, j) = d > 0 ? gram(i, j) / d : 0.0;
    }
  SymmetricEigen eigen = symmetric_eigen(gram);
  share_from_first(comm, eigen.values);
  share_from_first(comm, eigen.vectors.data);
  int r = 0;
  while (r < q && eigen.values[static_cast<std::size_t>(q - 1 - r)] >
                      1e-15 * q * eigen.values.back())
    ++r;
  Coordinates c{Dense(q, r), Dense(r, q)};
  for (int j = 0; j < r; ++j) {
    const double root = std::sqrt(eigen.values[static_cast<std::size_t>(q - 1 - j)]);
    for (int i = 0; i < q; ++i) {
      const double v = eigen.vectors(i, q - 1 - j), d = size[static_cast<std::size_t>(i)];
      c.combination(i, j) = d > 0 ? v / (root * d) : 0.0;
      c.of_columns(j, i) = root * v * d;
    }
  }
  return c;
}

/// ports − (a_k − κ a_m) K x − iω D x
ComplexDense residual_of(const Dense& ports, const Dense& K, const Dense& D, double kappa,
                         double omega, const ShiftCoefficients& c,
                         const ComplexDense& x) {
  ComplexDense r = multiply(K, x);
  const Complex factor = -(c.k - kappa * c.m);
  for (std::size_t i = 0; i < r.data.size(); ++i)
    r.data[i] = ports.data[i] + factor * r.data[i];
  if (!D.data.empty()) {
    const ComplexDense d = multiply(D, x);
    for (std::size_t i = 0; i < r.data.size(); ++i)
      r.data[i] -= Complex(0, omega) * d.data[i];
  }
  return r;
}

} // namespace

ResidualBasis residual_basis(MediumSpace& space, const DenseResponse& response,
                             const std::vector<double>& samples, int modes, double cutoff,
                             int most) {
  const bool damped = response.system().has_extra_damping();
  const int p = response.system().B.columns;
  ResidualBasis basis;
  if (space.residual().S) {
    // All that S spans stays: what is small in these residuals may not be in later ones.
    const MediumSpace::Residual& parts = space.residual();
    const Coordinates c = coordinates(space.fom().comm, parts.S);
    const auto in_range = [&](const Dense& a) {
      return a.data.empty() ? Dense() : multiply(c.of_columns, a);
    };
    space.compress_residual({combine(parts.S, c.combination), in_range(parts.B),
                             in_range(parts.K), in_range(parts.D)});
  }
  const MediumSpace::Residual& parts = space.residual();
  const int r = static_cast<int>(parts.S.columns());
  if (r == 0) {
    const SecondOrderModel& fom = space.fom();
    basis.T = Block(fom.comm, fom.rows, fom.n, 0);
    return basis;
  }
  basis.ports = parts.B;
  basis.K = multiply(parts.K, response.U());
  if (damped) {
    basis.D = multiply(parts.D, response.U());
    // (DΦ)_° = E U x + g, E = K + τM, with x = UᵀDΦ but for the rows of Φ, and the rest g
    // outside V.
    basis.damped_inside = first_columns(response.modal_damping(), modes);
    for (int j = 0; j < modes; ++j) {
      const double size = // U is normalised in E, modes in M
          1 / std::sqrt(response.mu()[static_cast<std::size_t>(j)]);
      for (int i = 0; i < basis.damped_inside.rows; ++i)
        basis.damped_inside(i, j) *= i < modes ? 0.0 : size;
    }
    basis.damped_outside = first_columns(basis.D, modes);
    const Dense taken = multiply(basis.K, basis.damped_inside);
    for (int j = 0; j < modes; ++j)
      for (int i = 0; i < r; ++i)
        basis.damped_outside(i, j) =
            basis.damped_outside(i, j) /
                std::sqrt(response.mu()[static_cast<std::size_t>(j)]) -
            (1 - space.kappa() * space.tau()) * taken(i, j);
  }

  // What the residuals are made of over the band, each frequency relative to its
  // response.
  Dense all(r, 2 * p * static_cast<int>(samples.size()));
  int next = 0;
  for (double omega : samples) {
    const ComplexDense x = response.modal_response(omega);
    const double size = std::sqrt(frobenius_norm(response.transfer(x)));
    const ComplexDense residual =
        residual_of(basis.ports, basis.K, basis.D, space.kappa(), omega,
                    response.system().coefficients(omega), x);
    for (int j = 0; j < p; ++j, next += 2)
      for (int i = 0; i < r && size > 0; ++i) {
        all(i, next) = residual(i, j).real() / size;
        all(i, next + 1) = residual(i, j).imag() / size;
      }
  }
  double largest = 0;
  for (double v : all.data) largest = std::max(largest, std::abs(v));
  // Residuals of the modes, so that angles above some 1e-6 are seen, and the dampers'
  // part.
  Dense of_modes = first_columns(basis.K, modes);
  for (int j = 0; j < modes; ++j) {
    const double lambda = response.lambda()[static_cast<std::size_t>(j)];
    for (int i = 0; i < r; ++i)
      of_modes(i, j) *=
          largest * (cutoff * cutoff + space.tau()) / (cutoff * cutoff - lambda);
  }
  all = beside(all, of_modes);
  if (damped) {
    double size = 0;
    for (double v : basis.damped_outside.data) size = std::max(size, std::abs(v));
    Dense scaled = basis.damped_outside;
    for (double& v : scaled.data) v *= size > 0 ? largest / size : 0.0;
    all = beside(all, scaled);
  }
  LeftSvd svd = left_svd(compressed(all));
  share_from_first(space.fom().comm, svd.values);
  share_from_first(space.fom().comm, svd.vectors.data);
  int k = 0;
  while (k < static_cast<int>(svd.values.size()) &&
         svd.values[static_cast<std::size_t>(k)] > 1e-7 * svd.values[0])
    ++k;
  basis.complete = k <= most;
  k = std::max(1, std::min(k, most));
  const auto total =
      std::inner_product(svd.values.begin(), svd.values.end(), svd.values.begin(), 0.0);
  const auto left = std::inner_product(svd.values.begin() + k, svd.values.end(),
                                       svd.values.begin() + k, 0.0);
  basis.remainder = total > 0 ? std::sqrt(left / total) : 0.0;

  const Dense u = first_columns(svd.vectors, k);
  const auto turn = [&](Dense& a) {
    if (!a.data.empty()) a = multiply_transposed(u, a);
  };
  turn(basis.ports);
  turn(basis.K);
  turn(basis.D);
  turn(basis.damped_outside);
  basis.T = combine(parts.S, u);
  space.unscale(basis.T);
  return basis;
}

Certificate::Certificate(const MediumSpace& space, const DenseResponse& response,
                         ResidualBasis basis, const Dense& gram, int modes, double cutoff,
                         std::vector<double> scale)
    : tau_(space.tau()), kappa_(space.kappa()), cutoff_squared_(cutoff * cutoff),
      rounding_(space.rounding()), remainder_(basis.remainder), scale_(std::move(scale)) {
  // Coordinates in which the Gram matrix is the identity: Γ = FᵀF.
  const SymmetricEigen eigen = symmetric_eigen(gram);
  Dense F = transpose(eigen.vectors);
  for (int j = 0; j < F.columns; ++j)
    for (int i = 0; i < F.rows; ++i)
      F(i, j) *= std::sqrt(std::max(eigen.values[static_cast<std::size_t>(i)], 0.0));
  const auto turned = [&](const Dense& a) {
    return a.data.empty() ? Dense() : multiply(F, a);
  };
  ports_ = turned(basis.ports);
  K_ = turned(basis.K);
  D_ = turned(basis.D);
  if (!basis.D.data.empty()) { // G = xᵀx + gᵀE⁻¹g
    const Dense outside = turned(basis.damped_outside);
    coupling_ = Dense(basis.damped_inside.rows + outside.rows, modes);
    set_part(coupling_, 0, 0, basis.damped_inside);
    set_part(coupling_, basis.damped_inside.rows, 0, outside);
    coupling_ = transpose(compressed(transpose(coupling_)));
  }
  const Dense& U = response.U();
  if (!coupling_.data.empty()) {
    const Dense Phi = first_columns(U, modes);
    mode_damping_ = multiply_transposed(Phi, multiply(space.D(), Phi));
    for (int j = 0; j < modes; ++j)
      for (int i = 0; i < modes; ++i)
        mode_damping_(i, j) /= std::sqrt(response.mu()[static_cast<std::size_t>(i)] *
                                         response.mu()[static_cast<std::size_t>(j)]);
  }
  if (space.rigid() > 0) {
    rigid_ = part_of(U, 0, space.rigid(), 0, U.columns);
    neglected_ = multiply(space.neglected(), U);
    geometric_ = space.rigid_modes_are_geometric();
  }
  for (int j = 0; j < modes; ++j) {
    const double lambda = response.lambda()[static_cast<std::size_t>(j)];
    double square = 0;
    for (int i = 0; i < K_.rows; ++i) square += K_(i, j) * K_(i, j);
    mode_lambda_.push_back(lambda);
    mode_angle_.push_back(j < space.rigid() ? 0.0
                                            : (1 + kappa_ * lambda) * std::sqrt(square) *
                                                  (cutoff_squared_ + tau_) /
                                                  (cutoff_squared_ - lambda));
  }
  const auto& weights = space.rounding_weights();
  for (int j = 0; j < U.columns; ++j) {
    double square = 0;
    for (int i = space.rigid(); i < U.rows; ++i)
      square += std::pow(U(i, j) * weights[static_cast<std::size_t>(i)], 2);
    rounding_weights_.push_back(std::sqrt(square));
  }
  rigid_weights_.assign(weights.begin(), weights.begin() + space.rigid());
}

double Certificate::worst_angle() const {
  return mode_angle_.empty() ? 0.0
                             : *std::max_element(mode_angle_.begin(), mode_angle_.end());
}

double Certificate::damping_coupling(double omega, const DenseSystem& system) const {
  const int count = coupling_.columns;
  const ShiftCoefficients c = system.coefficients(omega);
  ComplexDense A(count, count), right(count, coupling_.rows);
  for (std::size_t i = 0; i < A.data.size(); ++i) A.data[i] = c.d * mode_damping_.data[i];
  for (int i = 0; i < count; ++i)
    A(i, i) += c.k * mode_lambda_[static_cast<std::size_t>(i)] + c.m;
  for (int j = 0; j < right.columns; ++j)
    for (int i = 0; i < count; ++i) right(i, j) = coupling_(j, i);
  return omega * omega * frobenius_norm(multiply(coupling_, solve(std::move(A), right)));
}

std::vector<Certificate::Bound>
Certificate::at(double omega, const DenseResponse& response, const ComplexDense& x,
                const std::vector<PortSet>& blocks) const {
  const DenseSystem& system = response.system();
  const ShiftCoefficients c = system.coefficients(omega);
  ComplexDense w = residual_of(ports_, K_, D_, kappa_, omega, c, x);
  std::vector<double> unscale;
  for (double s : scale_) unscale.push_back(1 / s);
  scale_columns(w, unscale);
  // What T leaves out has at most the weight of T's own largest direction, ten times for
  // safety.
  const double extra = 10 * remainder_ * frobenius_norm(w);

  // Modes known to an angle θ let θ² of the residual through to their resonance; within a
  // cluster the angle is that of all of them.
  double angles = 0, leak = 0;
  for (double angle : mode_angle_) angles += angle * angle;
  for (std::size_t j = 0; j < mode_lambda_.size() && angles > 0; ++j) {
    const int i = static_cast<int>(j);
    const double a = std::abs(c.k * mode_lambda_[j] + c.m +
                              (mode_damping_.rows > 0 ? c.d * mode_damping_(i, i) : 0.0));
    leak = std::max(leak, angles * (a > 0 ? (mode_lambda_[j] + tau_) / a : infinity));
  }
  const bool extra_damping = system.has_extra_damping();
  double q = 0, radius = 0, delta = 0;
  Complex centre = 0;
  if (!extra_damping) {
    q = largest_distance(c.k, c.m, tau_, cutoff_squared_, 0.0);
    centre = 0.5 * ((cutoff_squared_ + tau_) / (c.k * cutoff_squared_ + c.m) + 1.0 / c.k);
    radius = largest_distance(c.k, c.m, tau_, cutoff_squared_, centre);
  } else {
    q = (cutoff_squared_ + tau_) / (cutoff_squared_ - omega * omega);
    delta = damping_coupling(omega, system);
  }
  // First-order arguments carry this far.
  const bool sound = leak < 0.1 * q && remainder_ < 1e-6;

  ComplexDense motion, force;
  if (rigid_.rows > 0) {
    motion = multiply(rigid_, x);
    force = multiply(neglected_, x);
  }
  // Roundings are random: their squares add up.
  const auto rounded = [&](const std::vector<int>& columns,
                           const ComplexDense& response_x,
                           const std::vector<double>& weights) {
    double sum = 0;
    for (int j : columns)
      for (int i = 0; i < response_x.rows; ++i)
        sum += std::norm(weights[static_cast<std::size_t>(i)] * response_x(i, j)) /
               std::pow(scale_[static_cast<std::size_t>(j)], 2);
    return std::sqrt(sum);
  };
  const auto size_of = [&](const ComplexDense& columns, const std::vector<int>& ports) {
    double sum = 0;
    for (int j : ports)
      for (int i = 0; i < columns.rows; ++i)
        sum += std::norm(columns(i, j) * unscale[static_cast<std::size_t>(j)]);
    return std::sqrt(sum);
  };

  std::vector<Bound> bounds;
  for (const auto& [inputs, outputs] : blocks) {
    const bool same = inputs == outputs;
    const ComplexDense w_in = columns_of(w, inputs);
    const ComplexDense w_out = same ? ComplexDense() : columns_of(w, outputs);
    const ComplexDense& w_c = same ? w_in : w_out;
    double paired = same ? frobenius_norm(multiply_transposed(w_in, w_in, true))
                         : paired_norm(w_c, w_in);
    const double added =
        extra > 0 ? extra * (frobenius_norm(w_c) + frobenius_norm(w_in) + extra) : 0.0;
    paired += added;

    Bound bound;
    if (!extra_damping) {
      const double known = frobenius_norm(multiply_transposed(w_c, w_in)) + added;
      bound.error = std::min(q * paired, std::abs(centre) * known + radius * paired);
    } else {
      bound.proved = q * delta < 1;
      bound.error = paired * (bound.proved ? 1 / (1 / q - delta) : q);
    }
    bound.error += leak * paired;
    bound.proved = bound.proved && sound;

    const double in = rounded(inputs, x, rounding_weights_),
                 out = rounded(outputs, x, rounding_weights_);
    bound.floor = 4 * rounding_ * in * out;
    if (rigid_.rows > 0) // between rigid and elastic motion; among rigid ones K is zero
      bound.floor += (geometric_ ? 4 : 200) * rounding_ *
                         (rounded(inputs, motion, rigid_weights_) * out +
                          in * rounded(outputs, motion, rigid_weights_)) +
                     size_of(motion, outputs) * size_of(force, inputs) +
                     size_of(force, outputs) * size_of(motion, inputs);
    bounds.push_back(bound);
  }
  return bounds;
}

} // namespace flexgram
