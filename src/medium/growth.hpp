/// Second half of `certify`: growth by Krylov blocks until the bound holds everywhere in the bands
/// (docs/proof.md, sections 2 to 4).

#pragma once

#include "medium/inverse_norm.hpp"

namespace flexgram {

/// How far a medium model has grown, beside its levels and its space.
struct Growth {
  std::vector<double> grid; ///< [rad/s] where levels are judged
  Block image;    ///< (K − ω_c²M)⁻¹T of the last level: the next Krylov block
  int blocks = 0; ///< after that of the ports
  InverseBounds bounds;
};

/// What the steps of certify have made so far; checkpoints keep it.
struct CertifyState {
  ModalSpace modal;
  Medium medium; ///< with the levels so far; V is in the space
  Growth growth;
};

/// Adds levels to the medium model until the last one meets the target, or until
/// `medium.shortfall` says why none does. A checkpoint is written after each.
/// @param state  with the levels of a checkpoint, if there was one.
/// @note Collective.
void grow(const CertifyRun& run, CertifyState& state);

} // namespace flexgram
