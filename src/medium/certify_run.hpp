/// What every step of `certify` is given. The steps: cutoff, modal_space, null_vectors,
/// inverse_norm, level_judge, level_certifier, growth.

#pragma once

#include "medium/factors.hpp"
#include "medium/medium.hpp"
#include "model/softening.hpp"

namespace flexgram {

class Checkpoints;

/// One run of certify: the body, what is asked of it, and what is at hand for it.
struct CertifyRun {
  const SecondOrderModel& fom;
  const CertifySpec& spec;
  Observer& observer;
  RealFactors& factors;
  Checkpoints& checkpoints;
  double reference = 0; ///< [rad/s] the certificate must hold up to here
  double tau = 0; ///< [rad²/s²] rows of residuals are scaled by the diagonal of K + τM
  Softening softening = {};

  /// What the user allows, or what memory does: V, S and one more of that size. Collective.
  int largest_order() const;
  /// Columns of the body's length that a search may keep. Collective.
  int columns_in_memory() const;
  /// Who says that the medium model may not be larger.
  std::string why_no_larger() const;
};

} // namespace flexgram
