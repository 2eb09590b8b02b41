/// Matrices of an element of a body, whatever it is: solid, beam, point mass or spring.

#pragma once

#include "fem/followers.hpp"

namespace flexgram {

/// @param with_stiffness  false, of what does not strain: a solid's K is left out, and M of a Hex8 has
///                        no incompatible modes.
ElementMatrices element_matrices(const BodyDescription& body, const PlacedElement& at,
                                 bool with_stiffness = true);
/// What a material of a shell's layers gives of its K.
Dense stiffness_of_material(const BodyDescription& body, const PlacedElement& at,
                            const std::string& material);
/// By what a spin about `axis` softens it, for Ω² = 1.
Dense spin_softening(const BodyDescription& body, const PlacedElement& at,
                     const ElementMatrices& element, const Vector3& axis);
/// Its Coriolis forces in a frame that spins about `axis`, for Ω = 1.
Dense coriolis(const BodyDescription& body, const PlacedElement& at,
               const ElementMatrices& element, const Vector3& axis);
/// What a spin of 1 rad/s does to it in the frame at rest: gyroscopic moments on the axis of what has
/// rotations, solids of revolution as matter that runs through.
/// @throws Error for shells, and for what cannot be symmetric about the axis.
Convection convection(const BodyDescription& body, const PlacedElement& at,
                      const ElementMatrices& element, const AccelerationField& spin);
/// What displacements of its dofs, and strain without stress, add to its stiffness; springs keep
/// theirs. @param free  null: there is none. @throws Error for one of what is no solid.
StressStiffness stress_stiffness(const BodyDescription& body, const PlacedElement& at,
                                 const std::vector<double>& u, const FreeStrain* free,
                                 Deformation& deformation);
/// What their stress adds, without moved geometry.
Dense geometric_stiffness(const BodyDescription& body, const PlacedElement& at,
                          const std::vector<double>& u);

} // namespace flexgram
