#pragma once

#include "base/plan.hpp"
#include "model/reduced_io.hpp"
#include "reduce/gramian_basis.hpp"

namespace flexgram {

/// Options of the paper's route beyond those of the Gramian.
struct PodOptions {
  int validate = 8;

  void describe(Options& options);
  void check() const;
};

/// Reduction by POD of frequency samples (Fehr, Eberhard, Lehner, section 2.1 and figure
/// 2): samples of the response to all inputs over the band, weighted by a quadrature
/// rule; their dominant left singular vectors span V; Galerkin projection. The error is
/// estimated at the samples and at frequencies between them, not proved.
/// @param[in] rigid_modes  of the full body, for the report on the reduced one.
/// @note Collective. One factorisation a sample and one a check frequency.
ReducedModel reduce_pod(const SecondOrderModel& fom, FrequencySolves& solves,
                        const GramianOptions& gramian, const PodOptions& pod,
                        int rigid_modes, Plan& plan, Monitor& monitor);

/// Both ends of the band, where the error often is largest, and `count` frequencies
/// half-way between neighbouring samples, spread over the band. None is a sample; none
/// for count 0.
std::vector<double> check_frequencies(const std::vector<double>& samples, int count,
                                      double first, double last);

} // namespace flexgram
