#include "fem/reactions.hpp"

#include "base/index.hpp"
#include "base/text.hpp"
#include "linalg/sparse_product.hpp"

#include <algorithm>
#include <cmath>

namespace flexgram {
namespace {

constexpr const char* component_names[6] = {"rx", "ry", "rz", "rmx", "rmy", "rmz"};

std::vector<std::string> names_of(const std::vector<Reaction>& reactions) {
  std::vector<std::string> names;
  for (const auto& reaction : reactions)
    for (int axis : reaction.axes)
      names.push_back(reaction.name + "." + component_names[axis]);
  return names;
}

/// −M⁻¹ X, by conjugate gradients: with its diagonal for preconditioner a mass matrix of
/// finite elements needs some tens of steps, whatever the mesh.
Block solve_mass(Mat M, const Block& X, const std::vector<std::string>& names) {
  Block psi = copy(X);
  Handle<KSP> ksp;
  FG_CALL(KSPCreate(X.comm(), ksp.out()));
  FG_CALL(KSPSetOperators(ksp, M, M));
  FG_CALL(KSPSetType(ksp, KSPCG));
  PC pc = nullptr;
  FG_CALL(KSPGetPC(ksp, &pc));
  FG_CALL(PCSetType(pc, PCJACOBI));
  FG_CALL(KSPSetTolerances(ksp, 1e-13, 0, PETSC_DEFAULT, 1000));
  for (PetscInt j = 0; j < X.columns(); ++j) {
    Vec right = nullptr, solution = nullptr;
    FG_CALL(BVGetColumn(X.bv(), j, &right));
    FG_CALL(BVGetColumn(psi.bv(), j, &solution));
    FG_CALL(KSPSolve(ksp, right, solution));
    FG_CALL(VecScale(solution, -1));
    FG_CALL(BVRestoreColumn(psi.bv(), j, &solution));
    FG_CALL(BVRestoreColumn(X.bv(), j, &right));
    KSPConvergedReason reason;
    FG_CALL(KSPGetConvergedReason(ksp, &reason));
    if (reason < 0)
      throw Error(text("output %s: conjugate gradients for the support's share of the "
                       "mass did not converge (PETSc reason %d)",
                       names[as_size(j)].c_str(), static_cast<int>(reason)));
  }
  return psi;
}

/// Euclidean norms of the columns, on every rank.
std::vector<double> column_norms(const Block& x) {
  std::vector<double> norms(as_size(x.columns()));
  for (PetscInt j = 0; j < x.columns(); ++j)
    FG_CALL(BVNormColumn(x.bv(), j, NORM_2, &norms[as_size(j)]));
  return norms;
}

} // namespace

Reactions::Reactions(MPI_Comm comm, const BodyDescription& body, const DofMap& map,
                     const LocalMesh& mesh)
    : comm_(comm), map_(map), mesh_(mesh),
      stiffness_(comm, map, mesh, names_of(body.reactions)),
      mass_(comm, map, mesh, names_of(body.reactions)) {
  for (const auto& reaction : body.reactions)
    for (int axis : reaction.axes) columns_.push_back({&reaction, axis});
}

double Reactions::motion(const Column& column, std::int64_t node, int c) const {
  const Reaction& reaction = *column.reaction;
  if (!map_.is_held(node, c) ||
      !std::binary_search(reaction.nodes.begin(), reaction.nodes.end(), node))
    return 0;
  if (c >= 3 || column.axis < 3) return c == column.axis ? 1 : 0;
  Vector3 arm = mesh_.coordinates[mesh_.place(node)];
  for (std::size_t i = 0; i < 3; ++i) arm[i] -= reaction.point[i];
  return rigid_motion(arm)(c, column.axis);
}

double Reactions::followed(const Column& column, std::int64_t node, int c) const {
  if (!(map_.dependent[as_size(node)] >> c & 1)) return motion(column, node, c);
  double sum = 0;
  for (const Share& share : map_.constraints.of(node, c))
    sum += share.factor * motion(column, share.node, share.component);
  return sum;
}

void Reactions::add_element(const std::int64_t* nodes, const std::vector<Vector3>& x,
                            int dofs, const Dense& K, const Dense& M) {
  const bool held = std::any_of(nodes, nodes + x.size(), [&](std::int64_t node) {
    return map_.held[as_size(node)] != 0 || map_.dependent[as_size(node)] != 0;
  });
  if (!held) return;
  for (std::size_t j = 0; j < columns_.size(); ++j) {
    Dense w(M.rows, 1);
    bool moves = false;
    for (std::size_t k = 0; k < x.size(); ++k)
      for (int c = 0; c < dofs; ++c) {
        const double value = followed(columns_[j], nodes[k], c);
        w(static_cast<int>(k) * dofs + c, 0) = value;
        moves = moves || value != 0;
      }
    if (!moves) continue;
    const auto add = [&](const Dense& a, NodalSums& sums) {
      const Dense f = multiply(a, w);
      for (std::size_t k = 0; k < x.size(); ++k) {
        const double* at = f.column(0) + static_cast<std::ptrdiff_t>(k) * dofs;
        const Vector3 moment = dofs == 6 ? Vector3{at[3], at[4], at[5]} : Vector3{};
        sums.add(static_cast<int>(j), nodes[k], {at[0], at[1], at[2]}, moment);
      }
    };
    add(K, stiffness_);
    add(M, mass_);
  }
}

HeldForces Reactions::held_forces() {
  if (!any()) return {};
  return [this](const std::string& input, std::int64_t node, int c, double value) {
    auto& sums = held_[input];
    sums.resize(columns_.size());
    for (std::size_t j = 0; j < columns_.size(); ++j)
      sums[j] += motion(columns_[j], node, c) * value;
  };
}

Ports Reactions::take(Mat K, Mat M, const Block& B,
                      const std::vector<std::string>& inputs, Feedthrough& direct) {
  Ports ports = stiffness_.take();
  if (!any()) return ports;
  const Block psi = solve_mass(M, mass_.take().B, ports.names);
  add_product(ports.B, 1.0, multiply(K, psi),
              identity(static_cast<int>(columns_.size())));
  // ψ dies off: what is left of it at a distant load is the solver's rounding.
  const Dense works = inner(psi, B);
  const auto lengths = column_norms(psi), forces = column_norms(B);
  for (int i = 0; i < static_cast<int>(inputs.size()); ++i) {
    auto held = held_[inputs[as_size(i)]];
    held.resize(columns_.size());
    FG_CALL(MPI_Allreduce(MPI_IN_PLACE, held.data(), static_cast<int>(held.size()),
                          MPI_DOUBLE, MPI_SUM, comm_));
    for (int j = 0; j < works.rows; ++j) {
      const auto a = as_size(j), b = as_size(i);
      const double work =
          std::abs(works(j, i)) > 1e-12 * lengths[a] * forces[b] ? works(j, i) : 0.0;
      if (work + held[a] == 0) continue;
      direct.outputs.push_back(ports.names[a]);
      direct.inputs.push_back(inputs[b]);
      direct.values.push_back(-work - held[a]);
    }
  }
  return ports;
}

} // namespace flexgram
