/// The cutoff of `certify`: the shift of its one factorisation (docs/proof.md, section 2).
/// Called by modal_space.cpp.

#pragma once

#include "medium/certify_run.hpp"
#include "medium/port_loads.hpp"

namespace flexgram {

/// A cutoff at which the factors of K − ω_c²M are at hand.
struct Cutoff {
  double omega = 0; ///< ω_c [rad/s]
  int below = 0;    ///< modes below it by inertia, rigid ones included
  double kappa = 0; ///< inner product M + κK of the space: not 0 where M is singular
  Block response; ///< (K − ω_c²M)⁻¹ of all ports, and of random loads beside few ones
};

/// Factorises K − ω_c²M with ω_c near `omega`, away from eigenvalues and with as many modes
/// below as are wanted, and solves for all ports.
/// @param balanced  the ports' loads, self-equilibrated.
/// @param rigid     modes of the body that the geometry tells.
/// @throws Error if K and M share null vectors, or if the ports move nothing.
/// @note Collective.
Cutoff choose_cutoff(const CertifyRun& run, const PortLoads& ports, const Block& balanced,
                     int rigid, double omega, bool mass_is_singular);

} // namespace flexgram
