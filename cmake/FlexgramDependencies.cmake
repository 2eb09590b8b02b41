# Real-scalar PETSc and SLEPc, MUMPS in all four arithmetics, METIS, parallel HDF5, MPI.
# PETSC_DIR / PETSC_ARCH / SLEPC_DIR of the environment win; without them Debian's real build.
find_package(PkgConfig REQUIRED)
find_package(MPI REQUIRED COMPONENTS C CXX)

foreach(kind PETSC SLEPC)
  string(TOLOWER ${kind} lower)
  if(DEFINED ENV{${kind}_DIR})
    list(APPEND flexgram_pc "$ENV{${kind}_DIR}/$ENV{PETSC_ARCH}/lib/pkgconfig"
         "$ENV{${kind}_DIR}/lib/pkgconfig")
  else()
    file(GLOB found "/usr/lib/${lower}dir/${lower}*/*-real/lib/pkgconfig")
    list(APPEND flexgram_pc ${found})
  endif()
endforeach()
list(JOIN flexgram_pc ":" flexgram_pc)
set(ENV{PKG_CONFIG_PATH} "${flexgram_pc}:$ENV{PKG_CONFIG_PATH}")
pkg_search_module(SLEPC REQUIRED IMPORTED_TARGET SLEPc slepc)
pkg_search_module(PETSC REQUIRED IMPORTED_TARGET PETSc petsc)

include(CheckCXXSourceCompiles)
set(CMAKE_REQUIRED_LIBRARIES PkgConfig::PETSC MPI::MPI_CXX)
check_cxx_source_compiles("
#include <petscsys.h>
#if defined(PETSC_USE_COMPLEX) || !defined(PETSC_USE_REAL_DOUBLE)
#error complex
#endif
int main() {}" FLEXGRAM_PETSC_IS_REAL)
unset(CMAKE_REQUIRED_LIBRARIES)
if(NOT FLEXGRAM_PETSC_IS_REAL)
  message(FATAL_ERROR "flexgram needs a PETSc with real double scalars "
          "(Debian: libpetsc-real-dev); found ${PETSC_PREFIX}")
endif()

pkg_search_module(HDF5 IMPORTED_TARGET hdf5-openmpi hdf5-mpich hdf5-mpi)
if(HDF5_FOUND)
  add_library(flexgram_hdf5 INTERFACE IMPORTED)
  target_link_libraries(flexgram_hdf5 INTERFACE PkgConfig::HDF5)
else()
  set(HDF5_PREFER_PARALLEL ON)
  find_package(HDF5 REQUIRED COMPONENTS C)
  if(NOT HDF5_IS_PARALLEL)
    message(FATAL_ERROR "flexgram needs a parallel HDF5")
  endif()
  add_library(flexgram_hdf5 INTERFACE IMPORTED)
  target_include_directories(flexgram_hdf5 INTERFACE ${HDF5_INCLUDE_DIRS})
  target_link_libraries(flexgram_hdf5 INTERFACE ${HDF5_LIBRARIES})
endif()

find_path(MUMPS_INCLUDE_DIR dmumps_c.h REQUIRED HINTS ENV MUMPS_DIR PATH_SUFFIXES include)
find_path(METIS_INCLUDE_DIR metis.h REQUIRED HINTS ENV METIS_DIR PATH_SUFFIXES include)
find_library(METIS_LIBRARY metis REQUIRED HINTS ENV METIS_DIR PATH_SUFFIXES lib)
add_library(flexgram_mumps INTERFACE IMPORTED)
target_include_directories(flexgram_mumps INTERFACE ${MUMPS_INCLUDE_DIR})
foreach(arithmetic s d c z)
  find_library(MUMPS_${arithmetic}_LIBRARY ${arithmetic}mumps REQUIRED HINTS ENV MUMPS_DIR
               PATH_SUFFIXES lib)
  target_link_libraries(flexgram_mumps INTERFACE ${MUMPS_${arithmetic}_LIBRARY})
endforeach()
add_library(flexgram_metis INTERFACE IMPORTED)
target_include_directories(flexgram_metis INTERFACE ${METIS_INCLUDE_DIR})
target_link_libraries(flexgram_metis INTERFACE ${METIS_LIBRARY})

find_library(BLAS_LIBRARY NAMES openblas blas REQUIRED)
find_library(LAPACK_LIBRARY NAMES openblas lapack REQUIRED)
