/// Few loads instead of many ports. Called by run/loads.

#pragma once

#include "base/observer.hpp"
#include "model/reduced_model.hpp"

namespace flexgram {

/// The leading load patterns of a body's inputs: of all loads of unit size those that move
/// their own points of action most at low frequencies, eigenvectors of Bᵀ(K + τM)⁻¹B, by
/// two steps of a randomised subspace iteration (Halko, Martinsson, Tropp 2011, algorithm
/// 4.4). Forces and moments (ports named x.fx … x.mz) are of unit size where their mean
/// compliance is the same.
struct LeadingPatterns {
  Dense patterns;  ///< n_in × k, in the units of the inputs
  double held = 0; ///< share of the trace that the patterns hold, about
  double next = 0; ///< the largest compliance outside them over the largest, about
};
/// @param count  k, fewer where the inputs' responses have fewer dimensions.
/// @param tau    [rad²/s²] positive.
LeadingPatterns leading_patterns(const SecondOrderModel& body, int count, double tau,
                                 const SolverOptions& solver, Observer& observer);

/// The body whose inputs are these patterns of its own, its outputs too where they are the
/// inputs.
SecondOrderModel with_patterns(const SecondOrderModel& body, const LoadSpan& loads);

/// A reduced body of patterns with all ports of the body: VᵀB, CᵀV.
void restore_ports(ReducedModel& rom, const SecondOrderModel& body, LoadSpan loads);

} // namespace flexgram
