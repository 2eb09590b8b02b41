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

/// Which combinations of M-orthonormal vectors K does not resist: a body on soft springs
/// is not free. φᵀKφ is summed with twice the digits, so it is that of the stored K; it is no
/// stiffness if it is within what rounding of K's entries leaves (16 times ε √Σ(φ_i K_ij
/// φ_j)², ε that of doubles or of the printed digits of a text file, and 4 ε φᵀdiag(K)φ,
/// since roundings of an assembly are not independent), or of the size of
/// negative ones, and never above 256 ε φᵀdiag(K)φ. Vectors that were computed have some
/// energy of their own errors: they may have 16 ε φᵀdiag(K)φ.
struct RigidSplit {
  Dense rotation; ///< orthogonal; the first `count` columns give the rigid vectors
  int count = 0;
  Dense stiffness; ///< ΦᵀKΦ of these
  /// That is within the rounding of doubles: a truly free body could look like it.
  bool explained = true;
};
/// @param vectors  of more than eight the first are looked at. Collective.
RigidSplit split_rigid(const SecondOrderModel& model, const Block& vectors,
                       bool computed);

/// Three translations and three rotations about `centre`, the latter divided by `radius`:
/// n×6.
/// @pre has_coordinates(model).
Block rigid_motions(const SecondOrderModel& model, const std::array<double, 3>& centre,
                    double radius);

/// Rigid body modes from geometry: those combinations of three translations and three
/// rotations of the nodes that K does not resist (supports leave fewer than six).
/// @return n × (0 … 6), M-orthonormal; no columns if the body has no coordinates.
/// @param split  if given, what was found of them.
/// @note Collective.
Block rigid_body_modes(const SecondOrderModel& model, RigidSplit* split = nullptr);

/// The same for a body without coordinates: the null space of K by inverse iteration with
/// K − s₀M, s₀ the rigid threshold, whose inertia says how many there are. One
/// factorisation.
Block null_space_modes(const SecondOrderModel& model, SolverOptions options);

/// How far the six motions of the nodes are from costing no energy: the largest
/// φᵀKφ / φᵀdiag(K)φ. Near 1e-16 for a free body, up to the square of what its printed
/// coordinates have lost; above 1e-6 they are not its coordinates. Collective.
double misfit_of_positions(const SecondOrderModel& model);

/// From geometry where there are coordinates, else from the null space.
bool has_coordinates(const SecondOrderModel& model);

} // namespace flexgram
