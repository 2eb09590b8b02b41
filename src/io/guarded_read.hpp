/// Reads of HDF5 that trust what a damaged file says.

#pragma once

#include <mpi.h>

#include <functional>
#include <string>

namespace flexgram {

/// Runs a read of texts of variable length, which lie in a heap without checksums: on a damaged
/// file HDF5 may write anywhere and may loop for ever. If it does not come back within ten
/// seconds of work, or crashes, the program says `what` and ends.
/// @return what `read` does.
bool guarded(MPI_Comm comm, const std::string& what, const std::function<bool()>& read);

} // namespace flexgram
