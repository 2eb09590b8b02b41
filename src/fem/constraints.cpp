#include "fem/constraints.hpp"

#include "base/error.hpp"
#include "base/index.hpp"
#include "base/text.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>

namespace flexgram {
namespace {

/// Pairs of node and component, as 6 · node + component.
std::vector<std::int64_t> read_dofs(const Hdf5File& file, const std::string& dataset,
                                    std::int64_t points) {
  const auto pairs = file.read_all<std::int64_t>(dataset);
  std::vector<std::int64_t> dofs;
  for (std::size_t k = 0; k + 1 < pairs.size(); k += 2) {
    const std::int64_t node = pairs[k], component = pairs[k + 1];
    if (node < 0 || node >= points || component < 0 || component > 5)
      throw Error(text("file %s: %s holds component %lld of node %lld, the mesh has %lld "
                       "points of at most six",
                       file.path().c_str(), dataset.c_str(),
                       static_cast<long long>(component), static_cast<long long>(node),
                       static_cast<long long>(points)));
    dofs.push_back(6 * node + component);
  }
  return dofs;
}

} // namespace

std::span<const Share> Constraints::of(std::int64_t node, int component) const {
  const auto found = std::lower_bound(dof.begin(), dof.end(), 6 * node + component);
  const auto k = as_size(found - dof.begin());
  return std::span(shares).subspan(start[k], start[k + 1] - start[k]);
}

bool Constraints::are_means() const {
  for (std::size_t k = 0; k < dof.size(); ++k) {
    const std::int64_t first = dof[k] - dof[k] % 3; // of a displacement or a rotation
    const auto own = static_cast<int>(dof[k] % 6);
    const auto like = of(first / 6, static_cast<int>(first % 6));
    const auto mine = of(dof[k] / 6, own);
    const bool all = std::binary_search(dof.begin(), dof.end(), first) &&
                     std::binary_search(dof.begin(), dof.end(), first + 1) &&
                     std::binary_search(dof.begin(), dof.end(), first + 2);
    if (!all || mine.size() != like.size()) return false;
    for (std::size_t j = 0; j < mine.size(); ++j)
      if (mine[j].node != like[j].node || mine[j].component != own ||
          std::abs(mine[j].factor - like[j].factor) > 1e-9)
        return false;
  }
  return true;
}

Constraints read_constraints(const Hdf5File& file, std::int64_t points) {
  Constraints result;
  if (!file.exists("/constraints")) return result;
  const auto dependent = read_dofs(file, "/constraints/dependent", points);
  const auto independent = read_dofs(file, "/constraints/independent", points);
  const auto start = file.read_all<std::int64_t>("/constraints/start");
  const auto factor = file.read_all<double>("/constraints/factor");
  const bool fits = start.size() == dependent.size() + 1 && start.front() == 0 &&
                    std::is_sorted(start.begin(), start.end()) &&
                    as_size(start.back()) == independent.size() &&
                    factor.size() == independent.size();
  if (!fits)
    throw Error(text("file %s: /constraints: start, dependent, independent and factor do "
                     "not fit each other",
                     file.path().c_str()));
  std::vector<std::size_t> order(dependent.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::sort(order.begin(), order.end(),
            [&](std::size_t a, std::size_t b) { return dependent[a] < dependent[b]; });
  for (const std::size_t k : order) {
    if (!result.dof.empty() && result.dof.back() == dependent[k])
      throw Error(text("file %s: /constraints: component %lld of node %lld (0-based) "
                       "depends twice",
                       file.path().c_str(), static_cast<long long>(dependent[k] % 6),
                       static_cast<long long>(dependent[k] / 6)));
    result.dof.push_back(dependent[k]);
    for (auto j = as_size(start[k]); j < as_size(start[k + 1]); ++j) {
      if (!std::isfinite(factor[j]))
        throw Error(text("file %s: /constraints/factor(%zu) = %g must be finite",
                         file.path().c_str(), j, factor[j]));
      result.shares.push_back(
          {independent[j] / 6, static_cast<int>(independent[j] % 6), factor[j]});
    }
    result.start.push_back(result.shares.size());
  }
  for (const Share& share : result.shares)
    if (std::binary_search(result.dof.begin(), result.dof.end(),
                           6 * share.node + share.component))
      throw Error(text("file %s: /constraints: component %d of node %lld (0-based) is "
                       "dependent, and others depend on it",
                       file.path().c_str(), share.component,
                       static_cast<long long>(share.node)));
  return result;
}

} // namespace flexgram
