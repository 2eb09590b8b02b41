#include "fem/couplings.hpp"

#include "base/index.hpp"
#include "base/text.hpp"
#include "linalg/decompositions.hpp"

#include <algorithm>
#include <cmath>

namespace flexgram {

Dense rigid_motion(const Vector3& d) {
  Dense G(3, 6);
  for (int c = 0; c < 3; ++c) G(c, c) = 1;
  // u = θ × d
  G(0, 4) = d[2];
  G(0, 5) = -d[1];
  G(1, 3) = -d[2];
  G(1, 5) = d[0];
  G(2, 3) = d[1];
  G(2, 4) = -d[0];
  return G;
}

namespace {

constexpr const char* component_names[6] = {"fx", "fy", "fz", "mx", "my", "mz"};

struct Entry {
  PetscInt row;
  int column;
  double value;
};

/// Of the components that are free.
void add_unit_loads(const Interface& interface, const DofMap& map, std::int64_t node,
                    const Positions& position, Ports& ports,
                    std::vector<Entry>& entries) {
  std::vector<std::string>& names = ports.names;
  std::string held;
  const std::size_t first = names.size();
  for (int c = 0; c < map.dofs[as_size(node)]; ++c) {
    const std::size_t before = entries.size();
    for (const Share& share : map.shares(node, c, position)) {
      const PetscInt row = map.equation(share.node, share.component);
      if (row >= 0)
        entries.push_back({row, static_cast<int>(names.size()), share.factor});
    }
    if (entries.size() == before)
      held += (held.empty() ? "" : ", ") + std::string(component_names[c]);
    else
      names.push_back(interface.name + "." + component_names[c]);
  }
  if (held.empty()) return;
  if (names.size() == first)
    throw Error(text("interface %s: all its components are held by supports, or by "
                     "equations: no force can act there",
                     interface.name.c_str()));
  ports.remarks.push_back(text("%s: no port %s, held by supports or by equations",
                               interface.name.c_str(), held.c_str()));
}

/// Motion of each node of the set under the six motions of the reference.
std::vector<Dense> motions(const Interface& interface, const Positions& position) {
  std::vector<Dense> result;
  for (auto node : interface.nodes) {
    Vector3 d = position(node);
    for (std::size_t a = 0; a < 3; ++a) d[a] -= interface.position[a];
    result.push_back(rigid_motion(d));
  }
  return result;
}

/// Gᵀ W G.
Dense normal_matrix(const Interface& interface, const std::vector<Dense>& motion) {
  Dense normal(6, 6);
  for (std::size_t k = 0; k < motion.size(); ++k) {
    const double weight = interface.weights.empty() ? 1.0 : interface.weights[k];
    const Dense part = multiply_transposed(motion[k], motion[k]);
    for (std::size_t i = 0; i < 36; ++i) normal.data[i] += weight * part.data[i];
  }
  return normal;
}

/// @throws Error if the nodes lie on a line or in a point. Judged in lengths of the set's
/// own size, so that millimetres do not look singular.
void require_six_motions(const Interface& interface, const Dense& normal) {
  const auto scale = [&](int i) {
    return normal(i, i) > 0 ? 1 / std::sqrt(normal(i, i)) : 0.0;
  };
  Dense scaled = normal;
  for (int i = 0; i < 6; ++i)
    for (int j = 0; j < 6; ++j) scaled(i, j) *= scale(i) * scale(j);
  if (!(symmetric_eigen(scaled).values.front() > 1e-10))
    throw Error(
        text("interface %s: its %zu nodes cannot carry all six loads (they lie on a "
             "line or in a point)",
             interface.name.c_str(), interface.nodes.size()));
}

/// A rigid set of solid nodes needs three that span a plane; a beam's node carries
/// moments alone.
void require_sound_rigid_set(const Interface& interface, const DofMap& map,
                             const Positions& position) {
  for (auto node : interface.nodes)
    if (map.dofs[as_size(node)] == 6) return;
  require_six_motions(interface, normal_matrix(interface, motions(interface, position)));
}

void add_distributed_loads(const Interface& interface, const DofMap& map,
                           const Positions& position, std::vector<std::string>& names,
                           std::vector<Entry>& entries, const HeldForces& held) {
  const std::vector<Dense> motion = motions(interface, position);
  const Dense normal = normal_matrix(interface, motion);
  require_six_motions(interface, normal);
  Dense l = normal;
  cholesky(l);
  const Dense inverse_factor = inverse_transposed(l);
  const Dense inverse = multiply(inverse_factor, transpose(inverse_factor));
  const int first = static_cast<int>(names.size());
  for (const char* component : component_names)
    names.push_back(interface.name + "." + component);
  for (std::size_t k = 0; k < interface.nodes.size(); ++k) {
    const double weight = interface.weights.empty() ? 1.0 : interface.weights[k];
    const Dense load = multiply(motion[k], inverse); // 3 × 6
    for (int c = 0; c < 3; ++c)
      for (const Share& share : map.shares(interface.nodes[k], c, position)) {
        const PetscInt row = map.equation(share.node, share.component);
        for (int port = 0; port < 6; ++port) {
          const double value = weight * load(c, port) * share.factor;
          if (row >= 0)
            entries.push_back({row, first + port, value});
          else if (held) // goes straight into a support
            held(names[as_size(first + port)], share.node, share.component, value);
        }
      }
  }
}

} // namespace

Ports interface_ports(MPI_Comm comm, const BodyDescription& body, const DofMap& map,
                      const Positions& position, const HeldForces& held) {
  Ports ports;
  std::vector<Entry> entries; // all of them on every rank: interfaces are small
  for (std::size_t i = 0; i < body.interfaces.size(); ++i) {
    const Interface& interface = body.interfaces[i];
    if (interface.coupling == Coupling::rigid) {
      require_sound_rigid_set(interface, map, position);
      add_unit_loads(interface, map, map.reference_of_interface[i], position, ports,
                     entries);
    } else if (interface.coupling == Coupling::node)
      add_unit_loads(interface, map, interface.nodes.front(), position, ports, entries);
    else
      add_distributed_loads(interface, map, position, ports.names, entries,
                            comm_rank(comm) == 0 ? held : HeldForces());
  }
  ports.B = Block(comm, map.rows, map.n, static_cast<PetscInt>(ports.names.size()));
  Block::Access out(ports.B);
  for (const auto& entry : entries)
    if (entry.row >= map.rows.begin && entry.row < map.rows.end)
      out.column(entry.column)[entry.row - map.rows.begin] += entry.value;
  return ports;
}

} // namespace flexgram
