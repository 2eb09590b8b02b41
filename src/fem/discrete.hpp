/// Masses and springs at nodes: elements without a shape. What their matrices are, and where they are.

#pragma once

#include "fem/dof_map.hpp"
#include "fem/mesh.hpp"

namespace flexgram {

/// Adds those of the file to the description.
/// @throws Error for numbers that no mass or spring has.
void read_discrete(const Hdf5File& file, BodyDescription& body);
/// What bounds gyroscopic moments by the mass holds for inertias that bodies can have.
/// @throws Error for masses with others.
void expect_inertias_of_bodies(const Hdf5File& file, const BodyDescription& body);

/// Whether it is a point mass or a spring.
bool is_discrete(ElementType type);
bool is_spring(ElementType type);

/// M of a point mass, 6×6 over u and θ of its node.
Dense mass_matrix(const PointMass& mass);
/// Whether its centre is not at its node.
bool is_beside(const PointMass& mass);
/// Moments in an acceleration A r of what it consists of, 6 × 9, as ElementMatrices::beside.
Dense mass_beside(const PointMass& mass);
/// K, or what else a 6×6 matrix of forces over relative displacements makes, of a spring between two
/// nodes that acts midway between them, each end moving with its node; or of one to ground.
/// @param x  one node or two.
Dense spring_matrix(const Dense& of_motion, const std::vector<Vector3>& x);

/// By what a spin about `axis` softens a point mass, for Ω² = 1: as of a beam, turned by finite
/// angles.
/// @param axis  of unit length.
Dense mass_spin_softening(const PointMass& mass, const Vector3& axis);
/// Its Coriolis forces and gyroscopic moments in a frame that spins about `axis`, for Ω = 1: 2m[e ×],
/// and tr(J)[e ×] − 2[Je ×] for the inertia J.
Dense mass_coriolis(const PointMass& mass, const Vector3& axis);
/// Its gyroscopic moment on the axis of a spin of 1 rad/s, in the frame at rest; skew, no larger than
/// twice its mass. @param point  on the axis.
/// @throws Error if it lies elsewhere, or if it is not symmetric about the axis.
Dense mass_gyroscopic(const PointMass& mass, const Vector3& x, const Vector3& axis,
                      const Vector3& point);

/// Springs to ground that are other ones where the ground does not turn with a body that spins about
/// `axis`: those with dashpots, and those that are not symmetric about it.
std::vector<std::string> springs_of_a_turning_ground(const BodyDescription& body,
                                                     const Vector3& axis);

/// @throws Error if entries of an element's matrix belong to rotations that its nodes do not have.
void expect_rotations(const DofMap& map, const std::int64_t* nodes, std::size_t count,
                      const Dense& matrix, const std::string& name);

/// Nodes of masses and springs, those of the mesh.
std::vector<std::int64_t> discrete_nodes(const BodyDescription& body);
/// Those of this rank become elements of its mesh. An interface's reference is a node of its own.
/// @pre the coordinates of `discrete_nodes` are in the mesh.
void add_discrete(const BodyDescription& body, const DofMap& map, int rank,
                  LocalMesh& mesh);

} // namespace flexgram
