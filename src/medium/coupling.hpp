/// What couples Ritz vectors to the rest of a body with a damping matrix: J and δ of
/// docs/proof.md, sections 2 and 3. Owned by the certificate.

#pragma once

#include "model/dense_system.hpp"
#include "model/spec.hpp"

#include <span>

namespace flexgram {

/// μ(1 + κλ): −Mu + μ(K + τM)u of a Ritz vector u is so many times what K u has outside V.
inline double residual_factor(double mu, double tau, double kappa) {
  return mu + kappa * (1 - tau * mu);
}

/// a_k and a_m − s a_k at the centre of an interval, and how far they move to its ends.
struct Coefficients {
  Coefficients(const DenseSystem& system, double s, Interval interval);
  std::complex<double> a, c;
  double moved_a, moved_c;
};

/// J = c G + Σ g F of vectors Φ of V in the norm of E⁻¹, E = K − ω_c²M, F of each term, and
/// A_Φ = ΦᵀA(ω)Φ.
class DampingCoupling {
public:
  /// What residuals hold, in coordinates where E⁻¹ is the identity.
  struct Residual {
    const Dense& K;                    ///< k×N: P K U
    const std::vector<Dense>& terms;   ///< k×N: what T U has beyond E V, of each term
    std::span<const double> dropped_K; ///< norms of what these do not hold
    const std::vector<std::vector<double>>& dropped_terms;
  };
  DampingCoupling() = default;
  /// Φ may be any vectors of V on which E has as many negative eigenvalues as modes lie below the
  /// cutoff. Tried are the first columns of U: with more of them less of what terms couple is
  /// outside, but their residuals are larger; and such columns with E⁻¹T of them, as V holds it,
  /// for each term: then what T couples them to is inside, however large g is. Those with the
  /// smallest δ at some frequencies are taken.
  /// @pre uᵀEu < 0 of the first `modes` columns of U, > 0 of the others.
  DampingCoupling(const DenseResponse& response, const Residual& residual, int modes,
                  double sigma, double kappa);

  /// δ over an interval: what C = J A_Φ⁻¹ Jᵀ takes at most from the Hermitian part of S,
  /// the largest eigenvalue of that of C, or ‖C‖; infinite where A_Φ may be singular.
  double over(const DenseSystem& system, Interval interval) const;

  template <class Archive, class Self>
  static void archive(Archive&& a, Self& self) {
    a("mode_G", self.G_);
    a("mode_mu_coupled", self.mu_);
    a("dropped_G", self.dropped_G_);
    a("dropped_F", self.dropped_F_);
    a("coupling_tau", self.tau_);
    a("coupling_sigma", self.sigma_);
    a("mode_F", self.F_);
    a("mode_T", self.T_);
  }
  int count() const { return static_cast<int>(mu_.size()); } ///< columns of Φ
  /// Whether the fields fit each other.
  bool fits(std::size_t terms) const;

private:
  /// Vectors of V in the coordinates U: orthonormal, and UᵀMU is diagonal on them.
  struct Vectors {
    Dense Y;
    std::vector<double> mu; ///< of each
  };
  static Vectors with_coupled(const DenseResponse& response, int count, double sigma);
  void couple(const DenseResponse& response, const Residual& residual, int count,
              double kappa);
  bool couple(const DenseResponse& response, const Residual& residual,
              const Vectors& vectors, int modes, double kappa);
  double largest_at_some(const DenseSystem& system) const;
  double at(const DenseSystem& system, double omega) const;
  ComplexDense A(const ShiftCoefficients& c) const;
  ComplexDense J(std::complex<double> c,
                 const std::vector<std::complex<double>>& g) const;

  Dense G_;                  ///< rows: the rest of V, then directions of residuals
  std::vector<Dense> F_, T_; ///< of each term: rows as of G; ΦᵀTΦ
  std::vector<double> mu_;
  double dropped_G_ = 0;          ///< norms of what G and F do not hold
  std::vector<double> dropped_F_; ///< of each term
  double tau_ = 0, sigma_ = 0;
};

} // namespace flexgram
