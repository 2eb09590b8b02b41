/// What couples vectors Φ of the medium space to the rest of a body with terms: J and δ of
/// docs/proof.md, sections 2 and 3. Made by coupling.cpp.

#pragma once

#include "model/dense_system.hpp"
#include "model/spec.hpp"

#include <optional>
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

/// What residuals hold, in coordinates where E⁻¹ is the identity.
struct OutsideParts {
  const Dense& K;                    ///< k×N: P K U
  const std::vector<Dense>& terms;   ///< k×N: what T U has beyond E V, of each term
  std::span<const double> dropped_K; ///< norms of what these do not hold
  const std::vector<std::vector<double>>& dropped_terms;
  double kappa; ///< of the inner product of V
};

/// Vectors of V in the coordinates U: orthonormal, and UᵀMU is diagonal on them.
struct VectorsOfV {
  Dense Y;
  std::vector<double> mu; ///< of each
};

/// J = c G + Σ g F of vectors Φ of V in the norm of E⁻¹, E = K − ω_c²M, F of each term, and
/// A_Φ = ΦᵀA(ω)Φ. With skew terms that of A(ω)ᵀ is another J, with −g in their place.
class ModeCoupling {
public:
  /// Of the first `count` columns of U, among them those with uᵀEu < 0.
  ModeCoupling(const DenseResponse& response, const OutsideParts& outside, int count,
               double sigma);
  /// Of vectors on which E has as many negative eigenvalues as `modes`.
  /// @return nothing if E has other numbers of them there, or if rounding is too large.
  static std::optional<ModeCoupling> of(const DenseResponse& response,
                                        const OutsideParts& outside,
                                        const VectorsOfV& vectors, int modes,
                                        double sigma);

  /// δ at a frequency, without what was dropped. @param with_given  by what S₀ has beyond 1, too.
  double at(const DenseSystem& system, double omega, bool with_given) const;
  /// δ over an interval: what C = J A_Φ⁻¹ Jᵀ takes at most from the Hermitian part of S;
  /// infinite where A_Φ may be singular.
  double over(const DenseSystem& system, Interval interval) const;
  int count() const { return static_cast<int>(mu_.size()); } ///< columns of Φ

private:
  ModeCoupling() = default;
  void compress();
  ComplexDense A(const ShiftCoefficients& c) const;
  ComplexDense J(std::complex<double> c,
                 const std::vector<std::complex<double>>& g) const;
  std::vector<double> energies() const;
  /// JᴴJ of J = Σ x X, X being G and the F, whose columns are multiplied by `unit`.
  ComplexDense gram(const std::vector<std::complex<double>>& x,
                    const std::vector<double>& unit) const;
  struct Norms {
    double C, left, right; ///< ‖J A⁻¹ J'ᵀ‖, ‖J A⁻¹‖, ‖A⁻¹ J'ᵀ‖ at most, Frobenius
  };
  /// By Gram matrices, which are as small as A. @param x, turned  of J and of J', that of A(ω)ᵀ.
  Norms norms_of(const std::vector<std::complex<double>>& x,
                 const std::vector<std::complex<double>>& turned,
                 const ComplexDense& inverse, const std::vector<double>& unit) const;
  /// ‖J‖_F of it at most.
  double size(const std::vector<std::complex<double>>& x,
              const std::vector<double>& unit) const;

  Dense G_;                  ///< rows: the rest of V, then directions of residuals
  std::vector<Dense> F_, T_; ///< of each term: rows as of G; ΦᵀTΦ
  std::vector<Dense>
      grams_; ///< XᵀX' of G and the F, each with itself and with those behind it
  std::vector<double> mu_;
  double dropped_G_ = 0; ///< norms of what G and F do not hold, and of their rounding
  std::vector<double> dropped_F_, rounding_T_; ///< of each term; of ΦᵀTΦ its rounding
  double tau_ = 0, sigma_ = 0;
};

} // namespace flexgram
