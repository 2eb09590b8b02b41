#include "fem/shell_kinematics.hpp"

#include "base/error.hpp"
#include "fem/shape_functions.hpp"
#include "fem/vectors.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

namespace flexgram {
namespace {

double norm(const Vector3& a) { return std::sqrt(dot(a, a)); }
void add(Vector3& a, double factor, const Vector3& b) {
  for (std::size_t c = 0; c < 3; ++c) a[c] += factor * b[c];
}
Vector3 unit_of(Vector3 a) {
  const double size = norm(a);
  if (size > 0)
    for (double& c : a) c /= size;
  return a;
}
/// e_c × a
Vector3 turned_about(std::size_t c, const Vector3& a) {
  Vector3 e{};
  e[c] = 1;
  return cross(e, a);
}

/// Two axes of the surface across its normal, the first along the projection of a direction.
std::array<Vector3, 2> axes_along(Vector3 direction, const Vector3& normal) {
  add(direction, -dot(direction, normal), normal);
  direction = unit_of(direction);
  return {direction, cross(normal, direction)};
}

/// The section's axes at the centre of an element. Those at its points are along these: axis_1 itself,
/// where it is nearly normal, would turn from one to the next.
std::array<Vector3, 2> axes_of(const Vector3& normal, const ShellPlace& place) {
  Vector3 first = place.axis_1;
  add(first, -dot(first, normal), normal);
  if (!(norm(first) > 0.03 * norm(place.axis_1))) {
    if (!place.isotropic)
      throw Error(
          "axis_1 of a shell's section is along its normal: give another direction");
    // One that the normal is far from.
    const std::size_t c = std::abs(normal[2]) < 0.9 ? 2 : 1;
    first = {};
    first[c] = 1;
  }
  return axes_along(first, normal);
}

/// The cubic bubble of a triangle, and its slopes.
std::array<double, 3> bubble_at(const Vector3& xi) {
  const double r = xi[0], s = xi[1], t = 1 - r - s;
  return {27 * r * s * t, 27 * s * (t - r), 27 * r * (t - s)};
}

/// Points in the triangle where MITC3+ takes shear (Lee, Lee and Bathe 2014, Fig. 4).
constexpr double aside = 1e-4;
const std::vector<Vector3> tying_of_triangle = {{1.0 / 6, 2.0 / 3, 0},
                                                {2.0 / 3, 1.0 / 6, 0},
                                                {1.0 / 6, 1.0 / 6, 0},
                                                {1.0 / 3 + aside, 1.0 / 3 - 2 * aside, 0},
                                                {1.0 / 3 - 2 * aside, 1.0 / 3 + aside, 0},
                                                {1.0 / 3 + aside, 1.0 / 3 + aside, 0}};
/// Of a quadrilateral: along r below and above, along s left and right.
const std::vector<Vector3> tying_of_quadrilateral = {
    {0, -1, 0}, {0, 1, 0}, {-1, 0, 0}, {1, 0, 0}};

} // namespace

/// The surface at a point: shape functions, tangents, the interpolated normal and its slopes.
struct ShellShape::Surface {
  ShapePoint shape;
  Vector3 x_r{}, x_s{}, n{}, n_r{}, n_s{};
  Vector3 normal{}; ///< of unit length
  double det = 0;
};

/// Covariant strains over all dofs.
struct ShellShape::Covariant {
  Dense stretch; ///< 6 × dofs: rr, ss, 2rs of the surface, then of its curvature
  Dense shear;   ///< 2 × dofs: r, s
};

ShellShape::ShellShape(ElementType type, std::vector<Vector3> nodes)
    : type_(type), x_(std::move(nodes)) {
  const bool is_triangle = type_ == ElementType::tri3;
  const std::size_t count = x_.size();
  if (is_triangle) centre_ = {1.0 / 3, 1.0 / 3, 0};
  const Surface centre = surface_at(centre_);
  least_det = std::numeric_limits<double>::max();
  for (std::size_t a = 0; a < count; ++a) {
    Vector3 next = x_[(a + 1) % count], last = x_[(a + count - 1) % count];
    add(next, -1, x_[a]);
    add(last, -1, x_[a]);
    const Vector3 area = cross(next, last);
    normals.push_back(unit_of(area));
    const double det = (is_triangle ? 1 : 0.25) * dot(area, centre.normal);
    least_det = std::min(least_det, det);
    most_det = std::max(most_det, det);
  }
  size = std::sqrt(centre.det * (is_triangle ? 0.5 : 4));
  if (!(least_det > 0)) return;
  in_plane_ = axes_of(centre.normal, {});
  for (const Vector3& at : is_triangle ? tying_of_triangle : tying_of_quadrilateral)
    tying_.push_back(covariant(at).shear);
}

int ShellShape::dofs() const { return type_ == ElementType::tri3 ? 20 : 28; }

ShellShape::Surface ShellShape::surface_at(const Vector3& xi) const {
  Surface at{shape_at(type_, xi, 0)};
  for (std::size_t a = 0; a < x_.size(); ++a) {
    add(at.x_r, at.shape.dN[a][0], x_[a]);
    add(at.x_s, at.shape.dN[a][1], x_[a]);
    if (normals.size() < x_.size()) continue;
    add(at.n, at.shape.N[a], normals[a]);
    add(at.n_r, at.shape.dN[a][0], normals[a]);
    add(at.n_s, at.shape.dN[a][1], normals[a]);
  }
  const Vector3 area = cross(at.x_r, at.x_s);
  at.det = norm(area);
  at.normal = unit_of(area);
  return at;
}

ShellShape::Covariant ShellShape::covariant(const Vector3& xi) const {
  const Surface at = surface_at(xi);
  const bool is_triangle = type_ == ElementType::tri3;
  Covariant of{Dense(6, dofs()), Dense(2, dofs())};
  /// A dof that turns the normal by b: f b, f_r b, f_s b.
  const auto turn = [&](int dof, const Vector3& b, double f, double f_r, double f_s) {
    of.stretch(3, dof) = f_r * dot(at.x_r, b);
    of.stretch(4, dof) = f_s * dot(at.x_s, b);
    of.stretch(5, dof) = f_s * dot(at.x_r, b) + f_r * dot(at.x_s, b);
    of.shear(0, dof) = f * dot(at.x_r, b);
    of.shear(1, dof) = f * dot(at.x_s, b);
  };
  const std::array<double, 3> bubble =
      is_triangle ? bubble_at(xi) : std::array<double, 3>{};
  for (std::size_t a = 0; a < x_.size(); ++a) {
    const double h = at.shape.N[a], h_r = at.shape.dN[a][0], h_s = at.shape.dN[a][1];
    for (std::size_t c = 0; c < 3; ++c) {
      const int u = static_cast<int>(6 * a + c), theta = u + 3;
      of.stretch(0, u) = h_r * at.x_r[c];
      of.stretch(1, u) = h_s * at.x_s[c];
      of.stretch(2, u) = h_s * at.x_r[c] + h_r * at.x_s[c];
      of.stretch(3, u) = h_r * at.n_r[c];
      of.stretch(4, u) = h_s * at.n_s[c];
      of.stretch(5, u) = h_s * at.n_r[c] + h_r * at.n_s[c];
      of.shear(0, u) = h_r * at.n[c];
      of.shear(1, u) = h_s * at.n[c];
      turn(theta, turned_about(c, normals[a]), h - bubble[0] / 3, h_r - bubble[1] / 3,
           h_s - bubble[2] / 3);
    }
  }
  if (is_triangle)
    for (std::size_t k = 0; k < 2; ++k)
      turn(18 + static_cast<int>(k), cross(in_plane_[k], at.normal), bubble[0], bubble[1],
           bubble[2]);
  return of;
}

Dense ShellShape::tied_shear(const Vector3& xi) const {
  Dense shear(2, dofs());
  const double r = xi[0], s = xi[1];
  const auto take = [&](int row, double factor, std::size_t point, int component) {
    for (int j = 0; j < dofs(); ++j)
      shear(row, j) += factor * tying_[point](component, j);
  };
  if (type_ == ElementType::quad4) {
    take(0, 0.5 * (1 - s), 0, 0);
    take(0, 0.5 * (1 + s), 1, 0);
    take(1, 0.5 * (1 - r), 2, 1);
    take(1, 0.5 * (1 + r), 3, 1);
    return shear;
  }
  enum : std::size_t { A, B, C, D, E, F };
  take(0, 2.0 / 3, B, 0);
  take(0, -1.0 / 3, B, 1);
  take(1, 2.0 / 3, A, 1);
  take(1, -1.0 / 3, A, 0);
  for (int row = 0; row < 2; ++row) {
    take(row, 1.0 / 3, C, 0);
    take(row, 1.0 / 3, C, 1);
    const double rest = (row == 0 ? 3 * s - 1 : 1 - 3 * r) / 3;
    take(row, rest, F, 0);
    take(row, -rest, D, 0);
    take(row, -rest, F, 1);
    take(row, rest, E, 1);
  }
  return shear;
}

namespace {

/// ∂r/∂x, ∂s/∂x, ∂r/∂y, ∂s/∂y over two axes in the surface.
using Slopes = std::array<double, 4>;

Slopes slopes_of(const Vector3& x_r, const Vector3& x_s, double det,
                 const std::array<Vector3, 2>& axes) {
  return {dot(x_s, axes[1]) / det, -dot(x_r, axes[1]) / det, -dot(x_s, axes[0]) / det,
          dot(x_r, axes[0]) / det};
}

/// The rotation of a node's functions about the normal, less that of the surface, of u and θ.
void set_drilling(Dense& drilling, std::size_t node, const ShapePoint& p,
                  const Slopes& slopes, const std::array<Vector3, 2>& axes,
                  const Vector3& normal) {
  const Vector3& d = p.dN[node];
  const double h_x = slopes[0] * d[0] + slopes[1] * d[1],
               h_y = slopes[2] * d[0] + slopes[3] * d[1];
  for (std::size_t c = 0; c < 3; ++c) {
    const int u = static_cast<int>(6 * node + c);
    drilling(0, u) = -0.5 * (axes[1][c] * h_x - axes[0][c] * h_y);
    drilling(0, u + 3) = p.N[node] * normal[c];
  }
}

} // namespace

std::vector<ShellPoint> ShellShape::mass_points() const {
  std::vector<ShellPoint> points;
  const int count = 6 * static_cast<int>(x_.size());
  for (const ShapePoint& p : flexgram::mass_points(type_)) {
    const Surface at = surface_at(p.xi);
    const std::array<Vector3, 2> axes = axes_along(in_plane_[0], at.normal);
    const Slopes slopes = slopes_of(at.x_r, at.x_s, at.det, axes);
    ShellPoint point{p.weight * at.det, at.n,           Dense(3, count), Dense(3, count),
                     Dense(3, count),   Dense(1, count)};
    for (std::size_t a = 0; a < x_.size(); ++a) {
      set_drilling(point.drilling, a, p, slopes, axes, at.normal);
      for (std::size_t c = 0; c < 3; ++c) {
        const int u = static_cast<int>(6 * a + c), theta = u + 3,
                  row = static_cast<int>(c);
        point.moved(row, u) = point.rotation(row, theta) = p.N[a];
        const Vector3 b = turned_about(c, normals[a]);
        for (int i = 0; i < 3; ++i) point.turned(i, theta) = p.N[a] * b[as_size(i)];
      }
    }
    points.push_back(std::move(point));
  }
  return points;
}

std::vector<ShellStrain> ShellShape::strains(const ShellPlace& place) const {
  const Surface centre = surface_at(centre_);
  const std::array<Vector3, 2> centre_axes = axes_of(centre.normal, place);
  const Slopes at_centre = slopes_of(centre.x_r, centre.x_s, centre.det, centre_axes);
  std::vector<ShellStrain> points;
  for (const ShapePoint& p : stiffness_points(type_)) {
    const Surface at = surface_at(p.xi);
    const std::array<Vector3, 2> axes = axes_along(centre_axes[0], at.normal);
    const Slopes slopes = slopes_of(at.x_r, at.x_s, at.det, axes);
    const auto [a, b, c, e] = slopes;
    Dense T(3, 3), both(6, 6), S(2, 2); // strains in the axes by covariant ones
    T.data = {a * a,     c * c, 2 * a * c, b * b,        e * e,
              2 * b * e, a * b, c * e,     a * e + b * c};
    set_part(both, 0, 0, T);
    set_part(both, 3, 3, T);
    S.data = {a, c, b, e};
    ShellStrain strain{p.weight * at.det,
                       multiply(both, covariant(p.xi).stretch),
                       multiply(S, tied_shear(p.xi)),
                       Dense(1, dofs()),
                       Dense(6, dofs()),
                       at.normal,
                       axes};
    for (std::size_t k = 0; k < x_.size(); ++k) {
      const double h_x = a * p.dN[k][0] + b * p.dN[k][1],
                   h_y = c * p.dN[k][0] + e * p.dN[k][1];
      set_drilling(strain.drilling, k, p, slopes, axes, at.normal);
      for (std::size_t i = 0; i < 3; ++i) {
        const int u = static_cast<int>(6 * k + i);
        strain.slope(static_cast<int>(i), u) = h_x;
        strain.slope(static_cast<int>(3 + i), u) = h_y;
      }
    }
    if (type_ == ElementType::quad4)
      for (int mode = 0; mode < 2; ++mode) { // 1 − r², 1 − s², by the centre's slopes
        const double slope = -2 * p.xi[as_size(mode)] * centre.det / at.det;
        Vector3 g{};
        add(g, slope * at_centre[as_size(mode)], centre_axes[0]);
        add(g, slope * at_centre[as_size(2 + mode)], centre_axes[1]);
        const double g_x = dot(g, axes[0]), g_y = dot(g, axes[1]);
        for (int k = 0; k < 2; ++k) { // along the centre's axes
          const int dof = 24 + 2 * mode + k;
          const Vector3& moved = centre_axes[as_size(k)];
          const double u_x = dot(moved, axes[0]), u_y = dot(moved, axes[1]);
          strain.stretch(0, dof) = g_x * u_x;
          strain.stretch(1, dof) = g_y * u_y;
          strain.stretch(2, dof) = g_x * u_y + g_y * u_x;
          strain.drilling(0, dof) = -0.5 * dot(at.normal, cross(g, moved));
          for (int i = 0; i < 3; ++i) {
            strain.slope(i, dof) = g_x * moved[as_size(i)];
            strain.slope(3 + i, dof) = g_y * moved[as_size(i)];
          }
        }
      }
    points.push_back(std::move(strain));
  }
  return points;
}

} // namespace flexgram
