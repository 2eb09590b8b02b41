#include "base/error.hpp"
#include "base/text.hpp"
#include "fem/condensation.hpp"
#include "fem/solid_points.hpp"
#include "fem/vectors.hpp"

#include <algorithm>
#include <limits>

namespace flexgram {
namespace {

struct TypeFacts {
  const char* name;
  int nodes, dofs;
};
constexpr TypeFacts facts[] = {{"tetra", 4, 3},
                               {"tetra10", 10, 3},
                               {"hexahedron", 8, 3},
                               {"hexahedron20", 20, 3},
                               {"wedge15", 15, 3},
                               {"hexahedron/full", 8, 3},
                               {"hexahedron20/reduced", 20, 3},
                               {"wedge", 6, 3},
                               {"wedge/reduced", 6, 3},
                               {"triangle", 3, 6},
                               {"quad", 4, 6},
                               {"triangle/membrane", 3, 3},
                               {"quad/membrane", 4, 3},
                               {"line/rod", 2, 3},
                               {"line", 2, 6},
                               {"mass", 1, 6},
                               {"spring to ground", 1, 6},
                               {"spring", 2, 6},
                               {"node", 1, 6}};

const TypeFacts& facts_of(ElementType type) { return facts[as_size(type)]; }

/// Mass of the scalar functions N (and, for Hex8, of the incompatible modes 1 − ξ_a²
/// behind them).
Dense scalar_mass(const std::vector<ShapePoint>& points,
                  const std::vector<Vector3>& nodes, double density, bool incompatible,
                  ElementMatrices& element, std::pair<double, double>& det_range) {
  const int n = static_cast<int>(nodes.size()) + (incompatible ? 3 : 0);
  Dense mass(n, n);
  for (const auto& p : points) {
    const double det = determinant(jacobian(p, nodes));
    det_range = {std::min(det_range.first, det), std::max(det_range.second, det)};
    const double w = p.weight * det * density;
    element.mass += w;
    std::vector<double> N = p.N;
    if (incompatible)
      for (double xi : p.xi) N.push_back(1 - xi * xi);
    for (int j = 0; j < n; ++j)
      for (int i = 0; i < n; ++i) mass(i, j) += w * N[as_size(i)] * N[as_size(j)];
  }
  return mass;
}

/// The same mass for each of the three displacement components; the first `count`
/// functions.
Dense three_components(const Dense& mass, int count) {
  Dense M(3 * count, 3 * count);
  for (int j = 0; j < count; ++j)
    for (int i = 0; i < count; ++i)
      for (int c = 0; c < 3; ++c) M(3 * i + c, 3 * j + c) = mass(i, j);
  return M;
}

} // namespace

bool is_solid(ElementType type) { return as_size(type) < as_size(ElementType::tri3); }
int node_count(ElementType type) { return facts_of(type).nodes; }
int dofs_per_node(ElementType type) { return facts_of(type).dofs; }
const char* element_name(ElementType type) { return facts_of(type).name; }

ElementType element_type(const std::string& name) {
  std::vector<std::string> known;
  for (std::size_t i = 0; i <= as_size(ElementType::beam2); ++i) {
    if (name == facts[i].name) return static_cast<ElementType>(i);
    known.emplace_back(facts[i].name);
  }
  throw Error(text("element type %s is not known; there are %s", name.c_str(),
                   join(known).c_str()));
}

ElementMatrices solid_matrices(ElementType type, const std::vector<Vector3>& nodes,
                               const SolidMaterials& material, MassRule mass_rule,
                               bool with_stiffness) {
  const int n = static_cast<int>(nodes.size());
  const bool incompatible = type == ElementType::hex8;
  const auto& k_points = stiffness_points(type);
  ElementMatrices result;
  std::pair<double, double> det{std::numeric_limits<double>::max(),
                                std::numeric_limits<double>::lowest()};
  const Dense mass =
      scalar_mass(mass_rule == MassRule::reduced ? k_points : mass_points(type), nodes,
                  material.front().density, incompatible, result, det);
  for (const auto& p : k_points) {
    const double d = determinant(jacobian(p, nodes));
    det = {std::min(det.first, d), std::max(det.second, d)};
  }
  result.min_detJ = det.first;
  result.shape_ratio = det.second > 0 ? det.first / det.second : -1;
  if (!with_stiffness || det.first <= 0) {
    result.M = three_components(mass, n);
    return result;
  }

  result.M = three_components(mass, mass.rows);
  result.K = Dense(result.M.rows, result.M.rows);
  const auto points = points_of(type, nodes);
  for (std::size_t p = 0; p < points.size(); ++p) {
    const StiffnessPoint& at = points[p];
    result.aspect = std::max(result.aspect, at.aspect);
    add_stiffness(result.K, at.gradients, at_point(material, p).stiffness, at.volume,
                  linear_strain);
  }
  mirror(result.K);
  if (incompatible) {
    result.T = condensation(result.K, 3 * (mass.rows - n));
    result.K = condensed(result.K, result.T);
    result.M_0 = std::move(result.M); // sees the incompatible modes move as well
    result.M = condensed(result.M_0, result.T);
  }
  return result;
}

namespace {

/// ∫ρ NᵀDN of a 3×3 matrix D.
Dense mass_of_directions(const ElementMatrices& element, const Dense& D) {
  const bool condenses = !element.T.data.empty();
  const Dense& M = condenses ? element.M_0 : element.M;
  Dense each(M.rows, M.rows);
  for (int i = 0; i < M.rows; i += 3) set_part(each, i, i, D);
  const Dense result = multiply(M, each);
  return condenses ? multiply_transposed(element.T, multiply(result, element.T)) : result;
}

} // namespace

Dense solid_spin_softening(const ElementMatrices& element, const Vector3& axis) {
  Dense across(3, 3);
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 3; ++j)
      across(i, j) = (i == j) - axis[as_size(i)] * axis[as_size(j)];
  Dense S = mass_of_directions(element, across);
  symmetrise(S);
  return S;
}

