/// An element's mass at its nodes alone.

#pragma once

#include "fem/description.hpp"
#include "fem/elements.hpp"

namespace flexgram {

/// The mass of each node: by the diagonal of the element's M, which may be lumped already (Hinton, Rock
/// and Zienkiewicz 1976). They have no inertia of their own.
/// @param arms  of the masses from the nodes; empty: they are there.
std::vector<PointMass> nodal_masses(const ElementMatrices& element, int nodes,
                                    const std::vector<Vector3>& arms);

/// What a matrix (6 × 6, or × 9) of each mass gives for all nodes: blocks along the diagonal, or below
/// each other.
Dense blocks_of(const std::vector<PointMass>& masses,
                const std::function<Dense(const PointMass&)>& matrix);

/// M of the masses in the place of the element's, and what lies beside the nodes.
void lump(ElementMatrices& element, const std::vector<PointMass>& masses);

} // namespace flexgram
