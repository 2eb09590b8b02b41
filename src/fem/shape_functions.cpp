#include "fem/shape_functions.hpp"

#include "base/index.hpp"

#include <cmath>

namespace flexgram {
namespace {

/// Tetrahedron in barycentric coordinates l0 = 1 − ξ − η − ζ, l1 = ξ, l2 = η, l3 = ζ.
void tetrahedron(ShapePoint& p, bool quadratic) {
  const double l[4] = {1 - p.xi[0] - p.xi[1] - p.xi[2], p.xi[0], p.xi[1], p.xi[2]};
  const Vector3 dl[4] = {{-1, -1, -1}, {1, 0, 0}, {0, 1, 0}, {0, 0, 1}};
  if (!quadratic) {
    p.N.assign(l, l + 4);
    p.dN.assign(dl, dl + 4);
    return;
  }
  const int edges[6][2] = {{0, 1}, {1, 2}, {0, 2}, {0, 3}, {1, 3}, {2, 3}};
  p.N.resize(10);
  p.dN.resize(10);
  for (std::size_t i = 0; i < 4; ++i) {
    p.N[i] = l[i] * (2 * l[i] - 1);
    for (std::size_t a = 0; a < 3; ++a) p.dN[i][a] = (4 * l[i] - 1) * dl[i][a];
  }
  for (std::size_t e = 0; e < 6; ++e) {
    const int i = edges[e][0], j = edges[e][1];
    p.N[4 + e] = 4 * l[i] * l[j];
    for (std::size_t a = 0; a < 3; ++a)
      p.dN[4 + e][a] = 4 * (dl[i][a] * l[j] + l[i] * dl[j][a]);
  }
}

constexpr double hex_nodes[20][3] = {{-1, -1, -1}, {1, -1, -1}, {1, 1, -1}, {-1, 1, -1},
                                     {-1, -1, 1},  {1, -1, 1},  {1, 1, 1},  {-1, 1, 1},
                                     {0, -1, -1},  {1, 0, -1},  {0, 1, -1}, {-1, 0, -1},
                                     {0, -1, 1},   {1, 0, 1},   {0, 1, 1},  {-1, 0, 1},
                                     {-1, -1, 0},  {1, -1, 0},  {1, 1, 0},  {-1, 1, 0}};

void hexahedron8(ShapePoint& p) {
  p.N.resize(8);
  p.dN.resize(8);
  for (std::size_t i = 0; i < 8; ++i) {
    double f[3];
    for (std::size_t a = 0; a < 3; ++a) f[a] = 1 + hex_nodes[i][a] * p.xi[a];
    p.N[i] = f[0] * f[1] * f[2] / 8;
    for (std::size_t a = 0; a < 3; ++a)
      p.dN[i][a] = hex_nodes[i][a] * f[(a + 1) % 3] * f[(a + 2) % 3] / 8;
  }
}

void wedge6(ShapePoint& p) {
  const double l[3] = {1 - p.xi[0] - p.xi[1], p.xi[0], p.xi[1]}, z = p.xi[2];
  const double dl[3][2] = {{-1, -1}, {1, 0}, {0, 1}};
  p.N.resize(6);
  p.dN.resize(6);
  for (std::size_t i = 0; i < 3; ++i)
    for (std::size_t top = 0; top < 2; ++top) {
      const double side = top == 1 ? 1 : -1, half = 0.5 * (1 + side * z);
      p.N[3 * top + i] = l[i] * half;
      p.dN[3 * top + i] = {dl[i][0] * half, dl[i][1] * half, 0.5 * side * l[i]};
    }
}

void triangle3(ShapePoint& p) {
  p.N = {1 - p.xi[0] - p.xi[1], p.xi[0], p.xi[1]};
  p.dN = {{-1, -1, 0}, {1, 0, 0}, {0, 1, 0}};
}

void quadrilateral4(ShapePoint& p) {
  p.N.resize(4);
  p.dN.resize(4);
  for (std::size_t i = 0; i < 4; ++i) {
    const double a = hex_nodes[i][0], b = hex_nodes[i][1];
    const double f = 1 + a * p.xi[0], g = 1 + b * p.xi[1];
    p.N[i] = f * g / 4;
    p.dN[i] = {a * g / 4, b * f / 4, 0};
  }
}

/// Serendipity: corners (1+..)(1+..)(1+..)(Σ − 2)/8, edges (1 − t²)(1+..)(1+..)/4.
void hexahedron20(ShapePoint& p) {
  p.N.resize(20);
  p.dN.resize(20);
  for (std::size_t i = 0; i < 20; ++i) {
    const double* n = hex_nodes[i];
    double f[3], df[3];
    std::size_t middle = 3;
    for (std::size_t a = 0; a < 3; ++a) {
      if (n[a] == 0) {
        middle = a;
        f[a] = 1 - p.xi[a] * p.xi[a];
        df[a] = -2 * p.xi[a];
      } else {
        f[a] = 1 + n[a] * p.xi[a];
        df[a] = n[a];
      }
    }
    const double product = f[0] * f[1] * f[2];
    if (middle < 3) {
      p.N[i] = product / 4;
      for (std::size_t a = 0; a < 3; ++a)
        p.dN[i][a] = df[a] * f[(a + 1) % 3] * f[(a + 2) % 3] / 4;
    } else {
      const double s = n[0] * p.xi[0] + n[1] * p.xi[1] + n[2] * p.xi[2] - 2;
      p.N[i] = product * s / 8;
      for (std::size_t a = 0; a < 3; ++a)
        p.dN[i][a] = (df[a] * f[(a + 1) % 3] * f[(a + 2) % 3] * s + product * n[a]) / 8;
    }
  }
}

/// Triangle (l0, l1, l2) times line ζ ∈ [−1, 1], serendipity.
void wedge15(ShapePoint& p) {
  const double l[3] = {1 - p.xi[0] - p.xi[1], p.xi[0], p.xi[1]}, z = p.xi[2];
  const double dl[3][2] = {{-1, -1}, {1, 0}, {0, 1}};
  p.N.resize(15);
  p.dN.resize(15);
  for (std::size_t i = 0; i < 3; ++i)
    for (std::size_t top = 0; top < 2; ++top) {
      const double s = top ? 1 : -1, u = 1 + s * z;
      const std::size_t corner = 3 * top + i;
      p.N[corner] = 0.5 * l[i] * ((2 * l[i] - 1) * u - (1 - z * z));
      for (std::size_t a = 0; a < 2; ++a)
        p.dN[corner][a] = 0.5 * dl[i][a] * ((4 * l[i] - 1) * u - (1 - z * z));
      p.dN[corner][2] = 0.5 * l[i] * ((2 * l[i] - 1) * s + 2 * z);
      const std::size_t j = (i + 1) % 3, edge = 6 + 3 * top + i;
      p.N[edge] = 2 * l[i] * l[j] * u;
      for (std::size_t a = 0; a < 2; ++a)
        p.dN[edge][a] = 2 * (dl[i][a] * l[j] + l[i] * dl[j][a]) * u;
      p.dN[edge][2] = 2 * l[i] * l[j] * s;
    }
  for (std::size_t i = 0; i < 3; ++i) {
    p.N[12 + i] = l[i] * (1 - z * z);
    for (std::size_t a = 0; a < 2; ++a) p.dN[12 + i][a] = dl[i][a] * (1 - z * z);
    p.dN[12 + i][2] = -2 * l[i] * z;
  }
}

struct Point {
  Vector3 xi;
  double weight;
};

std::vector<Point> gauss_line(int count) {
  if (count == 2) return {{{-1 / std::sqrt(3.0)}, 1}, {{1 / std::sqrt(3.0)}, 1}};
  const double x = std::sqrt(0.6);
  return {{{-x}, 5.0 / 9}, {{0}, 8.0 / 9}, {{x}, 5.0 / 9}};
}

std::vector<Point> gauss_square(int count) {
  std::vector<Point> points;
  const auto line = gauss_line(count);
  for (const auto& b : line)
    for (const auto& a : line)
      points.push_back({{a.xi[0], b.xi[0], 0}, a.weight * b.weight});
  return points;
}

std::vector<Point> gauss_cube(int count) {
  std::vector<Point> points;
  const auto line = gauss_line(count);
  for (const auto& c : line)
    for (const auto& b : line)
      for (const auto& a : line)
        points.push_back({{a.xi[0], b.xi[0], c.xi[0]}, a.weight * b.weight * c.weight});
  return points;
}

std::vector<Point> tetrahedron_points(int count) {
  if (count == 1) return {{{0.25, 0.25, 0.25}, 1.0 / 6}};
  std::vector<Point> points;
  const auto corner_family = [&](double a, double weight) {
    const double b = 1 - 3 * a;
    for (const Vector3& xi : {Vector3{a, a, a}, {b, a, a}, {a, b, a}, {a, a, b}})
      points.push_back({xi, weight});
  };
  if (count == 4) {
    corner_family((5 - std::sqrt(5.0)) / 20, 1.0 / 24);
    return points;
  }
  // 14 points of degree 5 with positive weights (Walkington 2000).
  corner_family(0.31088591926330060980, 0.018781320953002641800);
  corner_family(0.092735250310891226402, 0.012248840519393658257);
  const double a = 0.045503704125649649492, b = 0.5 - a, w = 0.0070910034628469110730;
  for (const Vector3& xi :
       {Vector3{a, a, b}, {a, b, a}, {b, a, a}, {a, b, b}, {b, a, b}, {b, b, a}})
    points.push_back({xi, w});
  return points;
}

/// 6 points: degree 4 (Dunavant 1985); 3: degree 2; 1.
std::vector<Point> triangle_points(int count) {
  if (count == 1) return {{{1.0 / 3, 1.0 / 3, 0}, 0.5}};
  std::vector<Point> triangle;
  const auto family = [&](double a, double weight) {
    const double b = 1 - 2 * a;
    for (const Vector3& xi : {Vector3{a, a, 0}, {b, a, 0}, {a, b, 0}})
      triangle.push_back({xi, weight});
  };
  if (count == 6) {
    family(0.445948490915964886318, 0.5 * 0.223381589678011465699);
    family(0.091576213509770743460, 0.5 * 0.109951743655321867638);
  } else {
    family(1.0 / 6, 1.0 / 6);
  }
  return triangle;
}

/// Triangle rule times Gauss points along the wedge.
std::vector<Point> wedge_points(int of_triangle, int along) {
  std::vector<Point> points;
  for (const auto& z : gauss_line(along))
    for (const auto& t : triangle_points(of_triangle))
      points.push_back({{t.xi[0], t.xi[1], z.xi[0]}, t.weight * z.weight});
  return points;
}

std::vector<ShapePoint> tabulate(ElementType type, const std::vector<Point>& points) {
  std::vector<ShapePoint> table;
  for (const auto& point : points)
    table.push_back(shape_at(type, point.xi, point.weight));
  return table;
}

std::vector<Point> points_of(ElementType type, bool mass) {
  switch (type) {
  case ElementType::tet4:
    return tetrahedron_points(mass ? 4 : 1);
  case ElementType::tet10:
    return tetrahedron_points(mass ? 14 : 4);
  case ElementType::hex8:
    return gauss_cube(2);
  case ElementType::hex20:
    return gauss_cube(3);
  case ElementType::wedge15:
    return wedge_points(mass ? 6 : 3, 3);
  case ElementType::hex8_full:
    return gauss_cube(2);
  case ElementType::hex20_reduced:
    return gauss_cube(mass ? 3 : 2);
  case ElementType::wedge6:
    return wedge_points(3, 2);
  case ElementType::wedge6_reduced:
    return wedge_points(mass ? 3 : 1, 2);
  case ElementType::tri3:
  case ElementType::membrane3:
    return triangle_points(6);
  case ElementType::quad4:
  case ElementType::membrane4:
    return gauss_square(2);
  case ElementType::rod2:
  case ElementType::beam2:
  case ElementType::mass1:
  case ElementType::spring1:
  case ElementType::spring2:
  case ElementType::node1:
    break;
  }
  return {};
}

const std::vector<ShapePoint>& cached(ElementType type, bool mass) {
  static const auto tables = [] {
    constexpr std::size_t types = as_size(ElementType::beam2);
    std::array<std::array<std::vector<ShapePoint>, 2>, types> all;
    for (std::size_t t = 0; t < types; ++t)
      for (std::size_t m = 0; m < 2; ++m)
        all[t][m] = tabulate(static_cast<ElementType>(t),
                             points_of(static_cast<ElementType>(t), m));
    return all;
  }();
  return tables[as_size(type)][mass];
}

} // namespace

ShapePoint shape_at(ElementType type, const Vector3& xi, double weight) {
  ShapePoint p{xi, weight, {}, {}};
  switch (type) {
  case ElementType::tet4:
    tetrahedron(p, false);
    break;
  case ElementType::tet10:
    tetrahedron(p, true);
    break;
  case ElementType::hex8:
  case ElementType::hex8_full:
    hexahedron8(p);
    break;
  case ElementType::hex20:
  case ElementType::hex20_reduced:
    hexahedron20(p);
    break;
  case ElementType::wedge15:
    wedge15(p);
    break;
  case ElementType::wedge6:
  case ElementType::wedge6_reduced:
    wedge6(p);
    break;
  case ElementType::tri3:
  case ElementType::membrane3:
    triangle3(p);
    break;
  case ElementType::quad4:
  case ElementType::membrane4:
    quadrilateral4(p);
    break;
  case ElementType::rod2:
  case ElementType::beam2:
  case ElementType::mass1:
  case ElementType::spring1:
  case ElementType::spring2:
  case ElementType::node1:
    break;
  }
  return p;
}

const std::vector<ShapePoint>& stiffness_points(ElementType type) {
  return cached(type, false);
}
const std::vector<ShapePoint>& mass_points(ElementType type) {
  return cached(type, true);
}

} // namespace flexgram
