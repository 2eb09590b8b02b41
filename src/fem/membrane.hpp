/// Membranes: surfaces that resist stretching alone, three dofs a node.

#pragma once

#include "fem/shell.hpp"

namespace flexgram {

bool is_membrane(ElementType type);
/// K of the stretching of a shell's law and consistent M. A quadrilateral has the incompatible modes
/// of the shell of its shape.
/// @throws Error if its middle surface is not at the nodes.
ElementMatrices membrane_matrices(ElementType type, const std::vector<Vector3>& nodes,
                                  const ShellLaw& law, const ShellPlace& place,
                                  bool with_stiffness);
/// As shell_part_stiffness.
Dense membrane_part_stiffness(ElementType type, const std::vector<Vector3>& nodes,
                              const ShellLaw& law, const ShellLaw& part,
                              const ShellPlace& place);
/// As shell_strains, over three dofs a node; curvatures are zero.
std::vector<ShellStrainPoint> membrane_strains(ElementType type,
                                               const std::vector<Vector3>& nodes,
                                               const ShellLaw& law,
                                               const ShellPlace& place);
/// As hold_shell.
HeldShell hold_membrane(ElementType type, const std::vector<Vector3>& nodes,
                        const ShellLaw& law, const ShellPlace& place,
                        const std::vector<Dense>& resultants);
/// The shell of its shape; of others what they are.
ElementType surface_of(ElementType type);
/// Of six numbers a node the three displacements, in rows and columns.
Dense of_displacements(const Dense& six);
/// Of six numbers a node, in one column, the three of displacements.
Dense displacements_of(const Dense& six);
/// Displacements with rotations of zero.
std::vector<double> with_rotations(const std::vector<double>& u);

} // namespace flexgram
