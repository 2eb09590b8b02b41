#pragma once

#include "linalg/orthonormal.hpp"
#include "model/second_order_model.hpp"

namespace flexgram {

/// A growing space V of the full body, W-orthonormal (W = M, or M + κK where M is
/// singular), with the Galerkin projections of K and D, and what the residuals of its
/// responses are made of. The first `rigid()` columns are exact rigid body modes: their
/// stiffness is zero by definition, not up to the rounding of K, so that low frequencies
/// stay accurate.
class MediumSpace {
public:
  /// @param tau   [rad²/s²] shift of the norm (K + τM)⁻¹.
  MediumSpace(const SecondOrderModel& fom, double kappa, double tau);

  /// The first columns of V: M-orthonormal, without stiffness.
  void start_with_rigid_modes(Block Phi);
  /// Adds what X holds beyond V; returns the number of columns added.
  int append(Block X, double tolerance);
  /// V ← V Q with orthogonal Q that leaves the rigid modes alone. Before track_residual
  /// only.
  void rotate(const Dense& Q);
  /// Declares the first columns of V rigid: their stiffness is rounding and set to zero.
  void set_rigid(int count);

  /// From now on the parts of the residuals are kept:
  ///   B − A(ω) V x = P B − (a_k − κ a_m) P K V x − iω P D V x,   P = I − W V Vᵀ.
  void track_residual(const Block& ports);

  const SecondOrderModel& fom() const { return fom_; }
  const InnerProduct& product() const { return product_; }
  double kappa() const { return product_.kappa; }
  double tau() const { return tau_; }
  int columns() const { return static_cast<int>(V_.columns()); }
  int rigid() const { return rigid_; }
  const Block& V() const { return V_; }
  const Block& WV() const { return WV_; }
  const Dense& K() const { return K_; }
  Dense M() const; ///< I − κ VᵀKV
  const Dense& D() const { return D_; }

  /// P B, P K V and P D V, each row divided by the root of the diagonal of K + τM.
  const Block& residual_ports() const { return residual_B_; }
  const Block& residual_K() const { return residual_K_; }
  const Block& residual_D() const { return residual_D_; }
  /// Undoes the division.
  void unscale(Block& x) const;

  /// Rounding of VᵀKV: entry (i, j) is wrong by about rounding() g_i g_j, with
  /// g_i² = v_iᵀ diag(K) v_i. Measured by the asymmetry of what was computed.
  double rounding() const { return rounding_; }
  const std::vector<double>& rounding_weights() const { return g_; }

private:
  void scale(Block& x) const;
  /// P A X for the columns of V from `first` on, from AX and VᵀAV; scaled.
  Block outside(Block image, const Dense& projected, int first) const;
  void extend_projection(const Block& X, const Block& KX, const Block& DX);

  SecondOrderModel fom_;
  InnerProduct product_;
  double tau_;
  std::vector<double> root_diagonal_, K_diagonal_; ///< this rank's rows
  Block V_, WV_, ports_, residual_B_, residual_K_, residual_D_;
  Dense K_, D_;
  std::vector<double> g_;
  double rounding_;
  int rigid_ = 0;
  bool tracks_ = false;
};

} // namespace flexgram
