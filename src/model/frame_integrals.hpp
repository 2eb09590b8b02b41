#pragma once

#include "linalg/basis.hpp"
#include "model/second_order_model.hpp"

#include <array>

namespace flexgram {

/// What a floating frame of reference needs of a body with the displacement field
/// u(x) = V(x) q, besides the reduced matrices: the coefficients of its mass matrix in
/// eq. (1) of the paper. x is the position in the body's coordinates, about their origin;
/// e_a the unit vectors.
///
/// All are products with the body's own mass matrix M, T and R the nodal values of
/// e_a and e_a × x, G_a that of e_a × u (rotations of nodes turn likewise). They equal
/// the volume integrals below exactly where the dofs are translations; where nodes have
/// rotations (beams, rigidly coupled interfaces) M_r and M_er are exact, and the higher
/// ones neglect the product of a node's rotation with the extent of what it carries.
struct FrameIntegrals {
  double mass = 0;              ///< [kg] of the free dofs
  std::array<double, 3> centre; ///< [m]
  Dense M_r;  ///< 6×6, [T R]ᵀM[T R]; its lower right block is the inertia [kg m²]
  Dense M_er; ///< m×6, VᵀM[T R]
  Dense gyroscopic;    ///< m × 3m, columns (a, k): ∫ρ φ_j · (e_a × φ_k)
  Dense inertia_first; ///< 3 × 3m, columns (b, j): ∫ρ (e_a × x) · (e_b × φ_j)
  Dense inertia_second; ///< 3m × 3m, rows (a, j), columns (b, k): ∫ρ (e_a × φ_j) · (e_b ×
                        ///< φ_k)
  LoadMatrices
      stiffening; ///< m×m, VᵀK_σV of unit loads (Stiffening); none: not asked for
};

/// @param[in] V  n×m basis
/// @pre has_coordinates(model).
/// @note Collective. Where M is the same in three directions it costs as much as two projections on
/// V; what it has beside that, in few rows or in all of them, is projected on 4m vectors.
FrameIntegrals frame_integrals(const SecondOrderModel& model, const Basis& V);

/// Loads of a body that spins with the angular velocity ω, n×6: what ω_x², ω_y², ω_z²,
/// ω_xω_y, ω_yω_z, ω_zω_x are multiplied by, about the centre of mass. As outputs they tell
/// half the change of the moments of inertia by deformation, and all of the products'.
/// With the neglect of FrameIntegrals: what a multibody code makes of these.
/// @pre has_coordinates(model). Collective.
Block spin_loads(const SecondOrderModel& model);

/// Those of the basis V Q, Q: m × k.
FrameIntegrals project(const FrameIntegrals& integrals, const Dense& Q);

} // namespace flexgram
