#pragma once

#include "base/observer.hpp"
#include "base/options.hpp"
#include "io/hdf5_file.hpp"
#include "model/reduced_model.hpp"

namespace flexgram {

/// Stores the resolved options as attributes of /log/options. Collective.
void write_options(Hdf5File& file, const Options& options);

/// Writes the reduced file (see docs/files.md), with the dof map of the full
/// body for the rows of V. Collective on rom.V.comm().
void write_reduced(const ReducedModel& rom, const Options& options,
                   const Observer& observer, const SecondOrderModel& fom,
                   const std::string& path);

/// Reads M, D, K, B, C of a reduced file, whole on every rank. Collective on comm.
SecondOrderModel read_reduced(MPI_Comm comm, const std::string& path);

} // namespace flexgram