Dense solid_coriolis(const ElementMatrices& element, const Vector3& axis) {
  Dense turned(3, 3);
  for (int i = 0; i < 3; ++i) { // 2 [axis ×]
    const int next = (i + 1) % 3, last = (i + 2) % 3;
    turned(next, last) = -2 * axis[as_size(i)];
    turned(last, next) = 2 * axis[as_size(i)];
  }
  Dense G = mass_of_directions(element, turned);
  symmetrise(G, Symmetry::skew);
  return G;
}

Convection solid_convection(ElementType type, const std::vector<Vector3>& nodes,
                            double density, MassRule mass_rule, const Dense& T,
                            const Vector3& axis, const Vector3& point) {
  const bool condenses = !T.data.empty();
  const int n = static_cast<int>(nodes.size()) + (condenses ? 3 : 0);
  Dense G(n, n), S(n, n);
  for (const ShapePoint& p :
       mass_rule == MassRule::reduced ? stiffness_points(type) : mass_points(type)) {
    std::vector<double> N = p.N;
    std::vector<Vector3> slopes = gradients(p, nodes);
    if (condenses) { // 1 − ξ_a²
      const Jacobian inv = inverse_jacobian(p, nodes);
      for (std::size_t a = 0; a < 3; ++a) {
        N.push_back(1 - p.xi[a] * p.xi[a]);
        Vector3 slope{};
        for (std::size_t b = 0; b < 3; ++b) slope[b] = -2 * p.xi[a] * inv[b][a];
        slopes.push_back(slope);
      }
    }
    Vector3 from{};
    for (std::size_t i = 0; i < nodes.size(); ++i)
      for (std::size_t b = 0; b < 3; ++b) from[b] += p.N[i] * (nodes[i][b] - point[b]);
    const Vector3 along = cross(axis, from);
    std::vector<double> turned;
    for (const Vector3& g : slopes) turned.push_back(dot(g, along));
    const double w = p.weight * determinant(jacobian(p, nodes)) * density;
    for (int j = 0; j < n; ++j)
      for (int i = 0; i < n; ++i) {
        G(i, j) +=
            w * (N[as_size(i)] * turned[as_size(j)] - turned[as_size(i)] * N[as_size(j)]);
        S(i, j) += w * turned[as_size(i)] * turned[as_size(j)];
      }
  }
  Convection result{three_components(G, n), three_components(S, n)};
  if (condenses)
    for (Dense* a : {&result.gyroscopic, &result.softening})
      *a = multiply_transposed(T, multiply(*a, T));
  symmetrise(result.gyroscopic, Symmetry::skew);
  symmetrise(result.softening);
  return result;
}

} // namespace flexgram
