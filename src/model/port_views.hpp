#pragma once

#include "model/second_order_model.hpp"
#include "model/spec.hpp"

namespace flexgram {

/// A block of H whose error is judged by itself: rows are outputs, columns inputs.
struct PortView {
  std::string name;
  std::vector<int> rows, columns;
  double allowed = 1; ///< it may err so many times the smallest tolerance

  ComplexDense of(const ComplexDense& H) const;
};

/// What a port is, by the last part of its name without the direction: "f" of "lower.fx" is
/// a force as an input and a displacement as an output; "" where the name does not tell.
std::string kind_of_port(const std::string& name);

/// Interfaces in the order of their first port, each with its forces and moments among the names.
std::vector<std::pair<std::string, std::vector<int>>>
interfaces_of(const std::vector<std::string>& names);

/// H as claims know it: stress is that of the whole strain, without what a temperature adds to
/// it at once. Where a body is free to grow both cancel, and an error relative to nothing is
/// none.
OutputForm claimed_outputs(const SecondOrderModel& names);

/// The whole of H and, if asked and the names tell kinds of ports apart, each kind of
/// output from each kind of input (rotations from moments alone). Eq. (17) of the paper
/// adds m/N and rad/(N m): the larger number hides the other. Where kinds have tolerances
/// of their own, all of H is judged by the largest.
/// @throws Error if a kind that has one is not there.
std::vector<PortView> port_views(const SecondOrderModel& names, const KindSpec& kinds);
/// Whether ports can be of this kind: "stress", "stress from force".
bool is_known_kind(const std::string& word);
/// Whether a word is outputs by their names instead: foot.ry, or foot.* for all of foot; one or
/// both with the kind of their inputs behind, "foot.ry from force".
bool names_ports(const std::string& word);

} // namespace flexgram
