#include "medium/cell_region.hpp"

#include "linalg/decompositions.hpp"

#include <algorithm>
#include <cmath>

namespace flexgram {
namespace {

/// K, M and terms of the system between two bases.
Matrices between(const Dense& left, const DenseSystem& system, const Dense& right) {
  Matrices all{multiply_transposed(left, multiply(system.K, right)),
               multiply_transposed(left, multiply(system.M, right))};
  for (const auto& [law, T] : system.terms)
    all.push_back(multiply_transposed(left, multiply(T, right)));
  return all;
}

/// The real part of A, without terms that are no parameters, with values of these.
Dense stiffness(const DenseSystem& system, const std::vector<double>& values,
                double omega, double tau = 0) {
  Dense E = system.K;
  add_to(E, system.M, tau - omega * omega);
  std::size_t parameter = 0;
  for (const auto& [law, T] : system.terms)
    if (law.is_parameter())
      add_to(E, T, law.with("value", values[parameter++]).at(omega).real());
  return E;
}

/// Near `last`, and apart from the resonances of the space Q, relative to these.
double frequency_apart(const MediumModel& medium, const Dense& Q,
                       const std::vector<double>& values, double last) {
  const DenseSystem& system = medium.system;
  Dense stiff = stiffness(system, values, 0, medium.tau);
  stiff = multiply_transposed(Q, multiply(stiff, Q));
  Dense mass = multiply_transposed(Q, multiply(system.M, Q));
  for (Dense* a : {&stiff, &mass}) symmetrise(*a);
  const std::vector<double> mu = symmetric_eigen(mass, stiff).values;
  constexpr double enough = 0.05;
  double best = last, farthest = 0;
  for (double omega = last; omega > 0.6 * last; omega -= 0.01 * last) {
    double nearest = 1; // |1 − (ω² + τ)/(λ + τ)|
    for (double m : mu)
      nearest = std::min(nearest, std::abs(1 - m * (omega * omega + medium.tau)));
    if (!(nearest > farthest)) continue;
    farthest = nearest;
    best = omega;
    if (farthest > enough) break;
  }
  return best;
}

/// Orthonormal, beside the columns of Q, which are so too: I − QQᵀ has eigenvalues 0, as many as Q
/// has columns, and 1.
Dense complement(const Dense& Q) {
  Dense projector = identity(Q.rows);
  add_to(projector, outer_square(Q), -1);
  const SymmetricEigen eigen = symmetric_eigen(std::move(projector));
  return part_of(eigen.vectors, 0, Q.rows, Q.columns, Q.rows - Q.columns);
}

/// Q and those modes of V up to some frequency, with some values, that it does not hold.
Dense with_modes(const MediumModel& medium, const Dense& Q,
                 const std::vector<std::vector<double>>& all_values, double last) {
  constexpr double held = 0.01; // the sine of the angle
  const DenseSystem& system = medium.system;
  Dense space = Q;
  for (const auto& values : all_values) {
    const SymmetricEigen modes =
        symmetric_eigen(system.M, stiffness(system, values, 0, medium.tau));
    for (std::size_t j = modes.values.size(); j-- > 0;) { // 1/(λ + τ) ascending
      if (!(modes.values[j] * (last * last + medium.tau) > 1)) break;
      const Dense mode = part_of(modes.vectors, 0, Q.rows, static_cast<int>(j), 1);
      Dense left = mode;
      for (int twice = 0; twice < 2; ++twice)
        add_to(left, multiply(space, multiply_transposed(space, left)), -1);
      const double size = frobenius_norm(left);
      if (!(size > held * frobenius_norm(mode)) || space.columns + 1 >= Q.rows) continue;
      for (double& x : left.data) x /= size;
      space = beside(space, left);
    }
  }
  return space;
}

} // namespace

CellRegion::CellRegion(const MediumModel& medium, const Dense& small,
                       const Certificate::Couplings& couplings, const Cell& region) {
  const DenseSystem& system = medium.system;
  std::vector<double> softest, middle, stiffest;
  for (const Interval& values : region.values) {
    softest.push_back(values.first);
    middle.push_back(values.centre());
    stiffest.push_back(values.last);
  }
  const Dense Q = with_modes(medium, small, {middle, softest, stiffest},
                             1.3 * region.omega.last),
              beyond = complement(Q);
  // A space orthogonal to Q by the stiffness at a frequency apart from the resonances of Q, so that
  // little couples both; with coordinates where E is I and A is about diagonal.
  const Dense E = stiffness(system, softest, region.omega.last),
              at_middle = stiffness(system, middle, region.omega.centre()),
              EQ = multiply(
                  stiffness(system, softest,
                            frequency_apart(medium, Q, softest, region.omega.last)),
                  Q);
  Dense QEQ = multiply_transposed(Q, EQ);
  symmetrise(QEQ);
  const SymmetricEigen of_Q = symmetric_eigen(QEQ);
  Dense shares = multiply_transposed(of_Q.vectors, multiply_transposed(EQ, beyond));
  for (int j = 0; j < shares.columns; ++j)
    for (int i = 0; i < shares.rows; ++i) shares(i, j) /= of_Q.values[as_size(i)];
  Dense Z = beyond;
  add_to(Z, multiply(Q, multiply(of_Q.vectors, shares)), -1);
  Dense of_E = multiply_transposed(Z, multiply(E, Z)),
        of_A = multiply_transposed(Z, multiply(at_middle, Z));
  symmetrise(of_E);
  symmetrise(of_A);
  try {
    Z = multiply(Z, symmetric_eigen(of_A, of_E).vectors);
  } catch (const IndefiniteError&) {
    return;
  }
  if (!std::all_of(Z.data.begin(), Z.data.end(),
                   [](double z) { return std::isfinite(z); }))
    return;
  const auto modes_of = [&](const Dense& space) {
    Dense stiff = system.K;
    add_to(stiff, system.M, medium.tau);
    stiff = multiply_transposed(space, multiply(stiff, space));
    Dense here = multiply_transposed(space, multiply(at_middle, space));
    for (Dense* a : {&stiff, &here}) symmetrise(*a);
    return multiply(space, symmetric_eigen(here, stiff).vectors);
  };
  const Dense R = modes_of(Q);
  RR = between(R, system, R);
  ZR = between(Z, system, R);
  ZZ = between(Z, system, Z);
  Dense C_K = couplings.M;
  for (double& x : C_K.data) x *= couplings.sigma;
  Matrices C{C_K, couplings.M};
  C.insert(C.end(), couplings.terms.begin(), couplings.terms.end());
  for (const Dense& c : C) {
    CR.push_back(multiply(c, R));
    CZ.push_back(multiply(c, Z));
    CZ_norms.push_back(spectral_norm(CZ.back()));
    C_sizes.push_back(frobenius_norm(c));
  }
  Dense C_E = CZ[0]; // CᵀEZ
  add_to(C_E, CZ[1], -region.omega.last * region.omega.last);
  const double shift = couplings.sigma - region.omega.last * region.omega.last;
  double dropped = std::abs(shift) * couplings.dropped_M;
  std::size_t parameter = 0;
  for (std::size_t t = 0; t < system.terms.size(); ++t)
    if (const Law& law = system.terms[t].law; law.is_parameter()) {
      const double g = law.with("value", softest[parameter++]).at(0).real();
      add_to(C_E, CZ[2 + t], g);
      dropped += g * couplings.dropped_terms[t];
    }
  Z_size = frobenius_norm(Z);
  chi = spectral_norm(C_E) + dropped * Z_size;
  for (const Dense& a : ZZ) ZZ_norms.push_back(spectral_norm(a));
  Dense ports = system.B;
  if (!system.outputs_are_inputs) ports = beside(ports, system.C);
  R_ports = multiply_transposed(R, ports);
  if (Q.columns > small.columns) {
    const Dense of_small = modes_of(small);
    QQ = between(of_small, system, of_small);
    RQ = between(R, system, of_small);
    Q_ports = multiply_transposed(of_small, ports);
  }
  Z_ports = multiply_transposed(Z, ports);
  R_sizes = column_norms(R);
  holds = chi < 1;
}

} // namespace flexgram
