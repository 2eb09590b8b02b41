#pragma once

#include "linalg/dense.hpp"

namespace flexgram {

/// Static condensation of an element's last `internal` dofs: T = [I; −K_aa⁻¹ K_au].
/// @throws Error if they have no stiffness.
Dense condensation(const Dense& K, int internal);
/// K over the other dofs when the internal ones follow, TᵀKT = K_uu − K_ua K_aa⁻¹ K_au.
/// @throws Error if they have no stiffness.
Dense condensed_stiffness(const Dense& K, int internal);
/// Displacements of the internal dofs, K_aa⁻¹ f_a, where the others are held; zeros for these.
Dense internal_response(const Dense& K, int internal, const Dense& load);
/// TᵀAT, symmetric.
Dense condensed(const Dense& a, const Dense& T);

} // namespace flexgram
