#pragma once

#include "reduce/dense_system.hpp"
#include "reduce/medium_space.hpp"

namespace flexgram {

/// A basis T of what the residuals over the band are made of, and the parts of the
/// residual in its coordinates: R(ω) = T (ports − (a_k − κ a_m) K U x − iω D U x) + a
/// remainder.
struct ResidualBasis {
  Block T;
  Dense ports, K, D;    ///< k×p, k×N, k×N, the last two in the modal coordinates U
  Dense damped_inside;  ///< N×modes: UᵀDΦ without the rows of Φ; empty without D
  Dense damped_outside; ///< k×modes: the part of (DΦ)_° outside V
  double remainder = 0; ///< what T leaves out, relative, at most over the samples
  bool complete = true; ///< false: cut at the largest directions
};

/// @param samples      [rad/s] where residuals are looked at.
/// @param modes        number of modes below ω_c, rigid ones included: the first columns
/// of U.
/// @param most         at most so many columns.
/// @note Replaces the space's own residual parts by an orthonormal basis of their span.
ResidualBasis residual_basis(MediumSpace& space, const DenseResponse& response,
                             const std::vector<double>& samples, int modes, double cutoff,
                             int most);

/// The error of the Galerkin model on a space V that holds all modes Φ below ω_c,
/// bounded.
///
/// With ports P = [B, C] and their residuals R = P − A V x, VᵀR = 0, the error is exactly
///   H − H_r = R_CᵀA⁻¹R_B = W_Cᵀ Z W_B,   W = (K + τM)^−½ R.
/// On the complement of Φ, and with damping that keeps A = a_k K + a_m M, Z is diagonal
/// in the modes with entries z(λ) = (λ + τ)/(a_k λ + a_m), λ ≥ ω_c². So with q = max |z|
/// and any disc |z − z₀| ≤ ρ that holds all z,
///   ‖H − H_r‖_F ≤ q s   and   ≤ |z₀| ‖W_CᵀW_B‖_F + ρ s,   s² = Σ σ_i(W_C)² σ_i(W_B)².
/// With other damping D ≥ 0, ‖Z‖ ≤ 1/(1/q − δ), q = (ω_c² + τ)/(ω_c² − ω²), δ = ω²‖G^½
/// A_ΦΦ⁻¹ G^½‖, G = (DΦ)_°ᵀ(K + τM)⁻¹(DΦ)_°, wherever q δ < 1 (DESIGN, section 2).
class Certificate {
public:
  struct Bound {
    double error = 0; ///< of ‖H − H_r‖_F, in the unit of H
    double floor = 0; ///< rounding of the model itself, in the unit of H; not in `error`
    bool proved = true;
  };

  Certificate() = default;
  /// @param gram   Tᵀ(K + τM)⁻¹T.
  /// @param modes  number of modes below the cutoff, the rigid ones included.
  /// @param scale  of each port.
  Certificate(const MediumSpace& space, const DenseResponse& response,
              ResidualBasis basis, const Dense& gram, int modes, double cutoff,
              std::vector<double> scale);

  /// Columns of ports that are the inputs and the outputs of a block of H.
  struct PortSet {
    std::vector<int> inputs, outputs;
  };
  /// @param x  the response at omega in modal coordinates, N × ports.
  /// @return a bound for each block.
  std::vector<Bound> at(double omega, const DenseResponse& response,
                        const ComplexDense& x, const std::vector<PortSet>& blocks) const;
  /// Largest sine of the angle between a mode below the cutoff and the space.
  double worst_angle() const;

private:
  double damping_coupling(double omega, const DenseSystem& system) const;

  double tau_ = 0, kappa_ = 0, cutoff_squared_ = 0, rounding_ = 0, remainder_ = 0;
  bool geometric_ = true;
  std::vector<double> scale_, rounding_weights_, rigid_weights_, mode_lambda_,
      mode_angle_;
  Dense ports_, K_, D_; ///< in coordinates where the Gram matrix is the identity
  Dense rigid_,
      neglected_;      ///< rigid rows of U; stiffness to the others that was set to zero
  Dense coupling_;     ///< G = coupling_ᵀ coupling_
  Dense mode_damping_; ///< ΦᵀDΦ of all modes, rigid first
};

} // namespace flexgram
