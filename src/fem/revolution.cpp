#include "fem/revolution.hpp"

#include "base/parallel.hpp"
#include "base/text.hpp"
#include "fem/vectors.hpp"

#include <algorithm>
#include <cmath>

namespace flexgram {
namespace {

double length(const Vector3& a) {
  return std::sqrt(a[0] * a[0] + a[1] * a[1] + a[2] * a[2]);
}

} // namespace

void Revolution::add(const PlacedElement& at, const Dense& gyroscopic, double mass) {
  const std::size_t count = at.x.size();
  double mean = 0;
  for (std::size_t i = 0; i < count; ++i) {
    Vector3 from = at.x[i];
    for (std::size_t c = 0; c < 3; ++c) from[c] -= spin_.point[c];
    const double r = length(cross(spin_.axis, from));
    radius_ = std::max(radius_, r);
    mean += r / static_cast<double>(count);
    // A translation along x is carried along as it is, so that its force is the flow.
    for (std::size_t j = 0; j < count; ++j)
      flow_[as_size(at.nodes[i])] +=
          gyroscopic(static_cast<int>(3 * i), static_cast<int>(3 * j));
  }
  turning_ += mass * mean;
}

double Revolution::flow(MPI_Comm comm) const {
  std::vector<double> all = flow_;
  MPI_Allreduce(MPI_IN_PLACE, all.data(), static_cast<int>(all.size()), MPI_DOUBLE,
                MPI_SUM, comm);
  double sum = 0;
  for (double f : all) sum += std::abs(f);
  const double turning = sum_over(comm, turning_);
  return turning > 0 ? sum * max_over(comm, radius_) / turning : 0;
}

void Revolution::expect(MPI_Comm comm, Observer& observer) const {
  const double share = flow(comm);
  if (share > 0.2)
    throw Error(text("spin: in the frame at rest solids are bodies of revolution about "
                     "its axis; this one is not (%.0f %% of it leaves its place as it "
                     "turns). Others are seen in the frame that turns (frame: turning)",
                     100 * share));
  if (share > 0.02)
    observer.warn(text("spin: the solids are no exact body of revolution: %.2g %% of "
                       "them leave their place as they turn. In the frame at rest that "
                       "is left out; take a finer or more even mesh, or frame: turning",
                       100 * share));
}

} // namespace flexgram
