/// The ports of a body as `certify` takes them: its inputs and outputs side by side.

#pragma once

#include "base/index.hpp"
#include "model/second_order_model.hpp"

#include <vector>

namespace flexgram {

/// All ports, inputs first.
struct PortLoads {
  Block all;                ///< [B, C], or B where what is driven is what is measured
  int inputs = 0;           ///< so many come first
  std::vector<int> same_as; ///< of each port the first one that is equal

  int count() const { return static_cast<int>(same_as.size()); }
  bool is_first(int j) const { return same_as[as_size(j)] == j; }
};

/// @note Collective.
PortLoads port_loads(const SecondOrderModel& fom);

/// The loads without what moves a free body rigidly: no part of the response to them is rigid.
/// A load of which nothing but rounding is left, such as gravity, becomes zero.
/// @param rigid  M-orthonormal. @note Collective.
Block self_equilibrated(const Block& loads, const Block& rigid, Mat M);

/// The response to the inputs alone, if outputs are many more: errors are products of what
/// is left of both, and the certificate asks for the directions of the outputs that matter.
/// @param response  to all ports, and to further loads after these, which stay.
Block without_many_outputs(Block response, const PortLoads& ports);

} // namespace flexgram
