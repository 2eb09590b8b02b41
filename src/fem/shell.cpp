#include "fem/shell.hpp"

#include "base/error.hpp"
#include "fem/condensation.hpp"
#include "fem/membrane.hpp"
#include "fem/shell_kinematics.hpp"
#include "fem/vectors.hpp"
#include "linalg/decompositions.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

namespace flexgram {
bool is_shell(ElementType type) {
  return type == ElementType::tri3 || type == ElementType::quad4 || is_membrane(type);
}

namespace {

/// A += w Rᵀ S R.
void add_product(Dense& A, const Dense& R, const Dense& S, double w) {
  add_to(A, multiply_transposed(R, multiply(S, R)), w);
}

/// The mean shear stiffness over all directions in the plane, of forces (k = 0) or moments (k = 3): the
/// same in turned axes (Tsai and Hahn 1980).
double mean_shear(const Dense& ABD, int k) {
  return (ABD(k, k) + ABD(k + 1, k + 1) - 2 * ABD(k, k + 1) + 4 * ABD(k + 2, k + 2)) / 8;
}

/// What ties the rotation about the normal to that of the surface: as stiff as the twist of the element
/// [N/m]. A multiple of G t would lock thin curved shells of coarse elements, or leave thick folded
/// ones of fine elements too soft.
double drilling_stiffness(const ShellLaw& law, const ShellLaw& part, double size) {
  const double by_twist = 1 / (size * size);
  const bool is_thick = mean_shear(law.ABD, 3) * by_twist > mean_shear(law.ABD, 0);
  return is_thick ? mean_shear(part.ABD, 0) : mean_shear(part.ABD, 3) * by_twist;
}

/// K over all dofs by a part of the law.
Dense part_over_all_dofs(const ShellShape& shape, const std::vector<ShellStrain>& points,
                         const ShellLaw& law, const ShellLaw& part) {
  Dense K(shape.dofs(), shape.dofs()), tied(1, 1);
  tied(0, 0) = drilling_stiffness(law, part, shape.size);
  for (const ShellStrain& at : points) {
    add_product(K, at.stretch, part.ABD, at.area);
    add_product(K, at.shear, part.shear, at.area);
    add_product(K, at.drilling, tied, at.area);
  }
  symmetrise(K);
  return K;
}

/// Movement of nodes' middle surfaces by the nodes: u + θ × o n.
Dense offset_transformation(const ShellShape& shape, double offset) {
  const int nodes = static_cast<int>(shape.normals.size());
  Dense T = identity(6 * nodes);
  for (int a = 0; a < nodes; ++a) {
    const Vector3& n = shape.normals[as_size(a)];
    const int u = 6 * a, theta = u + 3;
    for (int c = 0; c < 3; ++c) { // θ × n
      const int d = (c + 1) % 3, e = (c + 2) % 3;
      T(u + c, theta + d) += offset * n[as_size(e)];
      T(u + c, theta + e) -= offset * n[as_size(d)];
    }
  }
  return T;
}

} // namespace

namespace {

/// The middle surface, and its motion by that of the nodes; empty where they are in it.
struct MiddleSurface {
  MiddleSurface(ElementType type, const std::vector<Vector3>& nodes,
                const ShellPlace& place)
      : shape(type, nodes) {
    if (place.offset == 0) return;
    T = offset_transformation(shape, place.offset);
    std::vector<Vector3> middle = nodes;
    for (std::size_t a = 0; a < nodes.size(); ++a)
      for (std::size_t c = 0; c < 3; ++c)
        middle[a][c] += place.offset * shape.normals[a][c];
    shape = ShellShape(type, middle);
    if (!(shape.least_det > 0))
      throw Error("the offset of a shell is larger than the radius of its surface");
  }

