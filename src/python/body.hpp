/// A body in memory as Python hands it over. Made by python/flexgram/call.py.

#pragma once

#include "run/body.hpp"

#include <pybind11/numpy.h>

#include <optional>

namespace flexgram {

namespace py = pybind11;

using Array = py::array_t<double, py::array::c_style | py::array::forcecast>;
using Rows = py::array_t<std::int64_t, py::array::c_style | py::array::forcecast>;

/// PETSc and SLEPc run, whoever started them.
void start();
MPI_Comm comm_of(std::intptr_t fortran);

/// CSR of this rank's rows, or petsc4py matrices as they are.
struct PythonBody {
  Body body;

  PythonBody(std::intptr_t comm_handle, const std::string& name);
  void set_petsc(const std::string& which, std::uintptr_t handle);
  void set_csr(const std::string& which, PetscInt first, PetscInt last, PetscInt n,
               const Rows& start_of, const Rows& column, const Array& value);
  void set_ports(const Array& B, const std::optional<Array>& C_transposed,
                 std::vector<std::string> inputs, std::vector<std::string> outputs);
  /// Of a term whose matrix `set_csr` or `set_petsc` take by that name.
  void set_law(const std::string& name, const std::string& kind,
               const LawNumbers& numbers);
  void set_damping(double alpha, double beta, double eta) {
    body.model.damping = {alpha, beta, eta};
  }
  void set_dofs(const Rows& node, const Rows& label, const std::optional<Rows>& component,
                const std::optional<Array>& position);

private:
  std::map<std::string, Law> laws;
  void set(const std::string& which, Matrix matrix);
};

} // namespace flexgram
