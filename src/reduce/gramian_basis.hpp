#pragma once

#include "reduce/frequency_solves.hpp"
#include "reduce/quadrature.hpp"

#include <optional>

namespace flexgram {

/// The band and how it is sampled.
struct GramianOptions {
  std::vector<double> band_hz{10, 500};
  int samples = 30;
  std::string quadrature = "midpoint";
  std::string spacing = "linear";
  std::string svd = "tsqr";
  std::string inner_product = "mass";
  std::string port_scaling = "equal";
  int order = 0;                   ///< 0: by the tolerance or the order rule
  std::optional<double> tolerance; ///< unset: order by -mor_order or by the rule
  std::string tolerance_of = "each_kind";

  bool by_kind() const { return tolerance && tolerance_of == "each_kind"; }

  void describe(Options& options);         ///< what every method has
  void describe_samples(Options& options); ///< what pod alone has
  void check() const;
  /// [rad/s], one after the other. @throws Error for a band that is empty, negative or
  /// reversed.
  std::vector<std::pair<double, double>> bands() const;
  /// The only band. @throws Error if there are several.
  std::pair<double, double> band() const;
  Quadrature nodes() const;
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
/// `-mor_svd snapshots` is Sirovich's method on ZᵀWZ, faster and half as many digits.
/// @param[in] M, K   in the layout of Z.
/// @param[in] all    keep every direction that the samples hold, for a later choice of
/// order.
/// @throws Error if the samples are all zero or hold fewer directions than the order
/// asked.
GramianBasis gramian_basis(Block Z, Mat M, Mat K, double omega_max,
                           const GramianOptions& options, bool all, Monitor& monitor);

/// The paper's order rule (section 2.2): smallest m with σ_{m+1}/σ_1 < √ε ≈ 1.5e-8.
int order_by_rule(const std::vector<double>& sigma);

} // namespace flexgram