  ShellShape shape;
  Dense T;
};

} // namespace

Dense with_offset(ElementType type, const std::vector<Vector3>& nodes,
                  const ShellPlace& place,
                  const std::function<Dense(const ShellShape&)>& matrix) {
  const MiddleSurface middle(type, nodes, place);
  const Dense A = matrix(middle.shape);
  return middle.T.data.empty() ? A : multiply_transposed(middle.T, multiply(A, middle.T));
}

std::vector<ShellStrainPoint> shell_strains(ElementType type,
                                            const std::vector<Vector3>& nodes,
                                            const ShellLaw& law,
                                            const ShellPlace& place) {
  if (is_membrane(type)) return membrane_strains(type, nodes, law, place);
  const MiddleSurface middle(type, nodes, place);
  const std::vector<ShellStrain> strains = middle.shape.strains(place);
  Dense T = condensation(shell_stiffness(middle.shape, strains, law),
                         middle.shape.dofs() - 6 * static_cast<int>(nodes.size()));
  if (!middle.T.data.empty()) T = multiply(T, middle.T);
  std::vector<ShellStrainPoint> points;
  for (const ShellStrain& at : strains)
    points.push_back({at.area, multiply(at.stretch, T), at.axes});
  return points;
}

HeldShell hold_shell(ElementType type, const std::vector<Vector3>& nodes,
                     const ShellLaw& law, const ShellPlace& place,
                     const std::vector<Dense>& resultants) {
  if (is_membrane(type)) return hold_membrane(type, nodes, law, place, resultants);
  const MiddleSurface middle(type, nodes, place);
  const std::vector<ShellStrain> strains = middle.shape.strains(place);
  std::vector<Dense> stretch;
  std::vector<double> area;
  for (const ShellStrain& at : strains) {
    stretch.push_back(at.stretch);
    area.push_back(at.area);
  }
  HeldShell held = hold(shell_stiffness(middle.shape, strains, law),
                        middle.shape.dofs() - 6 * static_cast<int>(nodes.size()), stretch,
                        area, resultants);
  if (!middle.T.data.empty()) held.forces = multiply_transposed(middle.T, held.forces);
  return held;
}

HeldShell hold(const Dense& K, int internal, const std::vector<Dense>& stretch,
               const std::vector<double>& area, const std::vector<Dense>& resultants) {
  Dense load(K.rows, 1);
  for (std::size_t p = 0; p < stretch.size(); ++p)
    add_to(load, multiply_transposed(stretch[p], resultants[p]), area[p]);
  HeldShell held;
  const Dense give = internal_response(K, internal, load);
  for (const Dense& at : stretch) held.strains.push_back(multiply(at, give));
  held.forces = multiply_transposed(condensation(K, internal), load);
  return held;
}

Dense shell_stiffness(const ShellShape& shape, const std::vector<ShellStrain>& points,
                      const ShellLaw& law) {
  return part_over_all_dofs(shape, points, law, law);
}

Dense shell_part_stiffness(ElementType type, const std::vector<Vector3>& nodes,
                           const ShellLaw& law, const ShellLaw& part,
                           const ShellPlace& place) {
  Dense K = with_offset(type, nodes, place, [&](const ShellShape& shape) {
    const std::vector<ShellStrain> points = shape.strains(place);
    const Dense whole = shell_stiffness(shape, points, law);
    return condensed(
        part_over_all_dofs(shape, points, law, part),
        condensation(whole, shape.dofs() - 6 * static_cast<int>(nodes.size())));
  });
  symmetrise(K);
  return K;
}

namespace {

/// M at a point: N_a N_b (ρ t I over displacements of two nodes, ∫ρz² B_aᵀB_b over their rotations,
/// ∫ρz B_b between both), B_a θ = θ × n_a, and the inertia against the rotation about the normal.
void add_mass(Dense& M, const ShellPoint& at, const std::vector<Vector3>& normals,
              const ShellLaw& law) {
  const int nodes = static_cast<int>(normals.size());
  for (int b = 0; b < nodes; ++b)
    for (int a = 0; a < nodes; ++a) {
      const double share = at.area * at.moved(0, 6 * a) * at.moved(0, 6 * b);
      const Vector3 &n_a = normals[as_size(a)], &n_b = normals[as_size(b)];
      const double along = dot(n_a, n_b);
      for (int c = 0; c < 3; ++c) {
        M(6 * a + c, 6 * b + c) += share * law.mass;
        // (e_c × n_a)·(e_d × n_b) = δ_cd n_a·n_b − n_b[c] n_a[d]
        for (int d = 0; d < 3; ++d)
          M(6 * a + 3 + c, 6 * b + 3 + d) +=
              share * law.second *
              ((c == d ? along : 0) - n_b[as_size(c)] * n_a[as_size(d)]);
        if (law.first == 0) continue;
        const double first = share * law.first; // of e_d × n: n[d + 2] along d + 1 …
        const int d = (c + 1) % 3, e = (c + 2) % 3;
        M(6 * a + d, 6 * b + 3 + c) -= first * n_b[as_size(e)];
        M(6 * a + e, 6 * b + 3 + c) += first * n_b[as_size(d)];
        M(6 * a + 3 + c, 6 * b + d) -= first * n_a[as_size(e)];
        M(6 * a + 3 + c, 6 * b + e) += first * n_a[as_size(d)];
      }
    }
  add_to(M, multiply_transposed(at.drilling, at.drilling), at.area * law.second);
}

} // namespace

ElementMatrices shell_matrices(ElementType type, const std::vector<Vector3>& nodes,
                               const ShellLaw& law, const ShellPlace& place,
                               bool with_stiffness) {
  ElementMatrices result;
  const ShellShape at_nodes(type, nodes);
  result.min_detJ = at_nodes.least_det;
  result.shape_ratio = at_nodes.least_det / at_nodes.most_det;
  result.aspect = at_nodes.size / law.thickness;
  if (!(at_nodes.least_det > 0)) return result;
  const int n = 6 * static_cast<int>(nodes.size());
  const MiddleSurface middle(type, nodes, place);
  Dense M(n, n), beside(n, 9);
  for (const ShellPoint& at : middle.shape.mass_points()) {
    result.mass += at.area * law.mass;
    add_mass(M, at, middle.shape.normals, law);
    for (int dof = 0; dof < n; ++dof)
      for (int i = 0; i < 3; ++i)
        for (int j = 0; j < 3; ++j)
          beside(dof, 3 * i + j) +=
              at.area * at.normal[as_size(j)] *
              (law.first * at.moved(i, dof) + law.second * at.turned(i, dof));
  }
  for (int a = 0; place.offset != 0 && a < n / 6; ++a) // its middle is at r = o n
    for (int dof = 0; dof < n; ++dof)
      for (int i = 0; i < 3; ++i)
        for (int j = 0; j < 3; ++j)
          beside(dof, 3 * i + j) +=
              M(dof, 6 * a + i) * place.offset * at_nodes.normals[as_size(a)][as_size(j)];
  const bool is_middle = middle.T.data.empty();
  result.M = is_middle ? M : multiply_transposed(middle.T, multiply(M, middle.T));
  result.beside = is_middle ? beside : multiply_transposed(middle.T, beside);
  symmetrise(result.M);
  if (!with_stiffness) return result;
  result.K = with_offset(type, nodes, place, [&](const ShellShape& shape) {
    const Dense K = shell_stiffness(shape, shape.strains(place), law);
    return condensed_stiffness(K, shape.dofs() - n);
  });
  symmetrise(result.K);
  return result;
}

} // namespace flexgram
