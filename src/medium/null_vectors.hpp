/// Rigid modes of bodies whose geometry does not tell them: null vectors of K among the modes
/// (docs/proof.md, section 6). Called by modal_space.cpp.

#pragma once

#include "medium/modal_space.hpp"

namespace flexgram {

/// Modes so slow that they may be rigid, which no geometry told: sharpened by a
/// factorisation of their own, K + sM with s far below the elastic modes, and judged.
/// Null vectors of K become rigid modes of the space; `elastic` and `judged_elastic` follow.
/// @pre the space holds all modes below the cutoff. @note Collective.
void take_out_null_vectors(const CertifyRun& run, ModalSpace& modal);

} // namespace flexgram
