#include "fem/discrete.hpp"

#include "base/error.hpp"
#include "base/index.hpp"
#include "base/text.hpp"
#include "fem/couplings.hpp"
#include "fem/vectors.hpp"

#include <algorithm>
#include <cmath>

namespace flexgram {
namespace {

Dense inertia_of(const PointMass& mass) {
  const auto& J = mass.inertia;
  Dense result(3, 3);
  for (int i = 0; i < 3; ++i) {
    result(i, i) = J[as_size(i)];
    const int next = (i + 1) % 3;
    result(i, next) = result(next, i) = J[as_size(i) + 3];
  }
  return result;
}

Vector3 times(const Dense& J, const Vector3& a) {
  Vector3 b{};
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 3; ++j) b[as_size(i)] += J(i, j) * a[as_size(j)];
  return b;
}

/// Motion of a point at d from a node whose six dofs move it, its rotation too.
Dense carried(const Vector3& d) {
  Dense H(6, 6);
  set_part(H, 0, 0, rigid_motion(d));
  for (int c = 3; c < 6; ++c) H(c, c) = 1;
  return H;
}

void refuse_beside(const PointMass& mass) {
  if (mass.matrix)
    throw Error("a mass given by its matrix takes no spin: give its mass and inertia");
  if (is_beside(mass))
    throw Error(
        "a mass beside its node takes no spin: give that with an offset a node of "
        "its own, in a rigid interface; of shells with lumped mass put the nodes "
        "into the middle surface");
}

const Interface& find_interface(const BodyDescription& body, const std::string& name) {
  const auto found = std::find_if(body.interfaces.begin(), body.interfaces.end(),
                                  [&](const Interface& one) { return one.name == name; });
  if (found != body.interfaces.end()) return *found;
  throw Error(text("the body has no interface %s", name.c_str()));
}

/// Nodes of the place, references counted behind those of the mesh.
std::vector<std::int64_t> nodes_of(const Place& place, const BodyDescription& body,
                                   const DofMap& map) {
  if (place.interface.empty()) return place.nodes;
  const Interface& interface = find_interface(body, place.interface);
  const auto number = as_size(&interface - body.interfaces.data());
  if (interface.coupling == Coupling::node) return {interface.nodes.front()};
  if (interface.coupling == Coupling::rigid) return {map.reference_of_interface[number]};
  throw Error(
      text("interface %s is distributing and carries nothing: put the mass or the "
           "spring at nodes, or make the interface rigid",
           place.interface.c_str()));
}

} // namespace

bool is_beside(const PointMass& mass) { return dot(mass.offset, mass.offset) > 0; }

bool is_discrete(ElementType type) {
  return type == ElementType::mass1 || type == ElementType::node1 || is_spring(type);
}

bool is_spring(ElementType type) {
  return type == ElementType::spring1 || type == ElementType::spring2;
}

Dense mass_matrix(const PointMass& mass) {
  if (mass.matrix) return *mass.matrix;
  Dense M(6, 6);
  for (int c = 0; c < 3; ++c) M(c, c) = mass.mass;
  set_part(M, 3, 3, inertia_of(mass));
  if (!is_beside(mass)) return M;
  const Dense H = carried(mass.offset);
  M = multiply_transposed(H, multiply(M, H));
  symmetrise(M);
  return M;
}

Dense mass_beside(const PointMass& mass) {
  const Dense J = inertia_of(mass);
  const double half = 0.5 * (J(0, 0) + J(1, 1) + J(2, 2));
  Dense beside(6, 9);
  for (int m = 0; m < 3; ++m) { // r × A r, with ∫ρ r rᵀ = ½tr(J) I − J
    const int l = (m + 1) % 3, i = (m + 2) % 3;
    for (int j = 0; j < 3; ++j) {
      beside(3 + m, 3 * i + j) += half * (l == j) - J(l, j);
      beside(3 + m, 3 * l + j) -= half * (i == j) - J(i, j);
    }
  }
  if (!is_beside(mass)) return beside;
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 3; ++j)
      beside(i, 3 * i + j) += mass.mass * mass.offset[as_size(j)];
  return multiply_transposed(carried(mass.offset), beside);
}

Dense spring_matrix(const Dense& of_motion, const std::vector<Vector3>& x) {
  if (x.size() == 1) return of_motion;
  Vector3 arm; // of the first node; of the other it is −arm
  for (std::size_t c = 0; c < 3; ++c) arm[c] = 0.5 * (x[1][c] - x[0][c]);
  Dense relative(6, 12);
  Dense first = carried(arm);
  for (double& h : first.data) h = -h;
  set_part(relative, 0, 0, first);
  set_part(relative, 0, 6, carried({-arm[0], -arm[1], -arm[2]}));
  Dense K = multiply_transposed(relative, multiply(of_motion, relative));
  symmetrise(K);
  return K;
}

Dense mass_spin_softening(const PointMass& mass, const Vector3& axis) {
  refuse_beside(mass);
  const Dense J = inertia_of(mass), A = cross_matrix(axis);
  const Vector3 b = times(J, axis);
  // Of ½ eᵀRJRᵀe, R a rotation by θ: θᵀHθ = (θ×e)ᵀJ(θ×e) + eᵀJ(θ×(θ×e)).
  Dense H = multiply_transposed(A, multiply(J, A)), S(6, 6);
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 3; ++j) {
      const double a_i = axis[as_size(i)], a_j = axis[as_size(j)];
      S(i, j) = mass.mass * ((i == j) - a_i * a_j);
      H(i, j) +=
          0.5 * (b[as_size(i)] * a_j + a_i * b[as_size(j)]) - (i == j) * dot(axis, b);
    }
  set_part(S, 3, 3, H);
  symmetrise(S);
  return S;
}

