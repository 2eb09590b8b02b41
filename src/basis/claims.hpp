/// Claims of a small body that all ranks share.

#pragma once

#include "medium/error_over_box.hpp"
#include "model/reduced_model.hpp"

#include <vector>

namespace flexgram {

/// Rank 0's: the last bit may differ between ranks, and with it how often intervals were
/// halved; the file and the exit status must not.
/// @note Collective.
ErrorOverBox::Supremum of_first_rank(MPI_Comm comm, ErrorOverBox::Supremum sup);

/// The error of the whole field in the norm of the strain energy, of each kind of inputs.
/// @note Collective.
std::vector<FieldClaim> field_claims(MPI_Comm comm, MediumOverBand& seen, const Dense& Q,
                                     const DenseSystem& small,
                                     const std::vector<Interval>& excluded);

} // namespace flexgram
