/// All modes below the cutoff by block Rayleigh-Ritz with the shift-inverted operator
/// (the residual as in subspace iteration; Parlett 1998, chapter 14). Called by
/// modal_space.cpp, null_vectors.cpp.

#pragma once

#include "base/observer.hpp"
#include "medium/factors.hpp"
#include "medium/space.hpp"

#include <optional>

namespace flexgram {

/// What is found and what the inertia counts disagree: an eigenvalue lies on the cutoff,
/// or the factorisation is poor.
class MiscountError : public Error {
  using Error::Error;
};

/// Extends the space until it holds every mode of (K, M) below sigma, each to an angle of
/// about `enough`. Block Krylov and
/// Rayleigh-Ritz with the shift-inverted operator S = (K − σM)⁻¹M: for a
/// Ritz pair (λ, φ) the part of (λ − σ) S φ outside the space is what the space lacks,
/// and measures the angle: modes below σ have negative eigenvalues 1/(λ − σ) of S, all
/// others positive ones, so clusters do no harm. Each round applies S to the last block of
/// the space; if that is wide, to the Ritz vectors that are not yet good and the next ones
/// above σ; and to random vectors where a round found no further mode.
/// How exact the modes are in the end is proved by the certificate, not here.
/// @param[in] factor    holds K − σM.
/// @param[in] expected  modes below σ by Sylvester's law, without the rigid modes of the
///                      space. No more can be found (Cauchy), and no fewer will do.
/// @param[in] null      K is indefinite if an eigenvalue lies below −null.
/// @param[in] known     of a space that another search has filled: eigenvalues whose vectors are
///                      good enough. Its last block is then no Krylov block.
/// @return right-hand sides solved.
/// @throws MiscountError if a mode that the inertia counts cannot be found, or if there
/// are more; Error if K is indefinite.
/// @note Collective.
/// @pre the last block of the space is S applied to something, such as the response to
/// loads at σ.
int find_modes(MediumSpace& space, RealFactors& factors, double sigma, int expected,
               double enough, double null, Observer& observer,
               std::optional<std::vector<double>> known = {});

/// Eigenvalues of (K, M) in the space without its rigid modes, ascending, and the Ritz
/// vectors as columns in the coordinates of V, W-orthonormal.
struct RitzPairs {
  std::vector<double> lambda;
  Dense vectors;
};
RitzPairs ritz_pairs(const MediumSpace& space);

} // namespace flexgram
