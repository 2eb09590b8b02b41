#pragma once

#include "model/second_order_model.hpp"

#include <array>

namespace flexgram {

/// ‖K‖∞ over the mean diagonal of M [rad²/s²]: eigenvalues of rigid modes are zero up to
/// this times the rounding of K. (The largest eigenvalue would not do: one light dof
/// makes it any size.) @throws Error if M is zero. Collective.
double eigenvalue_scale(const SecondOrderModel& model);

/// Eigenvalues of (K, M) below this may be those of rigid modes [rad²/s²]; is_rigid
/// decides.
double rigid_threshold(const SecondOrderModel& model);

/// Whether the stiffness λ = φᵀKφ of an M-normalised vector is no more than what the
/// rounding of K leaves, c ε φᵀdiag(K)φ: a body on soft springs is not free.
bool is_rigid(const SecondOrderModel& model, const Block& phi, double lambda);

/// Three translations and three rotations about `centre`, the latter divided by `radius`:
/// n×6.
/// @pre has_coordinates(model).
Block rigid_motions(const SecondOrderModel& model, const std::array<double, 3>& centre,
                    double radius);

/// Rigid body modes from geometry: those combinations of three translations and three
/// rotations of the nodes that K does not resist (supports leave fewer than six).
/// @return n × (0 … 6), M-orthonormal; no columns if the body has no coordinates.
/// @note Collective.
Block rigid_body_modes(const SecondOrderModel& model);

/// The same for a body without coordinates: the null space of K by inverse iteration with
/// K − s₀M, s₀ the rigid threshold, whose inertia says how many there are. One
/// factorisation.
Block null_space_modes(const SecondOrderModel& model, SolverOptions options);

/// From geometry where there are coordinates, else from the null space.
bool has_coordinates(const SecondOrderModel& model);

} // namespace flexgram
