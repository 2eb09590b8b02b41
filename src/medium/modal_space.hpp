/// First half of `certify`: the space with the response to the ports, rigid modes, and all
/// modes below the cutoff (docs/proof.md, section 2, and section 6, "Inertia").

#pragma once

#include "medium/certify_run.hpp"
#include "medium/space.hpp"

namespace flexgram {

/// The space that holds every mode below the cutoff; growth and certificates go on from it.
struct ModalSpace {
  std::unique_ptr<MediumSpace> space;
  Block loads;               ///< all ports, inputs first, scaled
  std::vector<double> scale; ///< of each port
  double cutoff = 0;         ///< ω_c [rad/s]
  int elastic = 0;           ///< modes below it, by inertia
  bool exact = false;        ///< found exactly, not only as far as the certificate needs
  int judged_elastic = 0;    ///< slow modes that were found to be no rigid ones
  bool inertia_is_safe = false;
  /// λ [rad²/s²] of good modes, where Lanczos has filled the space; and its solves.
  std::optional<std::vector<double>> found;
  int solves = 0;

  int rigid() const { return space->rigid(); }
  int modes() const { return rigid() + elastic; } ///< below the cutoff
  /// λ [rad²/s²] up to which a mode is so slow that it may be rigid.
  double slow() const { return 1e-5 * cutoff * cutoff; }
};

/// @param omega  [rad/s] the cutoff is chosen near it; after that it is held by run.factors.
/// @param exact  modes are found exactly.
/// @throws MiscountError if search and inertia disagree at three cutoffs; Error if the body
/// is free and the band starts at 0 Hz, or if more modes are below than may be kept.
/// @note Collective.
ModalSpace find_modal_space(const CertifyRun& run, double omega, bool mass_is_singular,
                            bool exact);

/// The factors of K − ω_c²M, unless they still are at hand.
void hold_cutoff(const CertifyRun& run, ModalSpace& modal);

/// The response of the space, in the coordinates of its Ritz vectors.
std::shared_ptr<const DenseResponse> ritz_response(const CertifyRun& run,
                                                   const ModalSpace& modal);

} // namespace flexgram
