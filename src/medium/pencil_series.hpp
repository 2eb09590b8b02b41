/// The response of a dense system over an interval by its complex modes (docs/proof.md, section 4,
/// "Series"). Called by response_series.

#pragma once

#include "medium/response_series.hpp"
#include "model/pencil_modes.hpp"

namespace flexgram {

struct PencilSeries {
  bool is_known =
      true; ///< else rounding takes more than solves would: the system is to be solved
  std::optional<ResponseSeries> series; ///< nothing: a pole is too near
};
PencilSeries pencil_series(const PencilModes& modes, const PencilModes::Loads& loads,
                           Interval interval, int degree);

} // namespace flexgram
