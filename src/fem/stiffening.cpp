#include "fem/stiffening.hpp"

#include "base/index.hpp"
#include "base/process.hpp"
#include "base/text.hpp"
#include "fem/element_of.hpp"
#include "fem/node_matrix.hpp"
#include "linalg/decompositions.hpp"
#include "linalg/sparse.hpp"
#include "model/port_views.hpp"
#include "model/rigid_body_modes.hpp"

#include <algorithm>
#include <cmath>

namespace flexgram {
namespace {

constexpr int frame_loads_count = 12;
/// Matrices that are held at a time.
constexpr int batch = 4;

std::vector<std::string> frame_load_names() {
  std::vector<std::string> names;
  for (const char* what : {"ax", "ay", "az", "alphax", "alphay", "alphaz", "spinxx",
                           "spinyy", "spinzz", "spinxy", "spinyz", "spinzx"})
    names.push_back(std::string("frame.") + what);
  return names;
}

/// Fields of acceleration whose combinations are the frame's loads.
std::vector<AccelerationField> frame_fields() {
  using Type = AccelerationField::Type;
  std::vector<AccelerationField> fields{{"uniform", Type::uniform, {}, {}},
                                        {"angular", Type::angular, {}, {}}};
  const double half = std::sqrt(0.5);
  for (const Vector3& axis :
       {Vector3{1, 0, 0}, Vector3{0, 1, 0}, Vector3{0, 0, 1}, Vector3{half, half, 0},
        Vector3{0, half, half}, Vector3{half, 0, half}})
    fields.push_back({"spin", Type::spin, {}, axis});
  return fields;
}

/// Frame loads by the fields: −M a of an acceleration a; a spin about (e_x + e_y)/√2 has
/// ω_x² = ω_y² = ω_xω_y = 1/2.
Dense shares_of_fields() {
  Dense shares(frame_loads_count, frame_loads_count);
  for (int k = 0; k < 6; ++k) shares(k, k) = -1;
  for (int k = 6; k < 9; ++k) shares(k, k) = 1;
  for (int k = 0; k < 3; ++k) {
    shares(9 + k, 9 + k) = 2;
    shares(6 + k, 9 + k) = shares(6 + (k + 1) % 3, 9 + k) = -1;
  }
  return shares;
}

/// Six rows of rigid motions R (n × 6) that hold the body: those that are largest after those
/// before them, on the rank that has them. Collective.
std::vector<PetscInt> holding_rows(const Block& R) {
  const MPI_Comm comm = R.comm();
  const RowRange mine = R.local_rows();
  std::vector<std::array<double, 6>> rows(as_size(mine.size()));
  {
    const Block::Access all(R);
    for (std::size_t i = 0; i < rows.size(); ++i)
      for (int j = 0; j < 6; ++j)
        rows[i][as_size(j)] = all.column(j)[static_cast<std::ptrdiff_t>(i)];
  }
  std::vector<PetscInt> chosen;
  for (int k = 0; k < 6; ++k) {
    double best = -1;
    std::size_t at = 0;
    for (std::size_t i = 0; i < rows.size(); ++i) {
      double square = 0;
      for (const double x : rows[i]) square += x * x;
      if (square > best) {
        best = square;
        at = i;
      }
    }
    struct {
      double value;
      int rank;
    } found{best, comm_rank(comm)}, largest{};
    MPI_Allreduce(&found, &largest, 1, MPI_DOUBLE_INT, MPI_MAXLOC, comm);
    std::array<double, 6> q{};
    if (largest.rank == found.rank) {
      q = rows[at];
      chosen.push_back(mine.begin + static_cast<PetscInt>(at));
    }
    MPI_Bcast(q.data(), 6, MPI_DOUBLE, largest.rank, comm);
    for (double& x : q) x /= std::sqrt(largest.value);
    for (auto& row : rows) {
      double along = 0;
      for (std::size_t j = 0; j < 6; ++j) along += row[j] * q[j];
      for (std::size_t j = 0; j < 6; ++j) row[j] -= along * q[j];
    }
  }
  return chosen;
}

/// Springs as stiff as K at these rows. Collective.
Matrix springs(Mat K, const SecondOrderModel& model, std::vector<PetscInt> at) {
  const std::vector<double> diagonal_of_K = diagonal(K);
  std::sort(at.begin(), at.end());
  LocalRows local;
  for (PetscInt row = model.rows.begin; row < model.rows.end; ++row) {
    if (std::binary_search(at.begin(), at.end(), row)) {
      local.column.push_back(row);
      local.value.push_back(diagonal_of_K[as_size(row - model.rows.begin)]);
    }
    local.start.push_back(static_cast<PetscInt>(local.column.size()));
  }
  return make_sparse(model.comm, model.rows, model.n, local);
}

/// Columns of the first interface with six ports. @throws Error if none has six.
std::vector<int> six_ports(const std::vector<std::string>& names) {
  for (const auto& [name, ports] : interfaces_of(names))
    if (ports.size() == 6) return ports;
  throw Error("{stiffening}: a free body is held at an interface with six ports, and "
              "this one has none");
}

/// Balances loads F by the ports P: F − P (RᵀP)⁻¹ RᵀF.
Block balanced(const Block& F, const Block& P, const Block& R) {
  const ComplexDense shares = solve(as_complex(inner(R, P)), as_complex(inner(R, F)));
  Dense of_ports(6, shares.columns);
  for (std::size_t i = 0; i < shares.data.size(); ++i)
    of_ports.data[i] = shares.data[i].real();
  Block result = concatenate(F, {});
  add_product(result, -1, P, of_ports);
  return result;
}

} // namespace

MeshStiffening::MeshStiffening(BodyDescription body, DofMap map, LocalMesh mesh,
                               const SecondOrderModel& model,
                               const SolverOptions& options, Observer& observer)
    : body_(std::move(body)), map_(std::move(map)), mesh_(std::move(mesh)),
      names_(frame_load_names()), shares_(shares_of_fields()) {
  Stage stage(observer, "stiffening");
  body_.fields = frame_fields();
  Ports interfaces = interface_ports(
      model.comm, body_, map_,
      [&](std::int64_t node) { return mesh_.coordinates[mesh_.place(node)]; }, {});
  const Block rigid = rigid_body_modes(model);
  const auto motions = rigid ? rigid.columns() : 0;
  if (motions != 0 && motions != 6)
    throw Error(
        text("{stiffening}: the body has %d free motions of six; a floating frame "
             "takes a free body, or one that its supports hold",
             static_cast<int>(motions)));
  Block loads = frame_loads(model.comm), P;
  std::vector<int> held, others;
  if (motions == 6) {
    held = six_ports(interfaces.names);
    P = select_columns(interfaces.B, held);
    for (int j : held) held_.push_back(interfaces.names[as_size(j)]);
  }
  for (int j = 0; j < static_cast<int>(interfaces.names.size()); ++j)
    if (std::find(held.begin(), held.end(), j) == held.end()) {
      others.push_back(j);
      names_.push_back(interfaces.names[as_size(j)]);
    }
  if (!others.empty()) loads = concatenate(loads, select_columns(interfaces.B, others));
  std::vector<Matrix> held_by;
  std::vector<Mat> added;
  ShiftCoefficients coefficients{1.0, 0.0};
  if (motions == 6) {
    resultants_ = beside(inner(rigid, loads), inner(rigid, P));
    loads = balanced(loads, P, rigid);
    held_by.push_back(springs(model.K, model, holding_rows(rigid)));
    added.push_back(held_by.front());
    coefficients.terms.emplace_back(1.0);
  }
  ShiftedSolver solver(model.K, nullptr, added, model.node, options);
  try {
    solver.factorise(coefficients, Definiteness::positive);
    u_ = solver.solve(loads).x;
  } catch (const ShiftError&) {
    throw Error("{stiffening}: a part of the body moves freely: K is singular");
  }
  observer.fact("stiffening",
                text("by the stress under %zu unit loads, %d of the frame's motion and "
                     "%zu at interfaces; %s",
                     names_.size(), frame_loads_count, others.size(),
                     motions == 6 ? "balanced at an interface" : "held by its supports"));
}

Block MeshStiffening::frame_loads(MPI_Comm comm) {
  FieldLoads fields(comm, body_, map_, mesh_, {});
  Followers(map_, mesh_).for_each([&](const PlacedElement& at) {
    fields.add_element(at.nodes, at.x, dofs_per_node(at.block().type),
                       element_matrices(body_, at, !at.rigid));
  });
  return combine(fields.take().B, shares_);
}

Dense MeshStiffening::weight(int load, const PlacedElement& at,
                             const ElementMatrices& element) const {
  Dense forces(element.M.rows, 1);
  if (load >= frame_loads_count) return forces;
  int input = 0;
  for (const AccelerationField& field : body_.fields)
    for (int k = 0; k < static_cast<int>(input_names(field).size()); ++k, ++input)
      if (shares_(input, load) != 0)
        add_to(forces,
               weight_of_element(field, k, at.x, dofs_per_node(at.block().type), element),
               shares_(input, load));
  return forces;
}

std::vector<Matrix> MeshStiffening::matrices(int first, int count,
                                             const Followers& followers) const {
  std::vector<std::vector<double>> u;
  for (int l = 0; l < count; ++l) {
    const Block::Access local(u_);
    u.push_back(gathered<double>(
        u_.comm(), {local.column(first + l), as_size(u_.local_rows().size())}));
  }
  NodeMatrix sum(map_, followers.start(), followers.nodes(), as_size(count));
  followers.for_each([&](const PlacedElement& at) {
    const Dense T = followers.transformation(at);
    ElementMatrices element; // for the forces at slaves
    if (!T.data.empty()) element = element_matrices(body_, at, !at.rigid);
    std::vector<ElementPart> parts;
    for (int l = 0; l < count; ++l) {
      Dense added, moved;
      if (!at.rigid) {
        moved = followers.displacement(at, T, [&](std::int64_t node, int c) {
          const PetscInt equation = map_.equation(node, c);
          return equation < 0 ? 0.0 : u[as_size(l)][as_size(equation)];
        });
        added = geometric_stiffness(body_, at, moved.data);
      }
      if (!T.data.empty()) {
        Dense forces = weight(first + l, at, element);
        for (double& f : forces.data) f = -f;
        if (!at.rigid) add_to(forces, multiply(element.K, moved));
        const Dense turning = followers.turning(at, forces);
        added = at.rigid ? Dense(T.columns, T.columns)
                         : multiply_transposed(T, multiply(added, T));
        if (!turning.data.empty()) add_to(added, turning);
      }
      parts.push_back({as_size(l), std::move(added)});
    }
    sum.add(at.masters, at.master_count, {}, {}, parts);
  });
  Matrix no_K, no_M;
  return sum.assemble(u_.comm(), no_K, no_M);
}

LoadMatrices MeshStiffening::project(const Basis& V) const {
  LoadMatrices result{names_, {}, held_, resultants_};
  const Followers followers(map_, mesh_);
  const int loads = static_cast<int>(names_.size());
  for (int first = 0; first < loads; first += batch) {
    stop_if_interrupted();
    for (const Matrix& K : matrices(first, std::min(batch, loads - first), followers))
      result.matrices.push_back(symmetric_inner(V, K));
  }
  return result;
}

} // namespace flexgram
