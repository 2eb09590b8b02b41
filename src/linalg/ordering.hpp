#pragma once

#include "linalg/mumps.hpp"

#include <petscmat.h>

#include <cstdint>
#include <span>
#include <vector>

namespace flexgram {

/// Groups rows whose columns are the same in all given matrices (null ones are skipped):
/// the dofs of one node, in most bodies. Used where no dof map is known.
/// @return a group number for each local row. Collective.
std::vector<std::int64_t> indistinguishable_rows(const std::vector<Mat>& matrices);

/// METIS nested dissection of the graph of nodes (rows with the same node number
/// together), weighted by the dofs of each node.
/// @param[in] lower         lower triangle, entries distributed.
/// @param[in] node_of_row   node number of each local row, any numbers.
/// @return with the nodes as blocks where their rows have nearly the same columns.
/// Collective on comm; the node graph is gathered on rank 0.
PivotOrder nested_dissection(MPI_Comm comm, const Pattern& lower,
                             std::span<const std::int64_t> node_of_row);

} // namespace flexgram