Dense mass_coriolis(const PointMass& mass, const Vector3& axis) {
  refuse_beside(mass);
  const Dense J = inertia_of(mass);
  const Vector3 b = times(J, axis);
  const double trace = J(0, 0) + J(1, 1) + J(2, 2);
  Vector3 turning;
  for (std::size_t c = 0; c < 3; ++c) turning[c] = trace * axis[c] - 2 * b[c];
  Dense G(6, 6), moving = cross_matrix(axis);
  for (double& g : moving.data) g *= 2 * mass.mass;
  set_part(G, 0, 0, moving);
  set_part(G, 3, 3, cross_matrix(turning));
  return G;
}

Dense mass_gyroscopic(const PointMass& mass, const Vector3& x, const Vector3& axis,
                      const Vector3& point) {
  refuse_beside(mass);
  Vector3 from;
  for (std::size_t c = 0; c < 3; ++c) from[c] = x[c] - point[c];
  const double along = dot(from, axis), away = std::sqrt(dot(from, from));
  Vector3 off;
  for (std::size_t c = 0; c < 3; ++c) off[c] = from[c] - along * axis[c];
  if (std::sqrt(dot(off, off)) > 1e-6 * away)
    throw Error("spin: in the frame at rest masses lie on the axis of the spin; others "
                "are seen in the frame that turns (frame: turning)");
  // J = J_d + (J_p − J_d) e eᵀ
  const Dense J = inertia_of(mass);
  const double J_p = dot(axis, times(J, axis)),
               J_d = 0.5 * (J(0, 0) + J(1, 1) + J(2, 2) - J_p);
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 3; ++j) {
      const double symmetric =
          J_d * (i == j) + (J_p - J_d) * axis[as_size(i)] * axis[as_size(j)];
      if (std::abs(J(i, j) - symmetric) > 1e-6 * (J_p + J_d))
        throw Error("spin: in the frame at rest masses are symmetric about the axis; "
                    "others are seen in the frame that turns (frame: turning)");
    }
  Dense G(6, 6), moment = cross_matrix(axis);
  for (double& g : moment.data) g *= -J_p;
  set_part(G, 3, 3, moment);
  return G;
}

std::vector<std::string> springs_of_a_turning_ground(const BodyDescription& body,
                                                     const Vector3& axis) {
  Dense turn(6, 6);
  for (int first : {0, 3}) set_part(turn, first, first, cross_matrix(axis));
  std::vector<std::string> found;
  for (const MeshBlock& block : body.discrete) {
    if (block.type != ElementType::spring1) continue;
    const Spring& spring = body.springs.at(block.material);
    Dense moved = multiply(turn, spring.stiffness);
    add_to(moved, multiply(spring.stiffness, turn), -1);
    if (frobenius_norm(spring.damping) > 0 ||
        frobenius_norm(moved) > 1e-9 * frobenius_norm(spring.stiffness))
      found.push_back(block.material);
  }
  return found;
}

void expect_rotations(const DofMap& map, const std::int64_t* nodes, std::size_t count,
                      const Dense& matrix, const std::string& name) {
  constexpr double rounding = 1e-9;
  double largest = 0;
  for (double x : matrix.data) largest = std::max(largest, std::abs(x));
  for (std::size_t a = 0; a < count; ++a) {
    const auto node = as_size(nodes[a]);
    if (map.reference[node] >= 0 || map.dofs[node] == 6) continue;
    for (int c = 3; c < 6; ++c)
      for (int j = 0; j < matrix.columns; ++j)
        if (std::abs(matrix(static_cast<int>(6 * a) + c, j)) > rounding * largest)
          throw Error(text(
              "%s: node %lld has no rotations, neither a beam's end nor in a rigid "
              "interface: it takes a mass without inertia, and springs that act on "
              "displacements, between two nodes along the line from one to the other",
              name.c_str(), static_cast<long long>(nodes[a]) + 1));
  }
}

std::vector<std::int64_t> discrete_nodes(const BodyDescription& body) {
  std::vector<std::int64_t> all;
  const auto take = [&](const Place& place) {
    all.insert(all.end(), place.nodes.begin(), place.nodes.end());
  };
  for (const auto& [name, mass] : body.masses) take(mass.at);
  for (const auto& [name, spring] : body.springs) {
    take(spring.from);
    take(spring.to);
  }
  return all;
}

void add_discrete(const BodyDescription& body, const DofMap& map, int rank,
                  LocalMesh& mesh) {
  for (const MeshBlock& block : body.discrete) {
    std::vector<std::int64_t> first, second;
    try {
      if (is_spring(block.type)) {
        const Spring& spring = body.springs.at(block.material);
        first = nodes_of(spring.from, body, map);
        if (block.type == ElementType::spring2) second = nodes_of(spring.to, body, map);
      } else {
        first = nodes_of(body.masses.at(block.material).at, body, map);
      }
    } catch (Error& error) {
      error.add_context(block.path);
      throw;
    }
    LocalElements mine{&block, {}, {}};
    for (std::size_t k = 0; k < first.size(); ++k) {
      if (map.owner[as_size(first[k])] != rank) continue;
      mine.number.push_back(static_cast<std::int64_t>(k));
      mine.connectivity.push_back(first[k]);
      if (!second.empty())
        mine.connectivity.push_back(second[second.size() == 1 ? 0 : k]);
    }
    mesh.elements.push_back(std::move(mine));
  }
}

} // namespace flexgram
