#pragma once

#include "base/index.hpp"
#include "model/parameters.hpp"
#include "model/second_order_model.hpp"

#include <cmath>
#include <memory>
#include <optional>

namespace flexgram {

/// A small second-order system with its damping kept apart: M q'' + (αM + βK) q' + K(1 + iη) q +
/// Σ g(ω)T q = B u, y = Cᵀq. M, K, T: N×N, B: N×n_in, C: N×n_out.
struct DenseSystem {
  Dense M, K, B, C;
  Damping damping;
  std::vector<Term<Dense>> terms;
  bool outputs_are_inputs = true;
  /// Rounding of responses over intervals, relative, below which faster ways are taken.
  double negligible = finest;
  static constexpr double finest = 1e-11;

  int order() const { return K.rows; }
  /// Nothing damps it. Circulatory forces may, or excite it.
  bool is_undamped() const;
  /// No energy is lost or won: it is undamped, and at most gyroscopic.
  bool is_lossless() const;
  ShiftCoefficients coefficients(double omega) const;
  /// The same body with other values of its parameters. @param values  empty: as they are.
  DenseSystem at(const ParameterValues& values) const;
  /// With what the parameters' values add to the stiffness in K, for its modes; their own loss
  /// factors are left in a structural term.
  DenseSystem stiffened() const;
  /// A(ω)ᵀ: with skew terms of the other sign.
  DenseSystem transposed() const;
  /// The Galerkin projection onto the columns of Q (N×m).
  DenseSystem project(const Dense& Q) const;
  /// The projection onto the span of Q in modal coordinates, M = I and K diagonal (a massless
  /// direction has k = 1 and its own m): there, doubles store a resonance of damping ratio ζ with
  /// an error of 1e-16/(2ζ) of H at most. Free coordinates that come first stay as they are.
  /// @param tau  [rad²/s²] as for DenseResponse.
  struct Modal;
  Modal project_to_modes(const Dense& Q, double tau) const;
  /// As a model, with viscous damping summed into D; beside S alone it stays factors, as η does.
  SecondOrderModel model(const SecondOrderModel& names) const;
  static DenseSystem from(const SecondOrderModel& dense);
};

class PencilModes;

struct DenseSystem::Modal {
  Dense Q; ///< N × m, the basis in modal coordinates
  DenseSystem system;
};

/// X(ω) = A(ω)⁻¹B and H(ω) = CᵀX(ω) of a dense system at many frequencies. With
/// proportional damping the system is diagonalised once, Uᵀ(K + τM)U = I, UᵀMU = diag(μ),
/// μ = 1/(λ + τ), so a frequency costs N·n_in; otherwise each is a dense solve. M may be
/// singular. Low λ are Rayleigh quotients in extended precision: at a resonance of damping
/// ratio ζ a relative error of λ is one of H, 2ζ times smaller.
///
/// First coordinates without stiffness, damping matrix and coupling, and of mass 1, as those
/// of rigid modes, stay as they are: the first columns of U are theirs, λ is 0.
class DenseResponse {
public:
  /// @param tau  [rad²/s²], of the size of ω²; K + τM must be positive definite.
  DenseResponse(DenseSystem system, double tau);
  /// With eigenvectors, eigenvalues and UᵀB found before; the outputs are the inputs.
  /// @param terms  UᵀTU of each term; empty: from the system.
  DenseResponse(DenseSystem system, double tau, Dense U, std::vector<double> lambda,
                Dense B, std::vector<Dense> terms = {});

  /// The same with other values of the parameters. @param values  empty: as they are.
  DenseResponse at(const ParameterValues& values) const;
  /// The response of A(ω)ᵀ to the same ports.
  DenseResponse transposed() const;
  /// The same where rounding counts from another size on.
  DenseResponse to_rounding(double negligible) const;
  /// That of `stiffened`, by its own modes.
  DenseResponse stiffened() const { return {system_.stiffened(), tau_}; }
  const DenseSystem& system() const { return system_; }
  double tau() const { return tau_; }
  bool is_diagonal() const { return system_.terms.empty(); }
  /// UᵀA(ω)U without the terms: a_i = μ_i (a_k λ_i + a_m), to full accuracy beside resonances too.
  std::complex<double> diagonal(int i, double omega, double eta_added = 0) const;
  std::vector<std::complex<double>> diagonal(double omega, double eta_added = 0) const;
  /// How far such a number may be off by rounding.
  double rounding_of_diagonal(int i, double omega) const;
  /// The part of that which the difference λ − ω² leaves in long double.
  double rounding_of_difference(int i, double omega) const;
  /// Whether the undamped system has a resonance at ω, as far as doubles can tell.
  bool is_resonance(double omega) const;
  const Dense& modal_inputs() const { return B_; }                 ///< UᵀB
  const Dense& modal_outputs() const { return C_; }                ///< UᵀC
  const std::vector<Dense>& modal_terms() const { return terms_; } ///< UᵀTU of each term
  /// Matrix of order 2N whose eigenvalues are 1/s of the poles s (K regular, no
  /// structural damping taken into account).
  Dense companion() const;
  /// How many first coordinates are free: without stiffness and coupling, of mass 1.
  int free() const { return free_; }
  /// Eigenvectors of the undamped pencil, N×N, (K + τM)-orthonormal.
  const Dense& U() const { return U_; }
  /// Eigenvalues λ of the pencil (K, M), ascending; infinite for massless directions.
  const std::vector<double>& lambda() const { return lambda_; }

  const std::vector<double>& mu() const { return mu_; } ///< UᵀMU
  /// uᵀ(K − σM)u of column j of U.
  double energy(int j, double sigma) const {
    const auto at = as_size(j);
    return std::isfinite(lambda_[at]) ? mu_[at] * (lambda_[at] - sigma) : 1.0;
  }

  /// X in the coordinates of U: X(ω) = U x. @param eta_added  loss factor of K beside the system's.
  ComplexDense modal_response(double omega, double eta_added = 0) const;
  ComplexDense transfer(const ComplexDense& modal_response) const;
  ComplexDense transfer(double omega) const { return transfer(modal_response(omega)); }
  /// Complex modes of a system whose terms are stiffness with losses; null where it has others, or
  /// modes too near each other. Found when they are first asked for.
  const PencilModes* pencil() const;

private:
  void take_diagonals();
  void sharpen(int first);

  DenseSystem system_;
  double tau_;
  int free_ = 0;
  Dense U_, B_, C_;          ///< B and C in the coordinates of U
  std::vector<Dense> terms_; ///< so
  std::vector<double> mu_, lambda_;
  mutable std::shared_ptr<const std::optional<PencilModes>> pencil_; ///< null: not yet
};

/// A += Σ g_t T_t.
void add_terms(ComplexDense& A, const std::vector<std::complex<double>>& g,
               const std::vector<Dense>& T);

/// The poles of the system in the upper half of the ω plane [rad/s]; with a structural term by
/// first order.
std::vector<std::complex<double>> poles(const DenseResponse& response,
                                        double eta_added = 0);

} // namespace flexgram
