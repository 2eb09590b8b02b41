/// What outputs hold beside Cᵀq, in body files and reduced files: /feedthrough (n_out × n_in),
/// /output_beta and /output_eta (n_out). Each is left out where it is zero.

#pragma once

#include "io/hdf5_file.hpp"
#include "model/second_order_model.hpp"

namespace flexgram {

void write_output_form(Hdf5File& file, const SecondOrderModel& model);

/// @pre the model's ports are known. @throws Error for wrong shapes, NaN, Inf and
/// negative damping. Rank-local.
void read_output_form(const Hdf5File& file, SecondOrderModel& model);

} // namespace flexgram
