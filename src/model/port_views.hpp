#pragma once

#include "model/second_order_model.hpp"

namespace flexgram {

/// A block of H whose error is judged by itself: rows are outputs, columns inputs.
struct PortView {
  std::string name;
  std::vector<int> rows, columns;

  ComplexDense of(const ComplexDense& H) const;
};

/// What a port is, by the last part of its name without the direction: "f" of "lower.fx" is
/// a force as an input and a displacement as an output; "" where the name does not tell.
std::string kind_of_port(const std::string& name);

/// The whole of H and, if asked and the names tell kinds of ports apart, each kind of
/// output from each kind of input (rotations from moments alone). Eq. (17) of the paper
/// adds m/N and rad/(N m): the larger number hides the other.
std::vector<PortView> port_views(const SecondOrderModel& names, bool by_kind);

} // namespace flexgram
