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
  for (const auto& [law, T] : system.terms) {
    all.push_back(multiply_transposed(left, multiply(T, right)));
    if (&left == &right && law.is_skew()) symmetrise(all.back(), Symmetry::skew);
  }
  return all;
}

/// The real part of A, without terms that do not vary, with values of the parameters.
Dense stiffness(const DenseSystem& system, const std::vector<double>& values,
                double omega, double tau = 0) {
  Dense E = system.K;
  add_to(E, system.M, tau - omega * omega);
  std::vector<Law> parameters;
  for (const auto& [law, T] : system.terms) {
    if (!law.varies()) continue;
    const double value = values[place_among(parameters, law)];
    if (law.kind().is_stiffness())
      add_to(E, T, law.with("value", value).at(omega).real());
  }
  return E;
}

/// With them Re A is no less than `of_K` K − `of_M` M and the stiffness of the varying terms at the
/// least values, everywhere in a region.
struct Lowered {
  double of_K = 1, of_M = 0;
};
Lowered lowered(const DenseSystem& system, const Softening& softening,
                const Cell& region) {
  const double omega = region.omega.last;
  double of_speed = 0,
         moved = 0; // shares of the most; of what a spin takes: beyond the least
  bool all_vary = true;
  std::vector<Law> parameters;
  for (const auto& [law, T] : system.terms) {
    if (!law.varies()) {
      all_vary = all_vary && (!law.is_skew() || law.is_semidefinite());
      continue;
    }
    const Interval& values = region.values[place_among(parameters, law)];
    const auto share = [&](double value) { return law.shares({value, value}).front(); };
    if (law.is_semidefinite()) continue;
    if (law.is_skew())
      of_speed = std::max(of_speed, share(values.last));
    else
      moved = std::max(moved, share(values.last) - share(values.first));
  }
  if (!all_vary) of_speed = 1;
  return {1 - moved * softening.stiffness -
              omega * of_speed * softening.gyration_stiffness,
          omega * omega + omega * of_speed * softening.gyration + moved * softening.mass};
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
  const Lowered least = lowered(system, couplings.softening, region);
  kept = 1 / couplings.softening.enlarges(region.omega.last);
  if (!(least.of_K > 0) || !(kept > 0) ||
      !(couplings.softening.needed_square(region.omega.last) <= couplings.sigma))
    return;
  const double top = std::sqrt(least.of_M / least.of_K);
  const Dense Q = with_modes(medium, small, {middle, softest, stiffest}, 1.3 * top),
              beyond = complement(Q);
  // A space orthogonal to Q by the stiffness at a frequency apart from the resonances of Q, so that
  // little couples both; with coordinates where E is I and A is about diagonal.
  Dense E = stiffness(system, softest, 0);
  add_to(E, system.K, least.of_K - 1);
  add_to(E, system.M, -least.of_M);
  const Dense at_middle = stiffness(system, middle, region.omega.centre()),
              EQ = multiply(
                  stiffness(system, softest, frequency_apart(medium, Q, softest, top)),
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
        middle_of_Z = multiply_transposed(Z, multiply(at_middle, Z));
  symmetrise(of_E);
  symmetrise(middle_of_Z);
  try {
    Z = multiply(Z, symmetric_eigen(middle_of_Z, of_E).vectors);
  } catch (const IndefiniteError&) {
    return;
  }
  if (!std::all_of(Z.data.begin(), Z.data.end(),
                   [](double z) { return std::isfinite(z); }))
    return;
  Dense off = multiply_transposed(Z, multiply(E, Z)); // rounding of the eigenvectors
  for (int i = 0; i < off.rows; ++i) off(i, i) -= 1;
  constexpr double most = 1e-6;
  const double away = frobenius_norm(off);
  if (!(away <= most)) return;
  for (double& z : Z.data) z *= 1 + away; // ZᵀEZ >= I
  const auto modes_of = [&](const Dense& space) {
    Dense stiff = system.K;
    add_to(stiff, system.M, medium.tau);
    stiff = multiply_transposed(space, multiply(stiff, space));
    Dense here = multiply_transposed(space, multiply(at_middle, space));
    for (Dense* a : {&stiff, &here}) symmetrise(*a);
    return multiply(space, symmetric_eigen(here, stiff).vectors);
  };
  const Dense R = modes_of(Q);
  of_A.RR = between(R, system, R);
  of_A.ZR = between(Z, system, R);
  of_A.ZZ = between(Z, system, Z);
  Dense C_K = couplings.M;
  for (double& x : C_K.data) x *= couplings.sigma;
  Matrices C{C_K, couplings.M};
  C.insert(C.end(), couplings.terms.begin(), couplings.terms.end());
  for (const Dense& c : C) {
    of_A.CR.push_back(multiply(c, R));
    of_A.CZ.push_back(multiply(c, Z));
    CZ_norms.push_back(spectral_norm(of_A.CZ.back()));
    C_sizes.push_back(frobenius_norm(c));
  }
  Dense C_E = of_A.CZ[0]; // CᵀEZ
  for (double& x : C_E.data) x *= least.of_K;
  add_to(C_E, of_A.CZ[1], -least.of_M);
  double dropped =
      std::abs(couplings.sigma * least.of_K - least.of_M) * couplings.dropped_M;
  std::vector<Law> parameters;
  for (std::size_t t = 0; t < system.terms.size(); ++t) {
    const Law& law = system.terms[t].law;
    if (!law.varies()) continue;
    const double value = softest[place_among(parameters, law)];
    if (!law.kind().is_stiffness()) continue;
    const double g = law.with("value", value).at(0).real();
    add_to(C_E, of_A.CZ[2 + t], g);
    dropped += std::abs(g) * couplings.dropped_terms[t];
  }
  Z_size = frobenius_norm(Z);
  chi = spectral_norm(C_E) + dropped * Z_size;
  for (const Dense& a : of_A.ZZ) ZZ_norms.push_back(spectral_norm(a));
  Dense ports = system.B;
  if (!system.outputs_are_inputs) ports = beside(ports, system.C);
  R_ports = multiply_transposed(R, ports);
  if (Q.columns > small.columns) {
    const Dense of_small = modes_of(small);
    of_A.QQ = between(of_small, system, of_small);
    of_A.RQ = between(R, system, of_small);
    Q_ports = multiply_transposed(of_small, ports);
  }
  Z_ports = multiply_transposed(Z, ports);
  R_sizes = column_norms(R);
  if (!is_symmetric(system.terms)) {
    of_transposed = of_A;
    const auto transpose_terms = [&](Matrices& all) {
      for (std::size_t t = 0; t < system.terms.size() && !all.empty(); ++t)
        if (system.terms[t].law.is_skew())
          for (double& x : all[2 + t].data) x = -x;
    };
    Blocks& b = of_transposed;
    for (Matrices* all : {&b.RR, &b.ZR, &b.ZZ, &b.CR, &b.CZ, &b.QQ, &b.RQ})
      transpose_terms(*all);
  }
  holds = chi * chi < kept;
}

} // namespace flexgram
