#include "python/body.hpp"

#include "base/index.hpp"
#include "base/parallel.hpp"
#include "base/text.hpp"
#include "io/body_io.hpp"
#include "linalg/sparse.hpp"

#include <slepcsys.h>

#include <cmath>
#include <csignal>

namespace flexgram {

void start() {
  PetscBool running = PETSC_FALSE;
  SlepcInitialized(&running);
  if (running) return;
  if (SlepcInitializeNoArguments())
    throw Error("PETSc or SLEPc did not start; see the message above");
  std::signal(SIGPIPE, SIG_IGN); // as Python has it: its own error tells of a closed pipe
}

MPI_Comm comm_of(std::intptr_t fortran) {
  return MPI_Comm_f2c(static_cast<MPI_Fint>(fortran));
}

namespace {

Matrix borrowed(std::uintptr_t handle) {
  const auto mat = reinterpret_cast<Mat>(handle); // petsc4py's Mat.handle
  FG_CALL(PetscObjectReference(reinterpret_cast<PetscObject>(mat)));
  return Matrix::adopt(mat);
}

/// This rank's rows of a tall matrix, row-major from NumPy.
Block block_of(MPI_Comm comm, RowRange rows, PetscInt n, const Array& values,
               const char* name) {
  agree(comm, [&] {
    if (values.ndim() != 2 || values.shape(0) != rows.size())
      throw Error(
          text("%s: this rank has %lld rows of K, so it must give so many rows of %s",
               name, static_cast<long long>(rows.size()), name));
  });
  Block block(comm, rows, n, static_cast<PetscInt>(values.shape(1)));
  Block::Access access(block);
  for (PetscInt j = 0; j < block.columns(); ++j)
    for (PetscInt i = 0; i < rows.size(); ++i) access.column(j)[i] = values.at(i, j);
  return block;
}

} // namespace

PythonBody::PythonBody(std::intptr_t comm_handle, const std::string& name) {
  start();
  body.model.comm = comm_of(comm_handle);
  body.model.name = name;
}

void PythonBody::set_petsc(const std::string& which, std::uintptr_t handle) {
  set(which, borrowed(handle));
}

void PythonBody::set_csr(const std::string& which, PetscInt first, PetscInt last,
                         PetscInt n, const Rows& start_of, const Rows& column,
                         const Array& value) {
  LocalRows local;
  local.start.assign(start_of.data(), start_of.data() + start_of.size());
  local.column.assign(column.data(), column.data() + column.size());
  local.value.assign(value.data(), value.data() + value.size());
  agree(body.model.comm, [&] {
    for (std::size_t i = 0; i + 1 < local.start.size(); ++i)
      for (PetscInt k = local.start[i] + 1; k < local.start[i + 1]; ++k)
        if (local.column[as_size(k)] <= local.column[as_size(k) - 1])
          throw Error(text("%s: columns of a row must rise", which.c_str()));
  });
  set(which, make_sparse(body.model.comm, {first, last}, n, local));
}

void PythonBody::set_ports(const Array& B, const std::optional<Array>& C_transposed,
                           std::vector<std::string> inputs,
                           std::vector<std::string> outputs) {
  SecondOrderModel& m = body.model;
  m.B = block_of(m.comm, m.rows, m.n, B, "B");
  m.outputs_are_inputs = !C_transposed.has_value();
  m.C = C_transposed ? block_of(m.comm, m.rows, m.n, *C_transposed, "C") : m.B.share();
  m.inputs = std::move(inputs);
  m.outputs = std::move(outputs);
}

void PythonBody::set_dofs(const Rows& node, const Rows& label,
                          const std::optional<Rows>& component,
                          const std::optional<Array>& position) {
  SecondOrderModel& m = body.model;
  agree(m.comm, [&] {
    const auto rows = static_cast<py::ssize_t>(m.rows.size());
    if (node.size() != rows || label.size() != rows ||
        (component && component->size() != rows) ||
        (position && position->size() != 3 * rows))
      throw Error("node, component and position must fit the rows of this rank");
  });
  m.node.assign(node.data(), node.data() + node.size());
  m.label.assign(label.data(), label.data() + label.size());
  if (component)
    m.component.assign(component->data(), component->data() + component->size());
  if (position) m.position.assign(position->data(), position->data() + position->size());
}

void PythonBody::set(const std::string& which, Matrix matrix) {
  SecondOrderModel& m = body.model;
  const auto of_term = laws.find(which);
  const bool may_be_skew = which == "K" || which == "D" || which == "G" ||
                           (of_term != laws.end() && of_term->second.is_skew());
  if (!may_be_skew) take_symmetric_part(matrix, which, m.name, m.remarks);
  PetscReal norm = 0; // of row sums: squares of entries that are finite may overflow
  FG_CALL(MatNorm(matrix, NORM_INFINITY, &norm));
  if (!std::isfinite(norm)) throw Error(text("%s holds NaN or Inf", which.c_str()));
  if (which == "K") {
    FG_CALL(MatGetSize(matrix, &m.n, nullptr));
    m.rows = owned_rows(matrix);
    set_stiffness(m, std::move(matrix), m.name);
    return;
  }
  const RowRange rows = owned_rows(matrix);
  agree(m.comm, [&] {
    if (rows.begin != m.rows.begin || rows.end != m.rows.end)
      throw Error(text("%s is not split over the ranks like K", which.c_str()));
  });
  if (which == "M")
    m.M = std::move(matrix);
  else if (which == "D")
    add_damping(m, std::move(matrix), m.name);
  else if (which == "G")
    add_skew(m, Law::Kind::gyroscopic, std::move(matrix), m.name);
  else if (which == "S")
    m.terms.push_back({Law::Kind::structural, std::move(matrix)});
  else if (may_be_skew)
    add_skew(m, of_term->second, std::move(matrix), m.name);
  else
    m.terms.push_back({laws.at(which), std::move(matrix)});
}

void PythonBody::set_law(const std::string& name, const std::string& kind,
                         const LawNumbers& numbers) {
  agree(body.model.comm, [&] { laws.insert_or_assign(name, Law(name, kind, numbers)); });
}

} // namespace flexgram
