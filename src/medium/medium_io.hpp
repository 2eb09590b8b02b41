/// The file of a certified medium model (docs/files.md). Called by run/reduce
/// and the Python module; its parts by checkpoint.cpp.

#pragma once

#include "io/hdf5_file.hpp"
#include "medium/medium.hpp"

#include <map>
#include <string>

namespace flexgram {

/// Writes a certified medium model: all that `cut` needs, with the options and the plan
/// that made it (/log). @param basis  with V.
/// @note Collective on medium.body.comm.
void write_medium(const Medium& medium, bool basis,
                  const std::map<std::string, std::string>& options,
                  const std::vector<std::pair<std::string, std::string>>& plan,
                  const std::string& path);

/// @throws Error if the file is none, or not of this version, or its parts do not fit.
/// @note Collective. V is spread evenly over the ranks.
Medium read_medium(MPI_Comm comm, const std::string& path);

// ---- parts, for checkpoints

/// All but V and the frame; any number of levels.
void write_levels(Hdf5File& file, const Medium& medium);
/// What write_levels and write_medium wrote but V, the dof map and the layout of rows.
/// Rank-local. @throws Error for what does not fit.
void read_levels(const Hdf5File& file, Medium& medium);

} // namespace flexgram
