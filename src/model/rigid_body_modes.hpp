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
/// is not free. φᵀKφ is summed with twice the digits, so it is that of the stored K. It counts
/// as rounding, not stiffness, if it is at most
///   - 16 ε √Σ(φ_i K_ij φ_j)² or 4 ε φᵀdiag(K)φ (roundings of an assembly are not independent),
///     ε that of doubles, or a quarter of SecondOrderModel::rounding if that is larger;
///   - or 24 ε_r √Σ(φ_i K_ij φ_j)², where ε_r is the median over the rows of
///     |Kφ|_i / √Σ_j(K_ij φ_j)², and the rows' signs are random (|φᵀKφ| at most eight times
///     √Σ(φ_i (Kφ)_i)²): entries printed with few digits leave forces of random sign in every
///     row, soft mounts leave forces in few rows, a soft foundation forces of one sign;
///   - or three times the size of a negative one;
/// and never above 256 ε φᵀdiag(K)φ (24 ε_r φᵀdiag(K)φ). Computed vectors have some energy of
/// their own errors: 16 ε φᵀdiag(K)φ is allowed, and (4 ε)² of `eigenvalue_scale`, for a mass that
/// nothing holds at all. None of this depends on the order of the rows or on a factor of K.
struct RigidSplit {
  Dense rotation; ///< orthogonal; the first `count` columns give the rigid vectors
  int count = 0;
  Dense stiffness; ///< ΦᵀKΦ of these
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
