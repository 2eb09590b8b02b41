/// What made a result: the versions of this program and of what it stands on. Written to
/// /log/versions of reduced files, printed by flexgram --version.

#pragma once

#include <string>
#include <utility>
#include <vector>

namespace flexgram {

/// By name: flexgram, PETSc, SLEPc, MUMPS, MPI, HDF5, BLAS.
std::vector<std::pair<std::string, std::string>> versions();

} // namespace flexgram
