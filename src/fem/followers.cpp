#include "fem/followers.hpp"

#include "base/index.hpp"
#include "fem/couplings.hpp"
#include "fem/discrete.hpp"

#include <algorithm>
#include <map>

namespace flexgram {

Followers::Followers(const DofMap& map, const LocalMesh& mesh) : map_(map), mesh_(mesh) {
  for (const auto& elements : mesh.elements) {
    const auto width = as_size(node_count(elements.block->type));
    for (std::size_t k = 0; k < elements.number.size(); ++k) {
      const auto first = static_cast<long>(node_.size());
      const auto add = [&](std::int64_t node) {
        const int reference = map.reference[as_size(node)];
        const std::int64_t master = reference < 0 ? node : reference;
        if (std::find(node_.begin() + first, node_.end(), master) == node_.end())
          node_.push_back(master);
      };
      for (std::size_t a = 0; a < width; ++a) {
        const std::int64_t node = elements.connectivity[k * width + a];
        if (map.moves_alone(node) || map.reference[as_size(node)] >= 0) {
          add(node);
          continue;
        }
        const unsigned all = (1U << map.dofs[as_size(node)]) - 1;
        if (map.dependent[as_size(node)] != all) add(node);
        for (int c = 0; c < map.dofs[as_size(node)]; ++c)
          if (map.dependent[as_size(node)] >> c & 1)
            for (const Share& share : map.constraints.of(node, c)) add(share.node);
      }
      start_.push_back(node_.size());
    }
  }
}

void Followers::for_each(const std::function<void(const PlacedElement&)>& visit) const {
  std::size_t e = 0;
  for (const auto& elements : mesh_.elements) {
    const auto width = as_size(node_count(elements.block->type));
    for (std::size_t k = 0; k < elements.number.size(); ++k, ++e) {
      PlacedElement at{elements,
                       k,
                       elements.connectivity.data() + k * width,
                       {},
                       node_.data() + start_[e],
                       start_[e + 1] - start_[e],
                       false,
                       std::span(elements.axes)
                           .subspan(k * elements.block->axes, elements.block->axes)};
      for (std::size_t a = 0; a < width; ++a) at.x.push_back(position(at.nodes[a]));
      at.rigid = at.master_count == 1 && at.masters[0] >= map_.points &&
                 !is_spring(at.block().type) &&
                 std::all_of(at.nodes, at.nodes + width, [&](std::int64_t node) {
                   return map_.dependent[as_size(node)] == 0;
                 });
      visit(at);
    }
  }
}

std::vector<int> Followers::first_dofs(const PlacedElement& at) const {
  std::vector<int> first(at.master_count + 1, 0);
  for (std::size_t a = 0; a < at.master_count; ++a)
    first[a + 1] = first[a] + map_.dofs[as_size(at.masters[a])];
  return first;
}

std::size_t Followers::place_of(const PlacedElement& at, std::int64_t master) const {
  return as_size(std::find(at.masters, at.masters + at.master_count, master) -
                 at.masters);
}

const Vector3& Followers::position(std::int64_t node) const {
  return node < map_.points ? mesh_.coordinates[mesh_.place(node)]
                            : map_.reference_position[as_size(node - map_.points)];
}

Vector3 Followers::arm(std::int64_t node, int reference) const {
  Vector3 d = position(node);
  const Vector3& origin = map_.reference_position[as_size(reference - map_.points)];
  for (std::size_t axis = 0; axis < 3; ++axis) d[axis] -= origin[axis];
  return d;
}

std::vector<Share> Followers::shares(std::int64_t node, int c) const {
  return map_.shares(node, c, [this](std::int64_t other) { return position(other); });
}

Dense Followers::transformation(const PlacedElement& at) const {
  const int count = node_count(at.block().type), dofs = dofs_per_node(at.block().type);
  const std::vector<int> first = first_dofs(at);
  bool same = at.master_count == as_size(count);
  for (std::size_t a = 0; a < at.master_count; ++a)
    same = same && at.masters[a] == at.nodes[a] && map_.moves_alone(at.nodes[a]) &&
           first[a + 1] - first[a] == dofs;
  if (same) return {};
  Dense T(count * dofs, first.back());
  for (int a = 0; a < count; ++a) {
    const std::int64_t node = at.nodes[a];
    const int own = map_.reference[as_size(node)] >= 0 ? 6 : map_.dofs[as_size(node)];
    for (int c = 0; c < std::min(dofs, own); ++c)
      for (const Share& share : shares(node, c))
        T(a * dofs + c, first[place_of(at, share.node)] + share.component) +=
            share.factor;
  }
  return T;
}

Dense Followers::displacement(const PlacedElement& at, const Dense& T,
                              const std::function<double(std::int64_t, int)>& u) const {
  Dense moved(0, 1);
  for (std::size_t a = 0; a < at.master_count; ++a)
    for (int c = 0; c < map_.dofs[as_size(at.masters[a])]; ++c)
      moved.data.push_back(u(at.masters[a], c));
  moved.rows = static_cast<int>(moved.data.size());
  return T.data.empty() ? moved : multiply(T, moved);
}

Dense Followers::turning(const PlacedElement& at, const Dense& forces) const {
  const int count = node_count(at.block().type), dofs = dofs_per_node(at.block().type);
  const std::vector<int> first_dof = first_dofs(at);
  std::map<std::int64_t, Vector3> at_slaves; // of rigid interfaces
  const auto add = [&](std::int64_t node, int c, double force) {
    if (c < 3 && map_.reference[as_size(node)] >= 0) at_slaves[node][as_size(c)] += force;
  };
  for (int a = 0; a < count; ++a) {
    const std::int64_t node = at.nodes[a];
    for (int c = 0; c < std::min(dofs, static_cast<int>(map_.dofs[as_size(node)])); ++c) {
      const double force = forces(a * dofs + c, 0);
      if (!(map_.dependent[as_size(node)] >> c & 1)) {
        add(node, c, force);
        continue;
      }
      for (const Share& share : map_.constraints.of(node, c))
        add(share.node, share.component, share.factor * force);
    }
  }
  Dense result;
  for (const auto& [node, F] : at_slaves) {
    const int reference = map_.reference[as_size(node)];
    if (result.data.empty()) result = Dense(first_dof.back(), first_dof.back());
    const int first = first_dof[place_of(at, reference)] + 3;
    const Vector3 d = arm(node, reference);
    double along = 0;
    for (std::size_t c = 0; c < 3; ++c) along += F[c] * d[c];
    for (int i = 0; i < 3; ++i)
      for (int j = 0; j < 3; ++j)
        result(first + i, first + j) +=
            0.5 * (F[as_size(i)] * d[as_size(j)] + d[as_size(i)] * F[as_size(j)]) -
            (i == j) * along;
  }
  return result;
}

} // namespace flexgram
