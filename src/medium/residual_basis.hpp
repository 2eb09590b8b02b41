/// What residuals are made of: a basis T of it, and the parts of the residuals in its coordinates
/// (docs/proof.md, section 3, "W"). Called by level_certifier.cpp, read by certificate.

#pragma once

#include "medium/space.hpp"
#include "model/dense_system.hpp"

#include <optional>

namespace flexgram {

/// The parts of the residual in the coordinates of the columns T of the space's residual parts S,
/// or of fewer: R(ω) = T (ports − (a_k − κ a_m) K U x − Σ g terms U x) + what was dropped.
struct ResidualBasis {
  Dense ports, K;                   ///< k×p, k×N in the modal coordinates U
  std::vector<Dense> terms;         ///< k×N as K
  std::vector<Dense> terms_outside; ///< k×N: what T U has beyond E V, E = K − ω_c²M
  std::vector<double> dropped_ports, dropped_K; ///< of each column, rows scaled
  std::vector<std::vector<double>> dropped_terms;
  bool complete =
      true;  ///< T is S; else it is cut at the largest directions: nothing is proved
  Dense cut; ///< T = S cut; empty where T is complete
};

/// Makes all columns of the space's residual parts orthonormal: those that append added since.
void orthonormalise_residual(MediumSpace& space);
/// Coordinates Q (r×k, orthonormal columns) of the directions that the residual's parts have in
/// S, if these are so few that it pays to go on with S Q: half of r, or fewer than r − solved, or
/// no more than `most` where r is more.
/// @param solved  so many columns of S have been solved for.
/// @pre S is orthonormal.
std::optional<Dense> directions_of_residual(const MediumSpace& space, int solved,
                                            int most);
/// S Q instead of S. What that drops of the parts is counted.
void turn_residual_parts(MediumSpace& space, const Dense& Q);

/// @param samples      [rad/s] where residuals are looked at, if not all directions are
/// kept.
/// @param values       of the parameters, with each of which they are looked at. Empty: as they
/// are.
/// @param modes        number of modes below ω_c, rigid ones included: the first columns
/// of U.
/// @param most         at most so many columns.
/// @pre the space's residual parts are orthonormal.
ResidualBasis residual_basis(const MediumSpace& space, const DenseResponse& response,
                             const std::vector<double>& samples,
                             const std::vector<ParameterValues>& values, int modes,
                             double cutoff, int most);

/// ports − (a_k − κ a_m) K x − Σ g terms x
ComplexDense residual_of(const Dense& ports, const Dense& K,
                         const std::vector<Dense>& terms, double kappa,
                         const ShiftCoefficients& c, const ComplexDense& x);

/// The same parts in the modal coordinates U Q. @param response  with these.
void turn_residual(ResidualBasis& basis, const Dense& Q, const DenseResponse& response,
                   double kappa, double cutoff);

/// The norm (K − ω_c²M)⁻¹ on the columns of T, by a solve that need not be exact.
struct ResidualNorm {
  Dense gram;             ///< no less than TᵀE⁻¹T, without the modes below ω_c
  double added = 0;       ///< at most so much more than that, on its diagonal
  double of_rounding = 0; ///< ‖E^−½ r‖/‖r‖ of a vector r of roundings, rows scaled
};

} // namespace flexgram
