/// The medium space V and what residuals on it are made of (docs/proof.md, section 2).
/// Owned by ModalSpace; read by mode_search, residual_basis and certificate.

#pragma once

#include "linalg/orthonormal.hpp"
#include "model/second_order_model.hpp"

#include <cmath>

namespace flexgram {

/// Columns from which a block is wide: its solves, more than factorisations, are what a run
/// costs, so that it is worth work to have fewer.
inline constexpr int wide_block = 48;

/// A growing space V of the full body, W-orthonormal (W = M, or M + κK where M is
/// singular), with the Galerkin projections of K and the terms, and what the residuals of its
/// responses are made of. The first `rigid()` columns are exact rigid body modes: their
/// stiffness is zero by definition, not up to the rounding of K, so that low frequencies
/// stay accurate.
class MediumSpace {
public:
  /// @param tau   [rad²/s²] rows of residuals are scaled by the diagonal of K + τM.
  MediumSpace(const SecondOrderModel& fom, double kappa, double tau);

  /// The first columns of V: M-orthonormal, without stiffness.
  /// @param stiffness  that the stored K holds of them (rigid × rigid), set to zero.
  /// @param geometric  so many first ones are known from geometry; the others are null
  /// vectors of K, to the rounding of their entries.
  void start_with_rigid_modes(Block Phi, Dense stiffness, int geometric);
  /// Adds what X holds beyond V; returns the W-norms of what each column of X had
  /// outside V.
  std::vector<double> append(Block X, double tolerance);
  /// M times the vectors that the last call of append has added, or restore.
  Block mass_of_newest() const;
  /// Adds vectors that are W-orthonormal to each other and to V: those of a space that
  /// was kept. Before track_residual only.
  void restore(Block X);

  /// VᵀP, of rigid modes with twice the digits.
  Dense projected_ports(const Block& ports) const;

  /// From now on the parts of the residuals are kept: with P = I − W V Vᵀ,
  ///   B − A(ω) V x = P B − (a_k − κ a_m) P K V x − Σ g P T V x = S (C_B − … C_K x − … C_T x).
  void track_residual(const Block& ports);

  /// The columns S, each row divided by the root of the diagonal of K + τM, and the
  /// coordinates of P B, P K V and P T V in them.
  struct Residual {
    Basis S;
    int orthonormal = 0; ///< so many first columns of S are
    Dense B, K;
    std::vector<Dense> terms;
    /// Norms of what each of these columns lost when S was replaced by a smaller basis.
    std::vector<double> lost_B, lost_K;
    std::vector<std::vector<double>> lost_terms;

    /// B, K and the terms.
    std::vector<const Dense*> parts() const {
      std::vector<const Dense*> all{&B, &K};
      for (const Dense& T : terms) all.push_back(&T);
      return all;
    }
  };
  const Residual& residual() const { return residual_; }
  /// Replaces S by a basis of its span, with the coordinates that go with it.
  void compress_residual(Residual smaller) { residual_ = std::move(smaller); }
  void scale(Block& x) const;   ///< divides rows like those of S
  void unscale(Block& x) const; ///< undoes it

  const SecondOrderModel& fom() const { return fom_; }
  double kappa() const { return product_.kappa; }
  double tau() const { return tau_; }
  int columns() const { return static_cast<int>(V_.columns()); }
  int rigid() const { return rigid_.count; }
  const Basis& V() const { return V_; }
  const InnerProduct& product() const { return product_; }
  const Dense& K() const { return projected_.K; }
  Dense M() const; ///< VᵀWV − κ VᵀKV
  const std::vector<Dense>& terms() const { return projected_.terms; } ///< VᵀTV

  /// What plain sums may have lost of VᵀKV, VᵀMV and VᵀTV: entry (i, j) is wrong by at most
  /// `unit` w_i w_j, w the weights of that matrix (docs/proof.md, section 6).
  struct Rounding {
    double unit = 0;
    std::vector<double> K, M;
    std::vector<std::vector<double>> terms;
  };
  const Rounding& rounding_of_sums() const { return rounding_of_sums_; }
  /// √(xᵀRx) of each column x for K, M or a term (0, 1, 2, …): |x|ᵀ|A||y| is at most the product of those
  /// of x and y. And √(fᵀR⁻¹f): |x|ᵀ|f| is at most that of x times this one of f. Collective.
  std::vector<double> weights(std::size_t matrix, const Block& x) const;
  std::vector<double> dual_weights(std::size_t matrix, const Block& f) const;
  /// The latter for K + τM.
  std::vector<double> dual_weights_of_ports(const Block& f) const;
  /// How far ΦᵀMΦ of the rigid modes is from the identity, and what plain sums lost.
  double rigid_mass_deviation() const { return rigid_.mass_deviation; }

  /// Rounding of VᵀKV: entry (i, j) is wrong by about rounding() g_i g_j, with
  /// g_i² = v_iᵀ diag(K) v_i. Measured by the asymmetry of what was computed.
  double rounding() const { return entries_.unit; }
  const std::vector<double>& rounding_weights() const { return entries_.weights; }
  /// The same of the exact VᵀKV by the rounding of K's entries when they were printed; 0: they
  /// do not look printed. Such roundings repeat with the elements of a regular mesh, hence 8
  /// (up to 6 were measured).
  double data_rounding() const {
    return 8 * entries_.printed / std::sqrt(static_cast<double>(fom_.n));
  }
  double printed_rounding() const { return entries_.printed; } ///< of K's entries
  /// Stiffness of rigid modes (rigid × N) that the stored K holds and that was set to zero.
  const Dense& rigid_stiffness() const { return rigid_.stiffness; }
  int geometric() const { return rigid_.geometric; } ///< of the rigid modes
  bool tracks_residual() const { return tracks_; }

private:
  void add_rounding_weights(const Block& X);
  std::vector<double> row_weights(Mat a) const;
  static std::vector<double> norms_by(const std::vector<double>& rows, const Block& x,
                                      bool dual);
  void project(Block& image, const Dense& coordinates) const;
  void extend_projection(const Block& X, const Block& KX, const Block& WX,
                         const std::vector<Block>& TX);
  std::vector<Block> times_terms(const Block& X) const;
  void keep_rigid_forces(const Block& Phi);
  void take_deviation(const Block& Phi);

  SecondOrderModel fom_;
  InnerProduct product_;
  double tau_;
  Basis V_;
  bool tracks_ = false;
  Residual residual_;
  Rounding rounding_of_sums_;
  /// Of this rank's rows.
  struct Rows {
    std::vector<double> root_diagonal, K_diagonal;
    std::vector<std::vector<double>> weights; ///< R of K, M and the terms
  } rows_;
  /// Until track_residual.
  struct Images {
    Basis KV;
    std::vector<Basis> TV; ///< of each term
    Block newest_weighted; ///< W times the newest of V
  } images_;
  struct Projections {
    Dense K, W;
    std::vector<Dense> terms;
  } projected_;
  struct RigidModes {
    int count = 0, geometric = 0;
    Block forces; ///< K Φ, all digits
    Dense stiffness;
    double mass_deviation = 0;
  } rigid_;
  /// Of the entries of K.
  struct EntryRounding {
    std::vector<double> weights; ///< g
    double unit = 0, printed = 0;
  } entries_;
};

} // namespace flexgram
