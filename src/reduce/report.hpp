#pragma once

#include "model/second_order_model.hpp"

namespace flexgram {

/// Largest relative error of the block from the ports of one kind to those of the same
/// kind, by the last part of the ports' names: 'f' forces, 'm' moments; −1 if there are
/// none. Eq. (17) adds m/N and rad/(N m): the larger number hides the other.
double error_of_kind(const SecondOrderModel& names, const std::vector<ComplexDense>& H,
                     const std::vector<ComplexDense>& H_r, char kind);

/// "6 rigid, up to 0.1 Hz, elastic from 97.3 Hz"; modes in rad/s, ascending.
std::string describe_modes(const std::vector<double>& modes, int rigid);

} // namespace flexgram
