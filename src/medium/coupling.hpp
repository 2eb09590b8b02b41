/// The vectors Φ by which the bound of a body with terms is proved (docs/proof.md, sections 2
/// and 3). Owned by the certificate.

#pragma once

#include "medium/mode_coupling.hpp"

namespace flexgram {

/// δ of a body with terms, by the vectors Φ that make it small.
///
/// Φ may be any vectors of V on which E has as many negative eigenvalues as modes lie below the
/// cutoff. Tried are the first columns of U: with more of them less of what terms couple is
/// outside, but their residuals are larger; and such columns with E⁻¹T of them, as V holds it, for
/// each term: then what T couples them to is inside, however large g is. Those with the smallest δ
/// at some frequencies are taken. Where they leave much at a resonance with the terms, as with
/// large values of parameters, the vectors with vᵀEv < 0 of E v = e P v at its frequency join
/// them, P being what the terms and M add to E there: these are coupled to nothing else in V.
class TermCoupling {
public:
  TermCoupling() = default; ///< none is known: nothing is proved
  TermCoupling(const DenseResponse& response, const OutsideParts& outside, int modes,
               double sigma);

  /// δ over an interval; infinite where nothing is known.
  double over(const DenseSystem& system, Interval interval) const;

private:
  std::vector<ModeCoupling> everywhere_; ///< one, or none
  struct At {
    double omega;
    ModeCoupling coupling;
  };
  std::vector<At> at_; ///< in ascending order
};

} // namespace flexgram
