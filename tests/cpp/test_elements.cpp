#include "base/error.hpp"
#include "base/index.hpp"
#include "fem/shape_functions.hpp"
#include "linalg/decompositions.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

using namespace flexgram;

namespace {

constexpr double E = 210e9, nu = 0.3, rho = 7850;
const ElementType solids[] = {ElementType::tet4, ElementType::tet10, ElementType::hex8,
                              ElementType::hex20, ElementType::wedge15};

/// Corners of the reference element, and for each mid-edge node the corners it lies
/// between.
struct Reference {
  std::vector<Vector3> corners;
  std::vector<std::pair<int, int>> edges;
};

Reference reference(ElementType type) {
  const std::vector<Vector3> tet{{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {0, 0, 1}};
  const std::vector<Vector3> hex{{-1, -1, -1}, {1, -1, -1}, {1, 1, -1}, {-1, 1, -1},
                                 {-1, -1, 1},  {1, -1, 1},  {1, 1, 1},  {-1, 1, 1}};
  const std::vector<Vector3> wedge{{0, 0, -1}, {1, 0, -1}, {0, 1, -1},
                                   {0, 0, 1},  {1, 0, 1},  {0, 1, 1}};
  switch (type) {
  case ElementType::tet4:
    return {tet, {}};
  case ElementType::tet10:
    return {tet, {{0, 1}, {1, 2}, {0, 2}, {0, 3}, {1, 3}, {2, 3}}};
  case ElementType::hex8:
    return {hex, {}};
  case ElementType::hex20:
    return {hex,
            {{0, 1},
             {1, 2},
             {2, 3},
             {3, 0},
             {4, 5},
             {5, 6},
             {6, 7},
             {7, 4},
             {0, 4},
             {1, 5},
             {2, 6},
             {3, 7}}};
  default:
    return {wedge,
            {{0, 1}, {1, 2}, {2, 0}, {3, 4}, {4, 5}, {5, 3}, {0, 3}, {1, 4}, {2, 5}}};
  }
}

std::vector<Vector3> reference_nodes(ElementType type) {
  const Reference r = reference(type);
  auto nodes = r.corners;
  for (auto [a, b] : r.edges) {
    Vector3 m{};
    for (std::size_t i = 0; i < 3; ++i)
      m[i] = (r.corners[as_size(a)][i] + r.corners[as_size(b)][i]) / 2;
    nodes.push_back(m);
  }
  return nodes;
}

/// A distorted element: corners moved, edges straight. Sizes of some centimetres.
std::vector<Vector3> distorted(ElementType type) {
  const Reference r = reference(type);
  std::vector<Vector3> nodes;
  for (std::size_t i = 0; i < r.corners.size(); ++i) {
    const auto& x = r.corners[i];
    const double wobble = 0.1 * std::sin(3.0 * static_cast<double>(i) + 1);
    nodes.push_back({0.03 * (x[0] + 0.2 * x[1] + wobble),
                     0.02 * (x[1] - 0.1 * x[2] - wobble),
                     0.04 * (x[2] + 0.15 * x[0] + 0.5 * wobble)});
  }
  for (auto [a, b] : r.edges) {
    Vector3 m{};
    for (std::size_t i = 0; i < 3; ++i)
      m[i] = (nodes[as_size(a)][i] + nodes[as_size(b)][i]) / 2;
    nodes.push_back(m);
  }
  return nodes;
}

/// Nodal displacements of the field u = F x.
std::vector<double> linear_field(const std::vector<Vector3>& nodes,
                                 const double (&F)[3][3]) {
  std::vector<double> u;
  for (const auto& x : nodes)
    for (const auto& row : F) u.push_back(row[0] * x[0] + row[1] * x[1] + row[2] * x[2]);
  return u;
}

double energy(const Dense& A, const std::vector<double>& u,
              const std::vector<double>& v) {
  double sum = 0;
  for (int j = 0; j < A.columns; ++j)
    for (int i = 0; i < A.rows; ++i) sum += u[as_size(i)] * A(i, j) * v[as_size(j)];
  return sum;
}

double volume(ElementType type, const std::vector<Vector3>& nodes) {
  return solid_matrices(type, nodes, {isotropic(1, 0, 1)}, MassRule::full).mass;
}

} // namespace

TEST(Elements, ShapeFunctionsInterpolateAndSumToOne) {
  for (ElementType type : solids) {
    const auto nodes = reference_nodes(type);
    for (std::size_t i = 0; i < nodes.size(); ++i) {
      const ShapePoint at_node = shape_at(type, nodes[i], 0);
      for (std::size_t j = 0; j < nodes.size(); ++j)
        EXPECT_NEAR(at_node.N[j], i == j ? 1 : 0, 1e-15) << element_name(type);
    }
    for (const auto& p : stiffness_points(type)) {
      double sum = 0;
      Vector3 slope{};
      for (std::size_t j = 0; j < nodes.size(); ++j) {
        sum += p.N[j];
        for (std::size_t a = 0; a < 3; ++a) slope[a] += p.dN[j][a];
      }
      EXPECT_NEAR(sum, 1, 1e-14);
      for (double s : slope) EXPECT_NEAR(s, 0, 1e-14);
    }
  }
}

TEST(Elements, DerivativesAreThoseOfTheShapeFunctions) {
  const double h = 1e-6; // central differences: error about h² and ε/h
  for (ElementType type : solids) {
    const Vector3 xi{0.21, 0.32, 0.17};
    const ShapePoint p = shape_at(type, xi, 0);
    for (std::size_t a = 0; a < 3; ++a) {
      Vector3 up = xi, down = xi;
      up[a] += h;
      down[a] -= h;
      const ShapePoint u = shape_at(type, up, 0), d = shape_at(type, down, 0);
      for (std::size_t j = 0; j < p.N.size(); ++j)
        EXPECT_NEAR(p.dN[j][a], (u.N[j] - d.N[j]) / (2 * h), 1e-9) << element_name(type);
    }
  }
}

TEST(Elements, QuadratureOfTheMassIsExact) {
  // ∫ ξ^a η^b ζ^c over the unit tetrahedron is a! b! c! / (a + b + c + 3)!.
  const auto factorial = [](int k) { return std::tgamma(k + 1.0); };
  for (int a = 0; a <= 5; ++a)
    for (int b = 0; a + b <= 5; ++b)
      for (int c = 0; a + b + c <= 5; ++c) {
        double sum = 0;
        for (const auto& p : mass_points(ElementType::tet10))
          sum += p.weight * std::pow(p.xi[0], a) * std::pow(p.xi[1], b) *
                 std::pow(p.xi[2], c);
        EXPECT_NEAR(sum,
                    factorial(a) * factorial(b) * factorial(c) / factorial(a + b + c + 3),
                    1e-16);
      }
  // Wedge: the triangle to degree 4, the line to degree 5.
  for (int a = 0; a <= 4; ++a)
    for (int b = 0; a + b <= 4; ++b)
      for (int c = 0; c <= 5; ++c) {
        double sum = 0;
        for (const auto& p : mass_points(ElementType::wedge15))
          sum += p.weight * std::pow(p.xi[0], a) * std::pow(p.xi[1], b) *
                 std::pow(p.xi[2], c);
        const double line = c % 2 ? 0 : 2.0 / (c + 1);
        EXPECT_NEAR(sum, factorial(a) * factorial(b) / factorial(a + b + 2) * line,
                    1e-15);
      }
}

TEST(Elements, SixRigidMotionsCostNoEnergy) {
  for (ElementType type : solids) {
    const auto nodes = distorted(type);
    const Dense K =
        solid_matrices(type, nodes, {isotropic(E, nu, rho)}, MassRule::full).K;
    double scale = 0;
    for (int i = 0; i < K.rows; ++i) scale = std::max(scale, K(i, i));
    const double rotations[3][3][3] = {{{0, 0, 0}, {0, 0, -1}, {0, 1, 0}},
                                       {{0, 0, 1}, {0, 0, 0}, {-1, 0, 0}},
                                       {{0, -1, 0}, {1, 0, 0}, {0, 0, 0}}};
    for (const auto& F : rotations) {
      const auto u = linear_field(nodes, F);
      EXPECT_LT(std::abs(energy(K, u, u)), 1e-13 * scale * 0.04 * 0.04 * K.rows)
          << element_name(type);
    }
    for (std::size_t c = 0; c < 3; ++c) {
      std::vector<double> u(as_size(K.rows), 0.0);
      for (std::size_t i = c; i < u.size(); i += 3) u[i] = 1;
      EXPECT_LT(std::abs(energy(K, u, u)), 1e-13 * scale * K.rows) << element_name(type);
    }
    const auto eigen = symmetric_eigen(K);
    EXPECT_LT(std::abs(eigen.values[5]), 1e-12 * eigen.values.back());
    EXPECT_GT(eigen.values[6], 1e-6 * eigen.values.back())
        << "hourglass in " << element_name(type);
  }
}

TEST(Elements, PatchOfConstantStrainHasTheExactEnergy) {
  // For u = F x the energy is V ε : C : ε, for any shape and orthotropic C too.
  const double F[3][3] = {{1e-3, 2e-4, -3e-4}, {5e-4, -2e-3, 1e-4}, {0, 7e-4, 4e-4}};
  const double e[6] = {F[0][0],           F[1][1],           F[2][2],
                       F[0][1] + F[1][0], F[1][2] + F[2][1], F[0][2] + F[2][0]};
  const double s = std::sqrt(0.5);
  const SolidMaterial materials[] = {
      isotropic(E, nu, rho),
      orthotropic({140e9, 10e9, 12e9, 0.3, 0.25, 0.4, 5e9, 6e9, 4e9},
                  {s, s, 0, -s, s, 0, 0, 0, 1}, 1600)};
  for (const auto& material : materials) {
    double density = 0;
    for (std::size_t i = 0; i < 6; ++i)
      for (std::size_t j = 0; j < 6; ++j)
        density += e[i] * material.stiffness[6 * i + j] * e[j];
    for (ElementType type : solids) {
      const auto nodes = distorted(type);
      const Dense K = solid_matrices(type, nodes, {material}, MassRule::full).K;
      const auto u = linear_field(nodes, F);
      const double expected = density * volume(type, nodes);
      EXPECT_NEAR(energy(K, u, u), expected, 1e-12 * expected) << element_name(type);
    }
  }
}

TEST(Elements, NodalForcesOfConstantStressBalance) {
  // The patch test proper: forces on a node from constant stress depend on the shape
  // functions only; their virtual work on any linear field is V σ : ε. Incompatible modes
  // must not spoil it.
  const double F[3][3] = {{1e-3, 0, 0}, {0, 0, 0}, {0, 0, 0}};
  const double G[3][3] = {{0, 1, 2}, {3, -1, 0}, {1, 0, 2}};
  const auto C = isotropic(E, nu, rho).stiffness;
  for (ElementType type : solids) {
    const auto nodes = distorted(type);
    const Dense K =
        solid_matrices(type, nodes, {isotropic(E, nu, rho)}, MassRule::full).K;
    const double expected =
        volume(type, nodes) * 1e-3 * (C[0] * G[0][0] + C[6] * G[1][1] + C[12] * G[2][2]);
    EXPECT_NEAR(energy(K, linear_field(nodes, G), linear_field(nodes, F)), expected,
                1e-12 * std::abs(E * 1e-3 * 0.03 * 0.02 * 0.04 * 8))
        << element_name(type);
  }
}

TEST(Elements, ConsistentMassIsExactForRigidAndLinearMotion) {
  for (ElementType type : solids) {
    const auto nodes = distorted(type);
    const auto element =
        solid_matrices(type, nodes, {isotropic(E, nu, rho)}, MassRule::full);
    std::vector<double> u(as_size(element.M.rows), 0.0);
    for (std::size_t i = 0; i < u.size(); i += 3) u[i] = 1;
    EXPECT_NEAR(energy(element.M, u, u), element.mass, 1e-13 * element.mass);
    const auto eigen = symmetric_eigen(element.M);
    EXPECT_GT(eigen.values.front(), 0) << element_name(type);
  }
  // Second moment of a box a × b × c about its centre: m a²/12, exact for every
  // hexahedron.
  for (ElementType type : {ElementType::hex8, ElementType::hex20}) {
    auto nodes = reference_nodes(type);
    for (auto& x : nodes) x = {0.1 * x[0], 0.2 * x[1], 0.3 * x[2]};
    const auto element =
        solid_matrices(type, nodes, {isotropic(E, nu, rho)}, MassRule::full);
    const double F[3][3] = {{1, 0, 0}, {0, 0, 0}, {0, 0, 0}};
    const auto u = linear_field(nodes, F);
    EXPECT_NEAR(energy(element.M, u, u), element.mass * 0.2 * 0.2 / 12,
                1e-13 * element.mass);
  }
}

TEST(Elements, IncompatibleModesBendExactly) {
  // A rectangular Hex8 in pure bending with ν = 0: u = xz, w = −x²/2 has exact energy
  // E/2 ∫ z² dV · 2 (a compatible Hex8 locks: far too stiff).
  auto nodes = reference_nodes(ElementType::hex8);
  const double a = 0.1, b = 0.02, c = 0.01;
  for (auto& x : nodes) x = {a * x[0], b * x[1], c * x[2]};
  const Dense K =
      solid_matrices(ElementType::hex8, nodes, {isotropic(E, 0, rho)}, MassRule::full).K;
  std::vector<double> u;
  for (const auto& x : nodes)
    u.insert(u.end(), {x[0] * x[2], 0, 0}); // w is equal at all nodes
  const double expected = E * (8 * a * b * c) * c * c / 3;
  EXPECT_NEAR(energy(K, u, u), expected, 1e-12 * expected);
}

TEST(Elements, AnIsotropicLawIsTheSameInEveryFrame) {
  const double G = E / (2 * (1 + nu)), c = std::cos(0.7), s = std::sin(0.7);
  const auto rotated =
      orthotropic({E, E, E, nu, nu, nu, G, G, G}, {c, s, 0, -s, c, 0, 0, 0, 1}, rho);
  const auto plain = isotropic(E, nu, rho);
  for (std::size_t i = 0; i < 36; ++i)
    EXPECT_NEAR(rotated.stiffness[i], plain.stiffness[i], 1e-14 * 3e11);
}

TEST(Elements, ReducedMassRuleKeepsTheMassAndLosesRank) {
  for (const auto& [type, rank] :
       {std::pair{ElementType::tet4, 3}, {ElementType::tet10, 12}}) {
    const auto nodes = distorted(type);
    const auto full =
        solid_matrices(type, nodes, {isotropic(E, nu, rho)}, MassRule::full);
    const auto reduced =
        solid_matrices(type, nodes, {isotropic(E, nu, rho)}, MassRule::reduced);
    EXPECT_NEAR(full.mass, reduced.mass, 1e-13 * full.mass);
    const auto values = symmetric_eigen(reduced.M).values;
    const auto above = std::count_if(values.begin(), values.end(),
                                     [&](double v) { return v > 1e-12 * values.back(); });
    EXPECT_EQ(above, rank) << element_name(type); // as CalculiX has it
  }
}

TEST(Elements, InvertedElementsAreSeen) {
  auto nodes = distorted(ElementType::tet4);
  std::swap(nodes[0], nodes[1]);
  EXPECT_LT(
      solid_matrices(ElementType::tet4, nodes, {isotropic(E, nu, rho)}, MassRule::full)
          .min_detJ,
      0);
}

TEST(Elements, ImpossibleMaterialsAreRefused) {
  EXPECT_THROW(isotropic(-1, 0.3, 1), Error);
  EXPECT_THROW(isotropic(1, 0.5, 1), Error);
  EXPECT_THROW(
      orthotropic({1, 1, 1, 0.9, 0.9, 0.9, 1, 1, 1}, {1, 0, 0, 0, 1, 0, 0, 0, 1}, 1),
      Error);
  EXPECT_THROW(orthotropic({1, 1, 1, 0, 0, 0, 1, 1, 1}, {1, 0, 0, 1, 0, 0, 0, 0, 1}, 1),
               Error);
}
