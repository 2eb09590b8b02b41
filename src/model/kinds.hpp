#pragma once

#include "base/observer.hpp"
#include "model/second_order_model.hpp"

namespace flexgram {

/// Says the largest relative errors of displacements from forces, of rotations from moments
/// and so on, and warns if one is much larger than the overall error of eq. (17), which
/// adds m/N and rad/(N m): the larger number hides the other.
void warn_of_kinds(const SecondOrderModel& names, const std::vector<ComplexDense>& H,
                   const std::vector<ComplexDense>& H_r, double overall,
                   Observer& observer);

/// "6 rigid, up to 0.1 Hz, elastic from 97.3 Hz"; modes in rad/s, ascending.
std::string describe_modes(const std::vector<double>& modes, int rigid);

} // namespace flexgram
