#pragma once

#include "model/second_order_model.hpp"

namespace flexgram {

/// Galerkin projection of the full model on V: K_r = VᵀKV, M_r, D_r = αM_r + βK_r + VᵀDV,
/// B_r = VᵀB, C_r = VᵀC; symmetric to the last bit. Structural damping stays a factor of
/// K_r.
/// @return dense model, whole on every rank. Collective on fom.comm.
SecondOrderModel project(const SecondOrderModel& fom, const Block& V);

/// Undamped eigenfrequencies of a dense model [rad/s], ascending; zero for rigid modes.
/// Empty if its M is not positive definite.
std::vector<double> eigenfrequencies(const SecondOrderModel& dense);

/// Smallest eigenvalue of a dense symmetric matrix over its largest.
double relative_smallest_eigenvalue(Mat dense);

/// ε = ‖H − H_r‖_F / ‖H‖_F, eq. (17) of the paper.
double relative_error(const ComplexDense& h, const ComplexDense& h_r);

} // namespace flexgram
