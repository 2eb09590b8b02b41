/// Norms in E⁻¹, E = K − ω_c²M, by the factors of E (docs/proof.md, section 3, "W"). Called by
/// level_certifier.cpp.

#pragma once

#include "medium/modal_space.hpp"

namespace flexgram {

/// What random vectors tell of E⁻¹.
struct InverseBounds {
  double least_eigenvalue =
      0;                  ///< |λ| of E, rows and columns scaled, at least; 0: unknown
  double of_rounding = 0; ///< norm in E⁻¹ of a random vector of norm 1, rows scaled
};

/// A lower bound of the least |λ| of E, rows and columns scaled by the diagonal of K + τM:
/// ‖E⁻¹g‖ >= |gᵀv|/|λ| for its eigenvector v, and for entries of g spread evenly over
/// (−1, 1) |gᵀv| < t has a probability of √2 t at most (Ball 1986). Eight vectors, t = 1/10:
/// wrong once in six millions. And how large a random vector is in E⁻¹ once its part along
/// the modes below the cutoff is taken out, where E is positive.
/// @pre the factors of E are at hand. @note Collective.
InverseBounds inverse_bounds(const CertifyRun& run, const ModalSpace& modal,
                             const DenseResponse& response);

/// E⁻¹ on what residuals are made of: X ≈ E⁻¹T by solves that need not be exact, and TᵀE⁻¹T. Both
/// grow with T. The images X are the next Krylov block.
///
/// With F = T − E X, TᵀE⁻¹T is TᵀX + XᵀF + FᵀE⁻¹F, and the last term is at most ‖F‖²/min |λ(E)| in
/// size.
class ResidualImages {
public:
  /// Solves for the columns beyond those that are known.
  /// @param T  rows scaled like those of the space's residual parts.
  /// @pre the factors of E are at hand. @note Collective.
  void extend(const CertifyRun& run, const ModalSpace& modal, const Basis& T);
  /// Combines the images: X Q. Their F and Gram matrix are computed anew, since the images of T
  /// may be far larger than those of T Q. @param T  turned by Q already. @note Collective.
  void turn(const CertifyRun& run, const ModalSpace& modal, const Dense& Q,
            const Basis& T);
  /// @param T  that of all columns. @note Collective.
  ResidualNorm norm(const CertifyRun& run, const ModalSpace& modal,
                    const DenseResponse& response, const InverseBounds& bounds,
                    const Basis& T) const;
  const Basis& images() const { return X_; }

private:
  /// One more block. @param before  T of the others, scaled. @param added  of T, not scaled.
  void add(const CertifyRun& run, const ModalSpace& modal, const Basis& before,
           Block added, Block X);

  Basis X_;
  Dense gram_;        ///< TᵀX + XᵀF
  double missed_ = 0; ///< ‖F‖_F², rows scaled, at least
};

} // namespace flexgram
