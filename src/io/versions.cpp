#include "io/versions.hpp"

#include "base/blas.hpp"
#include "base/process.hpp"
#include "base/text.hpp"
#include "io/hdf5_file.hpp"
#include "linalg/mumps.hpp"

#include <mpi.h>
#include <slepcversion.h>

namespace flexgram {

std::vector<std::pair<std::string, std::string>> versions() {
  char library[MPI_MAX_LIBRARY_VERSION_STRING] = "";
  int length = 0;
  MPI_Get_library_version(library, &length);
  const std::string mpi = library;
  return {{"flexgram", FLEXGRAM_VERSION},
          {"PETSc", text("%d.%d.%d", PETSC_VERSION_MAJOR, PETSC_VERSION_MINOR,
                         PETSC_VERSION_SUBMINOR)},
          {"SLEPc", text("%d.%d.%d", SLEPC_VERSION_MAJOR, SLEPC_VERSION_MINOR,
                         SLEPC_VERSION_SUBMINOR)},
          {"MUMPS", mumps_version()},
          {"MPI", mpi.substr(0, mpi.find_first_of(",\n"))},
          {"HDF5", hdf5_version()},
          {"BLAS", blas_version()}};
}

} // namespace flexgram
