#include "fem/loads.hpp"

#include "base/index.hpp"
#include "fem/vectors.hpp"

#include <algorithm>

namespace flexgram {
namespace {

Vector3 unit(int axis) {
  Vector3 e{};
  e[as_size(axis)] = 1;
  return e;
}

/// The acceleration at x for a unit of the column's input.
Vector3 acceleration(const AccelerationField& field, int axis, const Vector3& x) {
  if (field.type == AccelerationField::Type::uniform)
    return field.vector.value_or(unit(axis));
  Vector3 arm;
  for (std::size_t i = 0; i < 3; ++i) arm[i] = x[i] - field.point[i];
  if (field.type == AccelerationField::Type::angular) return cross(unit(axis), arm);
  const Vector3 inward = cross(field.axis, cross(field.axis, arm));
  return {-inward[0], -inward[1], -inward[2]};
}

const char* letters_of(AccelerationField::Type type) {
  return type == AccelerationField::Type::uniform   ? "a"
         : type == AccelerationField::Type::angular ? "alpha"
                                                    : "spin";
}

template <class Load>
std::vector<std::string> names_of(const std::vector<Load>& loads) {
  std::vector<std::string> names;
  for (const Load& load : loads)
    for (auto& name : input_names(load)) names.push_back(std::move(name));
  return names;
}

} // namespace

std::vector<std::string> input_names(const AccelerationField& field) {
  const std::string stem = field.name + "." + letters_of(field.type);
  if (field.type == AccelerationField::Type::spin) return {stem};
  if (field.vector) return {field.name + ".load"};
  return {stem + "x", stem + "y", stem + "z"};
}

std::vector<std::string> input_names(const NodalVectors& load) {
  std::vector<std::string> names;
  for (const auto& column : load.columns) names.push_back(load.name + "." + column);
  return names;
}

Dense weight_of_element(const AccelerationField& field, int number,
                        const std::vector<Vector3>& x, int dofs,
                        const ElementMatrices& element) {
  Dense a(element.M.rows, 1);
  for (std::size_t k = 0; k < x.size(); ++k) {
    const Vector3 there = acceleration(field, number, x[k]);
    const int first = static_cast<int>(k) * dofs;
    for (int c = 0; c < 3; ++c) a(first + c, 0) = there[as_size(c)];
    if (dofs == 6 && field.type == AccelerationField::Type::angular)
      a(first + 3 + number, 0) = 1;
  }
  Dense f = multiply(element.M, a);
  if (field.type != AccelerationField::Type::spin || element.beside.data.empty())
    return f;
  Dense A(9, 1); // away from the axis: I − e eᵀ
  for (std::size_t i = 0; i < 3; ++i)
    for (std::size_t j = 0; j < 3; ++j)
      A.data[3 * i + j] = (i == j ? 1.0 : 0.0) - field.axis[i] * field.axis[j];
  add_to(f, multiply(element.beside, A));
  return f;
}

NodalSums::NodalSums(MPI_Comm comm, const DofMap& map, const LocalMesh& mesh,
                     std::vector<std::string> names, HeldForces held)
    : comm_(comm), map_(map), mesh_(mesh), names_(std::move(names)),
      held_(std::move(held)) {
  for (std::size_t j = 0; j < names_.size(); ++j) {
    sums_.emplace_back();
    FG_CALL(VecCreateMPI(comm, map.rows.size(), map.n, sums_.back().out()));
    FG_CALL(VecSetOption(sums_.back(), VEC_IGNORE_NEGATIVE_INDICES, PETSC_TRUE));
  }
}

void NodalSums::add(int column, std::int64_t node, const Vector3& force,
                    const Vector3& moment) {
  const double values[6]{force[0], force[1], force[2], moment[0], moment[1], moment[2]};
  std::vector<PetscInt> rows; // −1: held, or no such dof
  std::vector<double> entries;
  const auto add_to = [&](std::int64_t master, int c, double value) {
    rows.push_back(map_.equation(master, c));
    entries.push_back(value);
    if (held_ && map_.is_held(master, c))
      held_(names_[as_size(column)], master, c, value);
  };
  const auto position = [&](std::int64_t at) {
    return mesh_.coordinates[mesh_.place(at)];
  };
  for (int c = 0; c < 6; ++c)
    if (map_.moves_alone(node))
      add_to(node, c, values[c]);
    else if (values[c] != 0)
      for (const Share& share : map_.shares(node, c, position))
        add_to(share.node, share.component, share.factor * values[c]);
  FG_CALL(VecSetValues(sums_[as_size(column)], static_cast<PetscInt>(rows.size()),
                       rows.data(), entries.data(), ADD_VALUES));
}

Ports NodalSums::take() {
  Ports ports{Block(comm_, map_.rows, map_.n, static_cast<PetscInt>(names_.size())),
              names_};
  for (std::size_t j = 0; j < sums_.size(); ++j) {
    FG_CALL(VecAssemblyBegin(sums_[j]));
    FG_CALL(VecAssemblyEnd(sums_[j]));
    const double* sum = nullptr;
    FG_CALL(VecGetArrayRead(sums_[j], &sum));
    Block::Access out(ports.B);
    std::copy_n(sum, map_.rows.size(), out.column(static_cast<PetscInt>(j)));
    FG_CALL(VecRestoreArrayRead(sums_[j], &sum));
  }
  return ports;
}

FieldLoads::FieldLoads(MPI_Comm comm, const BodyDescription& body, const DofMap& map,
                       const LocalMesh& mesh, HeldForces held)
    : sums_(comm, map, mesh, names_of(body.fields), std::move(held)) {
  for (const auto& field : body.fields)
    for (int axis = 0; axis < static_cast<int>(input_names(field).size()); ++axis)
      columns_.push_back({&field, axis});
}

void FieldLoads::add_element(const std::int64_t* nodes, const std::vector<Vector3>& x,
                             int dofs, const ElementMatrices& element) {
  for (std::size_t j = 0; j < columns_.size(); ++j) {
    const auto& [field, axis] = columns_[j];
    const Dense f = weight_of_element(*field, axis, x, dofs, element);
    for (std::size_t k = 0; k < x.size(); ++k) {
      const double* at = f.column(0) + static_cast<std::ptrdiff_t>(k) * dofs;
      const Vector3 moment = dofs == 6 ? Vector3{at[3], at[4], at[5]} : Vector3{};
      sums_.add(static_cast<int>(j), nodes[k], {at[0], at[1], at[2]}, moment);
    }
  }
}

Ports nodal_ports(MPI_Comm comm, const std::vector<NodalVectors>& all, const DofMap& map,
                  const LocalMesh& mesh, const Partition& partition, HeldForces held) {
  NodalSums sums(comm, map, mesh, names_of(all), std::move(held));
  const int rank = comm_rank(comm);
  int first = 0;
  for (const auto& vectors : all) {
    const std::size_t count = vectors.columns.size();
    for (std::size_t k = 0; k < vectors.nodes.size(); ++k) {
      const auto node = vectors.nodes[k];
      if (partition.node_owner[as_size(node)] != rank) continue;
      for (std::size_t j = 0; j < count; ++j) {
        const auto* at = vectors.values.data() + (k * count + j) * vectors.components;
        Vector3 moment{};
        if (vectors.components == 6) moment = {at[3], at[4], at[5]};
        sums.add(first + static_cast<int>(j), node, {at[0], at[1], at[2]}, moment);
      }
    }
    first += static_cast<int>(count);
  }
  return sums.take();
}

} // namespace flexgram
