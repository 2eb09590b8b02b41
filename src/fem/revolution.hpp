/// Whether solids are a body of revolution, as what turns in the frame at rest must be.

#pragma once

#include "base/observer.hpp"
#include "fem/followers.hpp"

namespace flexgram {

/// Collects, element by element, what enters and leaves the place of the body as it turns:
/// ∮ρ (v·n) N of each node. For a body of revolution that is nothing.
class Revolution {
public:
  Revolution(const AccelerationField& spin, std::int64_t points)
      : spin_(spin), flow_(as_size(points)) {}
  /// @param gyroscopic  of the element, by a spin of 1 rad/s; a solid.
  void add(const PlacedElement& at, const Dense& gyroscopic, double mass);
  /// Of what turns, the share that enters and leaves; 0: there are no solids. Collective.
  double flow(MPI_Comm comm) const;
  /// Warns of a share that is not small. @throws Error for a body of another shape. Collective.
  void expect(MPI_Comm comm, Observer& observer) const;

private:
  const AccelerationField& spin_;
  std::vector<double> flow_; ///< [kg m/s] of the nodes
  double turning_ = 0;       ///< ∫ρ r [kg m]
  double radius_ = 0;        ///< the largest [m]
};

} // namespace flexgram
