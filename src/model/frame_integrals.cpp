#include "model/frame_integrals.hpp"

#include "base/index.hpp"
#include "linalg/sparse.hpp"
#include "linalg/sparse_product.hpp"
#include "model/mass_by_directions.hpp"
#include "model/rigid_body_modes.hpp"

#include <algorithm>
#include <cmath>

namespace flexgram {
namespace {

/// Rows of the body × 6 dofs of every node: 1 where the row is that dof.
Matrix nodal_dofs(const SecondOrderModel& model, RowRange dofs, PetscInt total) {
  LocalRows local;
  for (std::size_t i = 0; i < model.node.size(); ++i) {
    local.column.push_back(static_cast<PetscInt>(6 * model.node[i] + model.component[i]));
    local.value.push_back(1.0);
    local.start.push_back(static_cast<PetscInt>(local.column.size()));
  }
  return make_sparse(model.comm, model.rows, model.n, local, dofs, total);
}

/// u ↦ e_axis × u at every node, of translations and of rotations.
Matrix nodal_turn(MPI_Comm comm, RowRange dofs, PetscInt total, int axis) {
  LocalRows local;
  for (PetscInt dof = dofs.begin; dof < dofs.end; ++dof) {
    const auto component = static_cast<int>(dof % 3);
    if (component != axis) { // (e_a × u)_{a+1} = −u_{a+2}, (e_a × u)_{a+2} = u_{a+1}
      local.column.push_back(dof - component + (3 - axis - component));
      local.value.push_back(component == (axis + 1) % 3 ? -1.0 : 1.0);
    }
    local.start.push_back(static_cast<PetscInt>(local.column.size()));
  }
  return make_sparse(comm, dofs, total, local, dofs, total);
}

/// G_1, G_2, G_3 on the rows of the body; rows of a node may lie anywhere.
std::array<Matrix, 3> turns(const SecondOrderModel& model) {
  std::int64_t last = -1;
  for (auto node : model.node) last = std::max(last, node);
  const auto nodes =
      static_cast<PetscInt>(max_over(model.comm, static_cast<double>(last))) + 1;
  const RowRange mine = even_rows(model.comm, nodes);
  const RowRange dofs{6 * mine.begin, 6 * mine.end};
  const Matrix gather = nodal_dofs(model, dofs, 6 * nodes);
  Matrix scatter;
  FG_CALL(MatTranspose(gather, MAT_INITIAL_MATRIX, scatter.out()));
  std::array<Matrix, 3> result;
  for (int axis = 0; axis < 3; ++axis) {
    const Matrix turn = nodal_turn(model.comm, dofs, 6 * nodes, axis);
    FG_CALL(MatPtAP(turn, scatter, MAT_INITIAL_MATRIX, PETSC_DEFAULT,
                    result[as_size(axis)].out()));
  }
  return result;
}

/// From the mass matrix of the rigid motions about the origin.
std::array<double, 3> centre_of(const Dense& r) {
  const double mass = (r(0, 0) + r(1, 1) + r(2, 2)) / 3;
  std::array<double, 3> centre;
  for (int a = 0; a < 3; ++a) { // mass c_a = e_b · (e_c × mass c) = −e_c · (e_b × mass c)
    const int b = (a + 1) % 3, c = (a + 2) % 3;
    centre[as_size(a)] = 0.5 * (r(b, 3 + c) - r(c, 3 + b)) / mass;
  }
  return centre;
}

/// Adds a part to an m × m block of a matrix.
void add_part(Dense& to, int row, int column, const Dense& part, double scale) {
  for (int j = 0; j < part.columns; ++j)
    for (int i = 0; i < part.rows; ++i) to(row + i, column + j) += scale * part(i, j);
}

/// What M_s adds to the integrals, by P_cd = V_cᵀM_sV_d of the directions c, d:
/// φ_j · (e_a × φ_k) = P_{a+2,a+1} − P_{a+1,a+2}, and (e_a × φ_j) · (e_b × φ_k) =
/// δ_ab Σ_c P_cc − P_ba.
void add_same(FrameIntegrals& result, const MassByDirections& M, const Basis& V) {
  const int m = static_cast<int>(V.columns());
  std::array<Basis, 3> of;
  for (int c = 0; c < 3; ++c)
    for (const Block& piece : V.pieces()) of[as_size(c)].append(M.direction(piece, c));
  for (int d = 0; d < 3; ++d) {
    Basis image;
    for (const Block& piece : of[as_size(d)].pieces())
      image.append(multiply(M.same(), piece));
    for (int c = 0; c <= d; ++c) {
      const Dense P =
          c == d ? symmetric_inner(of[as_size(c)], image) : inner(of[as_size(c)], image);
      if (c == d) {
        for (int a = 0; a < 3; ++a)
          if (a != c) add_part(result.inertia_second, a * m, a * m, P, 1);
        continue;
      }
      const Dense transposed = transpose(P); // P_dc
      add_part(result.inertia_second, d * m, c * m, P, -1);
      add_part(result.inertia_second, c * m, d * m, transposed, -1);
      const int a = 3 - c - d; // c follows d follows a, or d follows c follows a
      const double sign = d == (a + 1) % 3 ? -1 : 1;
      add_part(result.gyroscopic, 0, a * m, transposed, sign);
      add_part(result.gyroscopic, 0, a * m, P, -sign);
    }
  }
}

/// What the rest of M adds to the integrals, in its rows alone.
void add_rest(FrameIntegrals& result, const MassByDirections& M, const Basis& V,
              const std::array<Matrix, 3>& turn) {
  const int m = static_cast<int>(V.columns());
  Basis all;
  for (const Block& piece : V.pieces()) all.append(M.rest_of(piece));
  for (const Matrix& G : turn)
    for (const Block& piece : V.pieces()) all.append(M.rest_of(multiply(G, piece)));
  const Dense gram = symmetric_inner(all, M.rest());
  add_part(result.gyroscopic, 0, 0, part_of(gram, 0, m, m, 3 * m), 1);
  add_part(result.inertia_second, 0, 0, part_of(gram, m, 3 * m, m, 3 * m), 1);
}

} // namespace

Block spin_loads(const SecondOrderModel& model) {
  Basis motions;
  motions.append(rigid_motions(model, {0, 0, 0}, 1));
  const Dense r = symmetric_inner(motions, model.M);
  const Block turning =
      multiply(model.M, select_columns(rigid_motions(model, centre_of(r), 1), {3, 4, 5}));
  const std::array<Matrix, 3> turn = turns(model);
  Block loads(model.comm, model.rows, model.n, 0);
  for (auto [b, c] : {std::pair{0, 0}, {1, 1}, {2, 2}, {0, 1}, {1, 2}, {2, 0}}) {
    // (ω × δu)ᵀ M (ω × x), and G is skew
    const auto part = [&](int x, int y) {
      return multiply(turn[as_size(x)], select_columns(turning, {y}));
    };
    Block load = part(b, c);
    if (b != c) add_product(load, 1.0, part(c, b), identity(1));
    loads = concatenate(loads, load);
  }
  scale_columns(loads, std::vector<double>(6, -1.0));
  return loads;
}

FrameIntegrals frame_integrals(const SecondOrderModel& model, const Basis& V) {
  const int m = static_cast<int>(V.columns());
  Basis motions;
  motions.append(rigid_motions(model, {0, 0, 0}, 1));
  Basis pushed; // M [T R]
  pushed.append(multiply(model.M, motions.pieces().front()));
  const std::array<Matrix, 3> turn = turns(model);
  FrameIntegrals result;
  result.M_r = symmetric_inner(motions, pushed);
  result.M_er = inner(V, pushed);
  result.inertia_first = Dense(3, 3 * m);
  const Block turning = select_columns(pushed.pieces().front(), {3, 4, 5});
  for (int a = 0; a < 3; ++a) { // (M R_b)ᵀG_a V, and G is skew
    Basis across;
    across.append(multiply(turn[as_size(a)], turning));
    Dense first = inner(across, V);
    for (double& x : first.data) x = -x;
    set_part(result.inertia_first, 0, a * m, first);
  }
  result.gyroscopic = Dense(m, 3 * m);
  result.inertia_second = Dense(3 * m, 3 * m);
  const MassByDirections M(model);
  if (M.has_same()) add_same(result, M, V);
  if (M.has_rest()) add_rest(result, M, V, turn);
  const Dense& r = result.M_r;
  result.mass = (r(0, 0) + r(1, 1) + r(2, 2)) / 3;
  result.centre = centre_of(r);
  if (model.stiffening) result.stiffening = model.stiffening->project(V);
  return result;
}

FrameIntegrals project(const FrameIntegrals& integrals, const Dense& Q) {
  const int m = Q.rows, k = Q.columns;
  FrameIntegrals result;
  result.mass = integrals.mass;
  result.centre = integrals.centre;
  result.M_r = integrals.M_r;
  result.M_er = multiply_transposed(Q, integrals.M_er);
  result.gyroscopic = Dense(k, 3 * k);
  result.inertia_first = Dense(3, 3 * k);
  result.inertia_second = Dense(3 * k, 3 * k);
  for (int a = 0; a < 3; ++a) {
    const Dense turned =
        multiply(part_of(integrals.gyroscopic, 0, m, a * m, m), Q); // m × k
    set_part(result.gyroscopic, 0, a * k, multiply_transposed(Q, turned));
    set_part(result.inertia_first, 0, a * k,
             multiply(part_of(integrals.inertia_first, 0, 3, a * m, m), Q));
    for (int b = 0; b < 3; ++b)
      set_part(
          result.inertia_second, a * k, b * k,
          multiply_transposed(
              Q, multiply(part_of(integrals.inertia_second, a * m, m, b * m, m), Q)));
  }
  result.stiffening = integrals.stiffening.project(Q);
  return result;
}

} // namespace flexgram
