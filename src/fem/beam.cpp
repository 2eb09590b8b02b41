#include "fem/elements.hpp"

#include "base/error.hpp"
#include "base/index.hpp"
#include "fem/vectors.hpp"

#include <cmath>

namespace flexgram {
namespace {

double norm(const Vector3& a) {
  return std::sqrt(a[0] * a[0] + a[1] * a[1] + a[2] * a[2]);
}

/// Local axes as rows.
std::array<Vector3, 3> local_axes(const Vector3& first, const Vector3& second,
                                  const Vector3& y_axis, double& length) {
  Vector3 x{second[0] - first[0], second[1] - first[1], second[2] - first[2]};
  length = norm(x);
  if (!(length > 0)) return {};
  for (double& c : x) c /= length;
  Vector3 z = cross(x, y_axis);
  const double size = norm(z);
  if (!(size > 1e-6 * norm(y_axis)))
    throw Error("a beam runs along the y_axis of its section; give another direction");
  for (double& c : z) c /= size;
  return {x, cross(z, x), z};
}

/// One bending plane: displacement v and rotation t, with v' = t for a slender beam, and their
/// derivatives, of (v1, θ1, v2, θ2).
struct BendingPoint {
  double s, weight;
  double v[4], dv[4], t[4], dt[4];
};

/// At four Gauss points, exact for products of the cubic interpolation.
/// @param phi  12 EI over shear stiffness and L².
std::array<BendingPoint, 4> bending_points(double L, double phi) {
  constexpr double x[4] = {-0.861136311594052575224, -0.339981043584856264803,
                           0.339981043584856264803, 0.861136311594052575224};
  constexpr double w[4] = {0.347854845137453857373, 0.652145154862546142627,
                           0.652145154862546142627, 0.347854845137453857373};
  const double f = 1 / (1 + phi);
  std::array<BendingPoint, 4> points{};
  for (std::size_t q = 0; q < 4; ++q) {
    const double s = 0.5 * (1 + x[q]);
    points[q] = {
        s,
        0.5 * L * w[q],
        {f * (2 * s * s * s - 3 * s * s - phi * s + 1 + phi),
         f * L * (s * s * s - (2 + phi / 2) * s * s + (1 + phi / 2) * s),
         -f * (2 * s * s * s - 3 * s * s - phi * s),
         f * L * (s * s * s - (1 - phi / 2) * s * s - phi / 2 * s)},
        {f / L * (6 * s * s - 6 * s - phi), f * (3 * s * s - (4 + phi) * s + 1 + phi / 2),
         -f / L * (6 * s * s - 6 * s - phi), f * (3 * s * s - (2 - phi) * s - phi / 2)},
        {f * 6 / L * (s * s - s), f * (3 * s * s - (4 + phi) * s + 1 + phi),
         -f * 6 / L * (s * s - s), f * (3 * s * s - (2 - phi) * s)},
        {f * 6 / (L * L) * (2 * s - 1), f / L * (6 * s - (4 + phi)),
         -f * 6 / (L * L) * (2 * s - 1), f / L * (6 * s - (2 - phi))}};
  }
  return points;
}

/// Of a plane: v' = θz, and w' = −θy.
struct Plane {
  int dofs[4];
  double signs[4];
  double phi; ///< 12 EI over shear stiffness and L²
};

std::array<Plane, 2> planes_of(const BeamMaterial& material, const BeamSection& section,
                               double L) {
  const auto phi = [&](double I, double k) {
    return 12 * (material.E * I) / (k * material.G * section.A * L * L);
  };
  return {{{{1, 5, 7, 11}, {1, 1, 1, 1}, phi(section.I_z, section.k_y)},
           {{2, 4, 8, 10}, {1, -1, 1, -1}, phi(section.I_y, section.k_z)}}};
}

/// Dofs in the element's axes by global ones. @param axes  as rows.
Dense rotation_of(const std::array<Vector3, 3>& axes) {
  Dense R(12, 12);
  for (int block = 0; block < 4; ++block)
    for (int i = 0; i < 3; ++i)
      for (int j = 0; j < 3; ++j)
        R(3 * block + i, 3 * block + j) = axes[as_size(i)][as_size(j)];
  return R;
}

/// A matrix in the element's axes, in global ones. @param axes  as rows.
Dense in_global(const std::array<Vector3, 3>& axes, const Dense& local,
                Symmetry of = Symmetry::symmetric) {
  const Dense R = rotation_of(axes);
  Dense result = multiply_transposed(R, multiply(local, R));
  symmetrise(result, of);
  return result;
}

} // namespace

StressStiffness beam_stress_stiffness(const Vector3& first, const Vector3& second,
                                      const BeamMaterial& material,
                                      const BeamSection& section,
                                      const std::vector<double>& u, double free,
                                      double& stress) {
  double L = 0;
  const auto axes = local_axes(first, second, section.y_axis, L);
  double stretch = 0;
  for (std::size_t i = 0; i < 3; ++i) stretch += axes[0][i] * (u[6 + i] - u[i]);
  const double EA = material.E * section.A, N = EA * (stretch / L - free);
  stress = std::max(stress, std::abs(N / section.A));
  Dense K(12, 12);
  for (const auto& [dofs, signs, phi] : planes_of(material, section, L))
    for (const BendingPoint& at : bending_points(L, phi))
      for (int i = 0; i < 4; ++i)
        for (int j = 0; j < 4; ++j)
          K(dofs[i], dofs[j]) +=
              signs[i] * signs[j] * at.weight * N * at.dv[i] * at.dv[j];
  const double twist = N * (section.I_y + section.I_z) / (section.A * L);
  K(3, 3) = K(9, 9) = twist;
  K(3, 9) = K(9, 3) = -twist;
  StressStiffness result{in_global(axes, K), Dense(12, 12)};
  if (free == 0) return result;
  result.free = Dense(12, 1);
  for (int i = 0; i < 3; ++i) {
    result.free(6 + i, 0) = EA * free * axes[0][as_size(i)];
    result.free(i, 0) = -result.free(6 + i, 0);
  }
  return result;
}

namespace {

/// Displacement and rotation of a section over the beam's dofs, in its axes.
struct Section {
  double weight; ///< [m]
  Dense U, theta;
};

std::vector<Section> sections_of(const BeamMaterial& material, const BeamSection& section,
                                 double L) {
  const auto planes = planes_of(material, section, L);
  const auto of_v = bending_points(L, planes[0].phi),
             of_w = bending_points(L, planes[1].phi);
  std::vector<Section> sections;
  for (std::size_t q = 0; q < of_v.size(); ++q) {
    Dense U(3, 12), theta(3, 12);
    const double s = of_v[q].s;
    U(0, 0) = theta(0, 3) = 1 - s;
    U(0, 6) = theta(0, 9) = s;
    for (int i = 0; i < 4; ++i) {
      U(1, planes[0].dofs[i]) = planes[0].signs[i] * of_v[q].v[i];
      U(2, planes[1].dofs[i]) = planes[1].signs[i] * of_w[q].v[i];
      theta(2, planes[0].dofs[i]) = planes[0].signs[i] * of_v[q].t[i];
      theta(1, planes[1].dofs[i]) = -planes[1].signs[i] * of_w[q].t[i];
    }
    sections.push_back({of_v[q].weight, std::move(U), std::move(theta)});
  }
  return sections;
}

/// A vector in the element's axes.
Vector3 in_axes(const std::array<Vector3, 3>& axes, const Vector3& x) {
  Vector3 local{};
  for (std::size_t i = 0; i < 3; ++i)
    for (std::size_t k = 0; k < 3; ++k) local[i] += axes[i][k] * x[k];
  return local;
}

Vector3 unit_vector(int i) {
  Vector3 e{};
  e[as_size(i)] = 1;
  return e;
}

/// ∫ρr² of a section about its axes, by length, as distances along x, y and z.
Vector3 rotary_inertia(const BeamMaterial& material, const BeamSection& section) {
  const double rho = section.rotary_inertia * material.density;
  return {0, rho * section.I_z, rho * section.I_y};
}

} // namespace

ElementMatrices beam_matrices(const Vector3& first, const Vector3& second,
                              const BeamMaterial& material, const BeamSection& section) {
  double L = 0;
  const auto axes = local_axes(first, second, section.y_axis, L);
  ElementMatrices result;
  result.min_detJ = 0.5 * L;
  if (!(L > 0)) return result;
  const double rho = material.density, line_mass = rho * section.A;
  result.mass = line_mass * L;
  Dense K(12, 12), M(12, 12);
  const auto bar = [&](int dof, double stiffness, double mass) {
    const int i = dof, j = dof + 6;
    K(i, i) = K(j, j) = stiffness / L;
    K(i, j) = K(j, i) = -stiffness / L;
    M(i, i) = M(j, j) = mass * L / 3;
    M(i, j) = M(j, i) = mass * L / 6;
  };
  bar(0, material.E * section.A, line_mass);
  const Vector3 rotary = rotary_inertia(material, section);
  bar(3, material.G * section.J, rotary[1] + rotary[2]);
  const auto planes = planes_of(material, section, L);
  const double I[2] = {section.I_z, section.I_y}, k[2] = {section.k_y, section.k_z};
  for (std::size_t p = 0; p < 2; ++p) {
    const auto& [dofs, signs, phi] = planes[p];
    const double EI = material.E * I[p], shear = k[p] * material.G * section.A;
    for (const BendingPoint& at : bending_points(L, phi))
      for (int i = 0; i < 4; ++i)
        for (int j = 0; j < 4; ++j) {
          const double sign = signs[i] * signs[j];
          K(dofs[i], dofs[j]) += sign * at.weight *
                                 (EI * at.dt[i] * at.dt[j] +
                                  shear * (at.dv[i] - at.t[i]) * (at.dv[j] - at.t[j]));
          M(dofs[i], dofs[j]) +=
              sign * at.weight *
              (line_mass * at.v[i] * at.v[j] + rotary[p + 1] * at.t[i] * at.t[j]);
        }
  }
  result.K = in_global(axes, K);
  result.M = in_global(axes, M);
  // Masses at r = y e_y + z e_z from the axis move by θ × r and are pushed by A r.
  Dense beside(12, 9);
  for (const auto& [weight, U, theta] : sections_of(material, section, L))
    for (std::size_t e = 1; e < 3; ++e) {
      const Dense turned =
          multiply(cross_matrix(unit_vector(static_cast<int>(e))), theta);
      for (int dof = 0; dof < 12; ++dof)
        for (std::size_t i = 0; i < 3; ++i)
          for (std::size_t j = 0; j < 3; ++j)
            for (std::size_t c = 0; c < 3; ++c)
              beside(dof, static_cast<int>(3 * i + j)) -=
                  weight * rotary[e] * turned(static_cast<int>(c), dof) * axes[c][i] *
                  axes[e][j];
    }
  result.beside = multiply_transposed(rotation_of(axes), beside);
  // Nodes alone move the axis by cubics; with the rotation t × A t of its ends it moves by A r, as it
  // must, and its sections do not turn.
  Dense turning(
      12, 3); // by rotations of both ends, less what sections resist to one as a whole
  const Dense R = rotation_of(axes);
  const double inertia[3] = {rotary[1] + rotary[2], rotary[2], rotary[1]};
  Dense whole(12, 3);
  for (const auto& [weight, U, theta] : sections_of(material, section, L))
    for (int c = 0; c < 3; ++c)
      for (int dof = 0; dof < 12; ++dof)
        whole(dof, c) += weight * inertia[c] * theta(c, dof);
  Dense to_local(3, 3);
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 3; ++j) to_local(i, j) = axes[as_size(i)][as_size(j)];
  add_to(turning, multiply_transposed(R, multiply(whole, to_local)), -1);
  for (int l = 0; l < 3; ++l)
    for (int dof = 0; dof < 12; ++dof)
      turning(dof, l) += result.M(dof, 3 + l) + result.M(dof, 9 + l);
  const Vector3& t = axes[0];
  for (std::size_t m = 0; m < 3; ++m)
    for (std::size_t j = 0; j < 3; ++j) { // (t × A t)_l = ε_lmi t_m A_ij t_j
      const std::size_t i = (m + 1) % 3, l = (m + 2) % 3;
      for (int dof = 0; dof < 12; ++dof) {
        result.beside(dof, static_cast<int>(3 * i + j)) +=
            turning(dof, static_cast<int>(l)) * t[m] * t[j];
        result.beside(dof, static_cast<int>(3 * l + j)) -=
            turning(dof, static_cast<int>(i)) * t[m] * t[j];
      }
    }
  return result;
}

