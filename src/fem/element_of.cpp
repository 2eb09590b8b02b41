#include "fem/element_of.hpp"

#include "base/error.hpp"
#include "fem/discrete.hpp"
#include "fem/lumped_mass.hpp"
#include "fem/membrane.hpp"
#include "fem/shell.hpp"
#include "fem/shell_kinematics.hpp"
#include "fem/vectors.hpp"

namespace flexgram {
namespace {

int dofs_of(const MeshBlock& block) {
  return node_count(block.type) * dofs_per_node(block.type);
}

bool weighs_nothing(ElementType type) {
  return is_spring(type) || type == ElementType::node1;
}

struct Shell {
  std::vector<ShellLayer> layers;
  ShellLaw law;
  ShellPlace place;
};

Shell shell_of(const BodyDescription& body, const PlacedElement& at) {
  const MeshBlock& block = at.block();
  const ShellSection& section = body.shells.at(block.section);
  Shell shell;
  const std::vector<SectionLayer> layers = layers_of(body, block);
  for (const SectionLayer& layer : layers) {
    const Material& material = body.materials.at(layer.material);
    shell.layers.push_back({material.in_own_axes.stiffness, material.solid.density,
                            layer.thickness, layer.angle, layer.role, layer.factor,
                            layer.sides, material.in_own_axes.expansion});
    shell.place.isotropic = shell.place.isotropic && material.isotropic;
  }
  shell.law = shell_law(shell.layers);
  shell.place.offset = section.offset;
  for (const SectionLayer& layer : layers) // that of the first with fibres
    if (const Material& material = body.materials.at(layer.material);
        !material.isotropic) {
      shell.place.axis_1 = material.axis_1;
      break;
    }
  if (section.axis_1) shell.place.axis_1 = *section.axis_1;
  if (!at.axes.empty())
    std::copy_n(at.axes.front().begin(), 3, shell.place.axis_1.begin());
  return shell;
}

std::vector<SolidMaterial> solid_of(const Material& material, const PlacedElement& at) {
  if (at.axes.empty() || material.isotropic) return {material.solid};
  std::vector<SolidMaterial> materials;
  for (const auto& axes : at.axes)
    materials.push_back(turned(material.in_own_axes, with_third(axes)));
  return materials;
}

bool is_lumped(const BodyDescription& body, const PlacedElement& at) {
  return body.mass_rule == MassRule::lumped && !is_discrete(at.block().type);
}

std::vector<PointMass> masses_of(const BodyDescription& body, const PlacedElement& at,
                                 const ElementMatrices& element) {
  const MeshBlock& block = at.block();
  std::vector<Vector3> arms;
  if (is_shell(block.type)) {
    const Shell shell = shell_of(body, at);
    const double height = shell.place.offset + shell.law.first / shell.law.mass;
    if (shell.law.mass > 0 && height != 0) {
      arms = ShellShape(surface_of(block.type), at.x).normals;
      for (Vector3& arm : arms)
        for (double& x : arm) x *= height;
    }
  }
  return nodal_masses(element, node_count(block.type), arms);
}

/// Half the inertia of a beam that turns about itself, to M of each end. It has no part in the forces of
/// a spin, of which those of the other two axes would be as large.
void add_torsional_inertia(const BodyDescription& body, const PlacedElement& at,
                           ElementMatrices& element) {
  const BeamSection& section = body.sections.at(at.block().section);
  Vector3 axis;
  for (std::size_t c = 0; c < 3; ++c) axis[c] = at.x[1][c] - at.x[0][c];
  const double polar = (section.I_y + section.I_z) / section.A,
               half = 0.5 * section.torsional_inertia * element.mass * polar /
                      dot(axis, axis);
  for (const int end : {3, 9})
    for (int i = 0; i < 3; ++i)
      for (int j = 0; j < 3; ++j)
        element.M(end + i, end + j) += half * axis[as_size(i)] * axis[as_size(j)];
}

/// As it is without lumped mass.
ElementMatrices consistent_matrices(const BodyDescription& body, const PlacedElement& at,
                                    bool with_stiffness) {
  const MeshBlock& block = at.block();
  const std::vector<Vector3>& x = at.x;
  if (is_discrete(block.type)) {
    ElementMatrices element;
    element.K = element.M = Dense(dofs_of(block), dofs_of(block));
    element.min_detJ = 1;
    if (block.type == ElementType::node1) {
      element.beside = Dense(6, 9);
    } else if (is_spring(block.type)) {
      element.K = spring_matrix(body.springs.at(block.material).stiffness, x);
    } else {
      const PointMass& mass = body.masses.at(block.material);
      element.M = mass_matrix(mass);
      element.beside = mass_beside(mass);
      element.mass = mass.mass;
    }
    return element;
  }
  if (is_shell(block.type)) {
    Shell shell = shell_of(body, at);
    if (is_lumped(body, at)) shell.law.second = 0; // which is no share of a node
    if (is_membrane(block.type))
      return membrane_matrices(block.type, x, shell.law, shell.place, with_stiffness);
    return shell_matrices(block.type, x, shell.law, shell.place, with_stiffness);
  }
  const Material& material = body.materials.at(block.material);
  if (block.type == ElementType::rod2)
    return rod_matrices(x[0], x[1], material.beam, body.sections.at(block.section).A);
  return block.type == ElementType::beam2
             ? beam_matrices(x[0], x[1], material.beam, body.sections.at(block.section))
             : solid_matrices(block.type, x, solid_of(material, at), body.mass_rule,
                              with_stiffness);
}

} // namespace

ElementMatrices element_matrices(const BodyDescription& body, const PlacedElement& at,
                                 bool with_stiffness) {
  ElementMatrices element = consistent_matrices(body, at, with_stiffness);
  if (!is_lumped(body, at) || !(element.min_detJ > 0)) return element;
  lump(element, masses_of(body, at, element));
  if (at.block().type == ElementType::beam2) add_torsional_inertia(body, at, element);
  return element;
}

Dense stiffness_of_material(const BodyDescription& body, const PlacedElement& at,
                            const std::string& material) {
  const MeshBlock& block = at.block();
  const std::vector<Vector3>& x = at.x;
  const Shell shell = shell_of(body, at);
  std::vector<bool> counts;
  for (const SectionLayer& layer : layers_of(body, block))
    counts.push_back(layer.material == material);
  if (is_membrane(block.type))
    return membrane_part_stiffness(block.type, x, shell.law,
                                   part_of_law(shell.layers, counts), shell.place);
  return shell_part_stiffness(block.type, x, shell.law, part_of_law(shell.layers, counts),
                              shell.place);
}

Dense spin_softening(const BodyDescription& body, const PlacedElement& at,
                     const ElementMatrices& element, const Vector3& axis) {
  const MeshBlock& block = at.block();
  const std::vector<Vector3>& x = at.x;
  if (weighs_nothing(block.type)) return Dense(dofs_of(block), dofs_of(block));
  if (block.type == ElementType::mass1)
    return mass_spin_softening(body.masses.at(block.material), axis);
  if (is_lumped(body, at) && dofs_per_node(block.type) == 6)
    return blocks_of(masses_of(body, at, element), [&](const PointMass& one) {
      return mass_spin_softening(one, axis);
    });
  if (is_shell(block.type) && !is_membrane(block.type)) {
    const Shell shell = shell_of(body, at);
    return shell_spin_softening(block.type, x, shell.law, shell.place, axis);
  }
  return block.type == ElementType::beam2
             ? beam_spin_softening(x[0], x[1], body.materials.at(block.material).beam,
                                   body.sections.at(block.section), axis)
             : solid_spin_softening(element, axis);
}

Dense coriolis(const BodyDescription& body, const PlacedElement& at,
               const ElementMatrices& element, const Vector3& axis) {
  const MeshBlock& block = at.block();
  const std::vector<Vector3>& x = at.x;
  if (weighs_nothing(block.type)) return Dense(dofs_of(block), dofs_of(block));
  if (block.type == ElementType::mass1)
    return mass_coriolis(body.masses.at(block.material), axis);
  if (is_lumped(body, at) && dofs_per_node(block.type) == 6)
    return blocks_of(masses_of(body, at, element),
                     [&](const PointMass& one) { return mass_coriolis(one, axis); });
  if (is_shell(block.type) && !is_membrane(block.type)) {
    const Shell shell = shell_of(body, at);
    return shell_coriolis(block.type, x, shell.law, shell.place, axis);
  }
  return block.type == ElementType::beam2
             ? beam_coriolis(x[0], x[1], body.materials.at(block.material).beam,
                             body.sections.at(block.section), axis)
             : solid_coriolis(element, axis);
}

Convection convection(const BodyDescription& body, const PlacedElement& at,
                      const ElementMatrices& element, const AccelerationField& spin) {
  const MeshBlock& block = at.block();
  const std::vector<Vector3>& x = at.x;
  const Dense none(dofs_of(block), dofs_of(block));
  if (weighs_nothing(block.type)) return {none, none};
  if (block.type == ElementType::mass1)
    return {mass_gyroscopic(body.masses.at(block.material), x[0], spin.axis, spin.point),
            none};
  if (is_lumped(body, at))
    throw Error("in the frame at rest a spin takes consistent mass, not a lumped one "
                "(mass_integration; or frame: turning)");
  if (block.type == ElementType::beam2)
    return {beam_gyroscopic(x[0], x[1], body.materials.at(block.material).beam,
                            body.sections.at(block.section), spin.axis, spin.point),
            none};
  if (!is_solid(block.type))
    throw Error("in the frame at rest a spin takes solids of revolution, and beams and "
                "masses on its axis; others are seen in the frame that turns (frame: "
                "turning)");
  const Material& material = body.materials.at(block.material);
  if (!material.isotropic)
    throw Error("in the frame at rest a spin takes isotropic materials: the axes of "
                "others turn with the body (frame: turning)");
  return solid_convection(block.type, x, material.solid.density, body.mass_rule,
                          element.T, spin.axis, spin.point);
}

namespace {

/// Strain without stress along a beam or a rod.
double free_along(const FreeStrain* free, const Material& material,
                  const std::vector<Vector3>& x) {
  if (!free) return 0;
  std::array<double, 6> strain = free->uniform;
  if (!free->temperature.empty()) {
    if (!material.solid.expansion)
      throw Error("its material, which a temperature warms, has no expansion");
    for (std::size_t r = 0; r < 6; ++r)
      strain[r] += 0.5 * (free->temperature[0] + free->temperature[1]) *
                   (*material.solid.expansion)[r];
  }
  Vector3 t{};
  double square = 0;
  for (std::size_t c = 0; c < 3; ++c) {
    t[c] = x[1][c] - x[0][c];
    square += t[c] * t[c];
  }
  double along = 0; // engineering shears
  for (std::size_t c = 0; c < 3; ++c) {
    const std::size_t next = (c + 1) % 3;
    along += strain[c] * t[c] * t[c] + strain[3 + c] * t[c] * t[next];
  }
  return along / square;
}

} // namespace

StressStiffness stress_stiffness(const BodyDescription& body, const PlacedElement& at,
                                 const std::vector<double>& u, const FreeStrain* free,
                                 Deformation& deformation) {
  const MeshBlock& block = at.block();
  const std::vector<Vector3>& x = at.x;
  if (is_discrete(block.type))
    return {Dense(dofs_of(block), dofs_of(block)), Dense(dofs_of(block), dofs_of(block))};
  if (is_shell(block.type)) {
    if (free && free->uniform != std::array<double, 6>{})
      throw Error("a pretension acts on it, which is one of solids, beams and rods");
    const Shell shell = shell_of(body, at);
    if (!is_membrane(block.type))
      return shell_stress_stiffness(block.type, x, shell.layers, shell.place, u, free,
                                    deformation);
    const StressStiffness six =
        shell_stress_stiffness(surface_of(block.type), x, shell.layers, shell.place,
                               with_rotations(u), free, deformation);
    return {of_displacements(six.linear), of_displacements(six.quadratic),
            displacements_of(six.free)};
  }
  const Material& material = body.materials.at(block.material);
  if (block.type == ElementType::rod2)
    return rod_stress_stiffness(x[0], x[1], material.beam,
                                body.sections.at(block.section).A, u,
                                free_along(free, material, x), deformation.stress);
  return block.type == ElementType::beam2
             ? beam_stress_stiffness(x[0], x[1], material.beam,
                                     body.sections.at(block.section), u,
                                     free_along(free, material, x), deformation.stress)
             : solid_stress_stiffness(block.type, x, solid_of(material, at), u, free,
                                      deformation);
}

Dense geometric_stiffness(const BodyDescription& body, const PlacedElement& at,
                          const std::vector<double>& u) {
  const MeshBlock& block = at.block();
  const std::vector<Vector3>& x = at.x;
  if (is_shell(block.type)) {
    const Shell shell = shell_of(body, at);
    if (!is_membrane(block.type))
      return shell_geometric_stiffness(block.type, x, shell.law, shell.place, u);
    return of_displacements(shell_geometric_stiffness(
        surface_of(block.type), x, shell.law, shell.place, with_rotations(u)));
  }
  if (!is_discrete(block.type) && block.type != ElementType::beam2 &&
      block.type != ElementType::rod2)
    return solid_geometric_stiffness(block.type, x,
                                     solid_of(body.materials.at(block.material), at), u);
  Deformation unused;
  return stress_stiffness(body, at, u, nullptr, unused).linear;
}

} // namespace flexgram
