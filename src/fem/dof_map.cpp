#include "fem/dof_map.hpp"

#include "base/index.hpp"
#include "base/text.hpp"
#include "fem/couplings.hpp"

#include <bit>

namespace flexgram {
namespace {

long long ll(std::int64_t value) { return static_cast<long long>(value); }

/// Marks the nodes of beams with six dofs; every other used node has three.
void mark_dofs(const Hdf5File& file, const BodyDescription& body, DofMap& map) {
  for (std::size_t node = 0; node < as_size(body.points); ++node)
    if (map.owner[node] >= 0) map.dofs[node] = 3;
  agree(file.comm(), [&] {
    for (const auto& block : body.blocks) {
      if (dofs_per_node(block.type) != 6) continue;
      for (auto node : file.read_all<std::int64_t>(block.path + "/connectivity"))
        map.dofs[as_size(node)] = 6;
    }
  });
}

void require_used(const DofMap& map, const char* kind, const std::string& name,
                  const std::vector<std::int64_t>& nodes) {
  for (auto node : nodes)
    if (map.dofs[as_size(node)] == 0)
      throw Error(text("%s %s: node %lld belongs to no element", kind, name.c_str(),
                       ll(node) + 1));
}

void add_rigid_interface(const Interface& interface, DofMap& map) {
  const int reference = static_cast<int>(map.dofs.size());
  map.dofs.push_back(6);
  map.held.push_back(0);
  map.dependent.push_back(0);
  map.reference.push_back(-1);
  map.owner.push_back(map.owner[as_size(interface.nodes.front())]);
  map.reference_position.push_back(interface.position);
  map.reference_of_interface.push_back(reference);
  for (auto node : interface.nodes) {
    auto& master = map.reference[as_size(node)];
    if (master >= 0)
      throw Error(text("interface %s: node %lld already follows another rigid interface",
                       interface.name.c_str(), ll(node) + 1));
    if (map.held[as_size(node)])
      throw Error(
          text("interface %s: node %lld is also held by a support; a rigid interface "
               "cannot be",
               interface.name.c_str(), ll(node) + 1));
    master = reference;
  }
}

/// @pre the supports and the rigid interfaces are known.
void mark_dependent(const Constraints& constraints, DofMap& map) {
  const auto missing = [&](std::int64_t node, int c) {
    const auto i = as_size(node);
    return c >= (map.reference[i] >= 0 ? 6 : static_cast<int>(map.dofs[i]));
  };
  const auto refuse = [](const char* what, std::int64_t node, int c) {
    throw Error(text("constraint: component %d of node %lld (both from 1) %s", c + 1,
                     ll(node) + 1, what));
  };
  for (const std::int64_t dof : constraints.dof) {
    const std::int64_t node = dof / 6;
    const int c = static_cast<int>(dof % 6);
    if (missing(node, c)) refuse("does not exist: its node has no such dof", node, c);
    if (map.reference[as_size(node)] >= 0)
      refuse("follows a rigid interface and cannot follow a constraint too", node, c);
    if (map.held[as_size(node)] >> c & 1)
      refuse("is held by a support and cannot follow a constraint too", node, c);
    map.dependent[as_size(node)] |= static_cast<std::uint8_t>(1U << c);
  }
  for (const Share& share : constraints.shares)
    if (missing(share.node, share.component))
      refuse("does not exist, and others follow it", share.node, share.component);
  map.constraints = constraints;
}

} // namespace

PetscInt DofMap::equation(std::int64_t node, int c) const {
  const auto i = as_size(node);
  const auto without = static_cast<unsigned>(held[i] | dependent[i]);
  if (c >= dofs[i] || reference[i] >= 0 || (without >> c & 1) || first[i] < 0) return -1;
  return first[i] + c - std::popcount(without & ((1U << c) - 1));
}

int DofMap::equations(std::int64_t node) const {
  const auto i = as_size(node);
  if (reference[i] >= 0) return 0;
  const auto without = static_cast<unsigned>(held[i] | dependent[i]);
  return dofs[i] - std::popcount(without & ((1U << dofs[i]) - 1));
}

bool DofMap::is_held(std::int64_t node, int c) const {
  return c < dofs[as_size(node)] && (held[as_size(node)] >> c & 1);
}

std::vector<Share> DofMap::shares(std::int64_t node, int c,
                                  const Positions& position) const {
  const auto i = as_size(node);
  if (const int master = reference[i]; master >= 0) {
    if (c >= 3) return {{master, c, 1.0}};
    Vector3 arm = position(node);
    for (std::size_t a = 0; a < 3; ++a)
      arm[a] -= reference_position[as_size(master - points)][a];
    const Dense motion = rigid_motion(arm);
    std::vector<Share> of_reference;
    for (int j = 0; j < 6; ++j)
      if (motion(c, j) != 0) of_reference.push_back({master, j, motion(c, j)});
    return of_reference;
  }
  if (!(dependent[i] >> c & 1)) return {{node, c, 1.0}};
  std::vector<Share> all;
  for (const Share& one : constraints.of(node, c))
    for (const Share& of_one : shares(one.node, one.component, position))
      all.push_back({of_one.node, of_one.component, one.factor * of_one.factor});
  return all;
}

DofMap number_equations(const Hdf5File& file, const BodyDescription& body,
                        const Partition& partition) {
  DofMap map;
  map.points = body.points;
  const auto count = as_size(body.points);
  map.owner = partition.node_owner;
  map.dofs.assign(count, 0);
  map.held.assign(count, 0);
  map.dependent.assign(count, 0);
  map.reference.assign(count, -1);
  mark_dofs(file, body, map);
  for (const auto& support : body.supports) {
    require_used(map, "support", support.name, support.nodes);
    for (auto node : support.nodes)
      for (int c : support.components)
        map.held[as_size(node)] |= static_cast<std::uint8_t>(1U << c);
  }
  for (const auto& load : body.loads) require_used(map, "load", load.name, load.nodes);
  for (const auto& output : body.outputs)
    require_used(map, "output", output.name, output.nodes);
  for (const auto& reaction : body.reactions)
    require_used(map, "output", reaction.name, reaction.nodes);
  for (const MeshBlock& block : body.discrete) {
    const bool is_mass = block.type == ElementType::mass1;
    const auto require = [&](const Place& place) {
      require_used(map, is_mass ? "mass" : "spring", block.material, place.nodes);
    };
    if (is_mass) {
      require(body.masses.at(block.material).at);
      continue;
    }
    require(body.springs.at(block.material).from);
    require(body.springs.at(block.material).to);
  }
  for (const auto& interface : body.interfaces) {
    require_used(map, "interface", interface.name, interface.nodes);
    if (interface.coupling == Coupling::rigid)
      add_rigid_interface(interface, map);
    else
      map.reference_of_interface.push_back(-1);
  }
  for (const auto& interface : body.interfaces)
    if (interface.coupling != Coupling::rigid)
      for (auto node : interface.nodes)
        if (map.reference[as_size(node)] >= 0)
          throw Error(text("interface %s: node %lld (0-based) follows a rigid interface",
                           interface.name.c_str(), ll(node)));

  mark_dependent(body.constraints, map);

  const int size = comm_size(file.comm()), rank = comm_rank(file.comm());
  std::vector<PetscInt> next(as_size(size) + 1, 0);
  for (std::size_t i = 0; i < map.dofs.size(); ++i)
    if (map.owner[i] >= 0)
      next[as_size(map.owner[i]) + 1] += map.equations(static_cast<std::int64_t>(i));
  for (std::size_t r = 1; r < next.size(); ++r) next[r] += next[r - 1];
  map.n = next.back();
  map.rows = {next[as_size(rank)], next[as_size(rank) + 1]};
  if (map.n == 0) throw Error("every dof is held: nothing is left to move");
  map.first.assign(map.dofs.size(), -1);
  for (std::size_t i = 0; i < map.dofs.size(); ++i) {
    if (map.owner[i] < 0) continue;
    const int equations = map.equations(static_cast<std::int64_t>(i));
    if (equations == 0) continue;
    PetscInt& start = next[as_size(map.owner[i])];
    map.first[i] = start;
    start += equations;
  }
  return map;
}

} // namespace flexgram