Dense beam_coriolis(const Vector3& first, const Vector3& second,
                    const BeamMaterial& material, const BeamSection& section,
                    const Vector3& axis) {
  double L = 0;
  const auto axes = local_axes(first, second, section.y_axis, L);
  const Vector3 J = rotary_inertia(material, section);
  const Dense W = cross_matrix(in_axes(axes, axis));
  Dense turned(3, 3); // Σ_k J_k (e_i × e_k)ᵀW(e_j × e_k): points at r move by θ × r
  for (int k = 1; k < 3; ++k) {
    const Dense R = cross_matrix(unit_vector(k)); // −(θ × e_k), twice
    add_to(turned, multiply_transposed(R, multiply(W, R)), J[as_size(k)]);
  }
  Dense G(12, 12);
  for (const auto& [weight, U, theta] : sections_of(material, section, L)) {
    add_to(G, multiply_transposed(U, multiply(W, U)),
           2 * weight * material.density * section.A);
    add_to(G, multiply_transposed(theta, multiply(turned, theta)), 2 * weight);
  }
  return in_global(axes, G, Symmetry::skew);
}

Dense beam_gyroscopic(const Vector3& first, const Vector3& second,
                      const BeamMaterial& material, const BeamSection& section,
                      const Vector3& axis, const Vector3& point) {
  double L = 0;
  const auto axes = local_axes(first, second, section.y_axis, L);
  const Vector3 along = in_axes(axes, axis);
  Vector3 from{};
  for (std::size_t i = 0; i < 3; ++i) from[i] = first[i] - point[i];
  const Vector3 off = cross(axis, from);
  const double distance = std::sqrt(off[0] * off[0] + off[1] * off[1] + off[2] * off[2]);
  if (std::abs(std::abs(along[0]) - 1) > 1e-9 || distance > 1e-6 * L)
    throw Error(
        "spin: in the frame at rest beams lie on the axis of the spin; others are "
        "seen in the frame that turns (frame: turning)");
  if (std::abs(section.I_y - section.I_z) > 1e-6 * (section.I_y + section.I_z))
    throw Error("spin: in the frame at rest sections have I_y = I_z; others are seen in "
                "the frame that turns (frame: turning)");
  Dense turned(3, 3); // d/dt of the angular momentum Ω I_p (e + θ × e)
  const Vector3 rotary = rotary_inertia(material, section);
  turned(1, 2) = (rotary[1] + rotary[2]) * along[0];
  turned(2, 1) = -turned(1, 2);
  Dense G(12, 12);
  for (const auto& [weight, U, theta] : sections_of(material, section, L))
    add_to(G, multiply_transposed(theta, multiply(turned, theta)), weight);
  return in_global(axes, G, Symmetry::skew);
}

