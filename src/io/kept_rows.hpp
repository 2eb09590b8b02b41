#pragma once

#include "io/hdf5_file.hpp"
#include "linalg/basis.hpp"
#include "model/second_order_model.hpp"

namespace flexgram {

/// A tall basis, and back as one block with these rows. Collective.
void write_basis(Hdf5File& file, const std::string& name, const Basis& V, PetscInt n,
                 RowRange rows);
Block read_basis(const Hdf5File& file, const std::string& name, PetscInt n,
                 RowRange rows);

// ---- what a run kept for itself or for another one on other ranks

/// Size, ports, damping and norms of the body, into /identity; whatever the order of its
/// rows. Collective.
void write_identity(Hdf5File& file, const SecondOrderModel& body);
/// @throws Error naming the difference if the file is of another body. Collective.
void expect_identity(const Hdf5File& file, const SecondOrderModel& body);
/// Rows as the body has them here: one assembled on another number of ranks has them in
/// another order, and the dof map in the file tells which. @throws Error if it has not
/// the nodes of this body. Collective.
Block read_rows(const Hdf5File& file, const std::string& name,
                const SecondOrderModel& body);

} // namespace flexgram
