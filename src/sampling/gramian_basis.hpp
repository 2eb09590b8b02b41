#pragma once

#include "model/quadrature.hpp"
#include "model/spec.hpp"
#include "sampling/frequency_solves.hpp"

namespace flexgram {

/// The paper's first route: the band, how it is sampled, and what becomes of the samples.
struct SamplingSpec {
  Interval band; ///< [rad/s]
  int samples = 30;
  QuadratureRule rule = QuadratureRule::midpoint;
  bool logarithmic = false; ///< nodes of the rule in ln ω
  bool snapshots = false;   ///< Sirovich's method instead of TSQR
  Metric metric = Metric::mass;
  bool equal_ports = true; ///< every port weighs the same in the Gramian
  OrderSpec order;
  int checks = 8; ///< frequencies between the samples, solved for the error

  Quadrature nodes() const {
    return band_quadrature(band.first, band.last, samples, rule, logarithmic);
  }
};

/// Weighted samples of the response over the band, and the transfer function at them.
///   Z = [… √(w_l/π) Re X_l, √(w_l/π) Im X_l …],   X_l = A(ω_l)⁻¹ B,   P ≈ Z Zᵀ
/// (Fehr, Eberhard, Lehner, eqs. 11-14; an undamped body has no Im half).
struct Snapshots {
  Block Z;                     ///< n × 2 n_in s or n × n_in s, rows as in the world
  std::vector<double> omega;   ///< [rad/s]
  std::vector<ComplexDense> H; ///< at omega, free of charge
};
Snapshots sample_band(FrequencySolves& solves, const Quadrature& nodes);

/// Divides the samples of each port by their norm in M over the band, so that every port
/// weighs the same whatever its unit (N beside N·mm). Z's columns repeat the ports in
/// order.
void scale_ports(Block& Z, Mat M, PetscInt ports);

/// Dominant eigenvectors of the band-limited position Gramian P = (1/π) ∫ Q̃ Q̃ᵀ dω.
struct GramianBasis {
  Block V;                   ///< n × m, real, VᵀWV = I
  std::vector<double> sigma; ///< eigenvalues of P in the inner product W, descending
  int order = 0;             ///< m
  std::string inner_product; ///< what W became, in words
};

/// Singular value decomposition of the snapshots in the inner product W (mass: M, or
/// M + K/ω_max² where M is singular on the snapshots; euclidean: I, the paper; energy:
/// M + K/ω_max²), without forming ZᵀZ: TSQR of Z, then dense work of the size of its
/// rank.
/// `snapshots` is Sirovich's method on ZᵀWZ, faster and half as many digits.
/// @param[in] M, K   in the layout of Z.
/// @param[in] all    keep every direction that the samples hold, for a later choice of
/// order.
/// @throws Error if the samples are all zero or hold fewer directions than the order
/// asked.
GramianBasis gramian_basis(Block Z, Mat M, Mat K, double omega_max,
                           const SamplingSpec& spec, bool all, Observer& observer);

} // namespace flexgram
