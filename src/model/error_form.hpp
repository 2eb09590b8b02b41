#pragma once

#include "linalg/dense.hpp"
#include "model/second_order_model.hpp"

#include <vector>

namespace flexgram {

/// More than a norm of the error: the body answers by H = H_m + W_Cᵀ S⁻¹ W_B with
/// ‖S⁻¹‖ <= 1/(1 − δ) (docs/proof.md, sections 2, 3 and 8). H_m is the medium model in modal
/// coordinates x, uᵀ(K + τM)u = 1:
///   H_m = outputsᵀ x,  x_j = inputs_j/(a_k stiffness_j + a_m mass_j),
///   W_B = residual_inputs − (a_k − κ a_m) residual_stiffness x,
///   δ = Σ_j |c|² coupling_j²/|a_k stiffness_j + a_m mass_j|,  c = a_m + cutoff² a_k,
/// W_C likewise. Without a damping matrix.
struct ErrorForm {
  std::vector<double> stiffness, mass; ///< of each of N modes
  Dense inputs, outputs;               ///< N × n_in, N × n_out
  Damping damping;
  Dense residual_stiffness;                ///< k × N
  Dense residual_inputs, residual_outputs; ///< k × n_in, k × n_out
  /// Norms of what the k rows of W do not hold: Σ_j (lost_stiffness_j |(a_k − κ a_m) x_j|)² and
  /// the square of the port's own, of each port.
  std::vector<double> lost_stiffness, lost_inputs, lost_outputs;
  double kappa = 0, cutoff = 0; ///< cutoff: ω_c [rad/s]
  std::vector<double> coupling; ///< of the first modes, those below the cutoff
  /// Of what rounding does to the modal matrices, the sums of each row: H_m is off by at most
  /// Σ_ij |x_Ci||F_ij||x_Bj|, Σ_j |F_ij| <= |a_k| rounding_stiffness_i + ω² rounding_mass_i.
  std::vector<double> rounding_stiffness, rounding_mass;
  Dense rounding_inputs, rounding_outputs; ///< of inputs and outputs, each entry
};

} // namespace flexgram
