/// What rounding does to the projected matrices of a medium model, and so to its H
/// (docs/proof.md, section 6). Made by growth.cpp, kept by the certificate.

#pragma once

#include "medium/space.hpp"
#include "model/dense_system.hpp"

#include <cmath>

namespace flexgram {

/// In the modal coordinates of a level, the exact UᵀVᵀA(ω)VU differs from the diagonal (and D)
/// that the level computes with by a matrix E(ω) with, for i ≠ j,
///   |E_ij| <= |a_k| (K_i K_j + mixed) + ω² (M_i M_j + mixed/τ) + ω D_i D_j,
/// and |E_jj| <= |a_k| (K_j² + rounding of λ_j) + ω² M_j² + ω D_j². H differs by x_Cᵀ E x_B.
struct ProjectionRounding {
  std::vector<double> K, M, D; ///< of each mode; K is 0 of rigid ones
  std::vector<double> lambda;  ///< rounding of μ_j λ_j
  std::vector<double>
      ports; ///< of each mode; its ports are wrong by this times port_sizes
  std::vector<double> port_sizes; ///< of each port, scaled
  double mixed = 0;               ///< UᵀKU and τUᵀMU beside their diagonals
  double tau = 1;
  double rigid_mass = 0; ///< of ΦᵀMΦ of rigid modes
  int rigid = 0;

  /// Sizes of the coordinates of a response: of each mode the norm over some ports.
  using Sizes = std::vector<double>;
  /// Σ |x_C|ᵀ|E||x_B| at most. @param a_k  its size.
  double of_response(double a_k, double omega, const Sizes& outputs,
                     const Sizes& inputs) const;
  /// |E||x|: what the equations of each mode are off by.
  Sizes of_equations(double a_k, double omega, const Sizes& x) const;
  /// |E_ij| with K and M at any ω up to the root of `square`, for undamped modes.
  double between(std::size_t i, std::size_t j, double square) const {
    return K[i] * K[j] + square * M[i] * M[j] + (1 + square / tau) * mixed +
           (i == j ? lambda[i] : 0.0);
  }
  /// How much of that a mode is responsible for, as the root of its diagonal part.
  double share(std::size_t i, double a_k, double omega) const {
    return std::sqrt(a_k * K[i] * K[i] + omega * omega * M[i] * M[i] +
                     omega * D[i] * D[i]);
  }

  template <class Archive, class Self>
  static void archive(Archive&& a, Self& self) {
    a("rounding_K", self.K);
    a("rounding_M", self.M);
    a("rounding_D", self.D);
    a("rounding_lambda", self.lambda);
    a("rounding_ports", self.ports);
    a("port_sizes", self.port_sizes);
    a("rounding_mixed", self.mixed);
    a("rounding_tau", self.tau);
    a("rounding_rigid_mass", self.rigid_mass);
    a("rounding_rigid", self.rigid);
  }
  bool fits(int order, int ports_count) const;
};

/// Of the plain sums that the space holds.
/// @param loads  all ports, scaled.
ProjectionRounding plain_rounding(const MediumSpace& space, const DenseResponse& response,
                                  const Block& loads);

/// A response whose energies were summed with twice the digits for some Ritz vectors.
struct SharpResponse {
  std::shared_ptr<const DenseResponse> response;
  ProjectionRounding rounding;
  Dense turned; ///< its U is that of the response before times this
};
/// @param chosen  columns of U, elastic, whose energies are summed again: with twice the
/// digits among themselves, by accurate forces K y, M y, D y with all others.
/// @note One accurate product with each matrix for each of them. Collective.
SharpResponse sharpened(const MediumSpace& space, const DenseResponse& response,
                        const ProjectionRounding& plain, const std::vector<int>& chosen);

} // namespace flexgram
