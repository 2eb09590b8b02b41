#pragma once

#include "base/observer.hpp"
#include "model/reduced_model.hpp"
#include "sampling/gramian_basis.hpp"

namespace flexgram {

/// Reduction by POD of frequency samples (Fehr, Eberhard, Lehner, section 2.1 and figure
/// 2): samples of the response to all inputs over the band, weighted by a quadrature
/// rule; their dominant left singular vectors span V; Galerkin projection. The error is
/// estimated at the samples and at frequencies between them, not proved.
/// @param[in] rigid_modes  of the full body, for the report on the reduced one.
/// @note Collective. One factorisation a sample and one a check frequency.
ReducedModel reduce_pod(const SecondOrderModel& fom, FrequencySolves& solves,
                        const SamplingSpec& spec, int rigid_modes, Observer& observer);

/// Both ends of the band, where the error often is largest, and `count` frequencies
/// half-way between neighbouring samples, spread over the band. None is a sample; none
/// for count 0.
std::vector<double> check_frequencies(const std::vector<double>& samples, int count,
                                      double first, double last);

} // namespace flexgram