Dense beam_spin_softening(const Vector3& first, const Vector3& second,
                          const BeamMaterial& material, const BeamSection& section,
                          const Vector3& axis) {
  double L = 0;
  const auto axes = local_axes(first, second, section.y_axis, L);
  Dense P(3, 3); // of the distance from the axis, in the element's axes
  const Vector3 e = in_axes(axes, axis);
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 3; ++j) P(i, j) = (i == j) - e[as_size(i)] * e[as_size(j)];
  // A section turned by θ moves r by θ×r + ½θ×(θ×r): with J = ∫ρ r rᵀ the second derivatives are
  // ∫ρ (θ×r)ᵀP(θ×r) + θᵀ(½(PJ + JP) − tr(PJ) I)θ.
  const Vector3 J = rotary_inertia(material, section);
  Dense turned(3, 3);
  double trace = 0;
  for (int i = 0; i < 3; ++i) trace += P(i, i) * J[as_size(i)];
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 3; ++j) {
      turned(i, j) = 0.5 * P(i, j) * (J[as_size(i)] + J[as_size(j)]) - (i == j) * trace;
      for (int k = 1; k < 3; ++k) { // (e_i × e_k)ᵀ P (e_j × e_k)
        const Vector3 a = cross(unit_vector(i), unit_vector(k)),
                      b = cross(unit_vector(j), unit_vector(k));
        for (int r = 0; r < 3; ++r)
          for (int c = 0; c < 3; ++c)
            turned(i, j) += J[as_size(k)] * a[as_size(r)] * P(r, c) * b[as_size(c)];
      }
    }
  Dense S(12, 12);
  for (const auto& [weight, U, theta] : sections_of(material, section, L)) {
    add_to(S, multiply_transposed(U, multiply(P, U)),
           weight * material.density * section.A);
    add_to(S, multiply_transposed(theta, multiply(turned, theta)), weight);
  }
  return in_global(axes, S);
}

} // namespace flexgram
