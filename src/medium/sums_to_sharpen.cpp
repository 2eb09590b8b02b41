/// Which sums of a level are worth twice the digits (declared in sharp_response.hpp).

#include "base/index.hpp"
#include "medium/sharp_response.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <numeric>

namespace flexgram {

namespace {

/// Of each mode the largest share of H's rounding: roots of K's and M's, the ports'.
using Shares = std::array<std::vector<double>, 3>;

Shares shares_of_rounding(const MediumModel& model, const DenseResponse& response,
                          const ProjectionRounding& rounding,
                          const std::vector<double>& scale,
                          const std::vector<double>& grid) {
  const int N = response.system().order();
  Shares shares;
  shares.fill(std::vector<double>(as_size(N), 0.0));
  for (double omega : grid) {
    const MediumModel::Stretch value = model.at(omega, 0);
    const ComplexDense x = response.modal_response(omega);
    const double a_k = std::abs(response.system().coefficients(omega).k);
    const std::vector<double> of_terms = largest_of(response.system().terms, omega);
    const auto size = [&](int i, const std::vector<int>& ports) {
      double square = 0;
      for (int j : ports) square += std::norm(x(i, j)) / std::pow(scale[as_size(j)], 2);
      return std::sqrt(square);
    };
    for (std::size_t v = 0; v < model.blocks().size(); ++v) {
      const auto& [inputs, outputs] = model.blocks()[v];
      const double known = model.views[v].allowed * value.size[v].below[0];
      for (int i = 0; i < N; ++i) {
        const auto at = as_size(i);
        const double in = size(i, inputs), out = size(i, outputs),
                     moved = std::max(in, out) / std::sqrt(known);
        const auto of_mode = rounding.shares(at, a_k, of_terms, omega);
        const double of_ports = rounding.of_ports(at, outputs, scale) * in +
                                rounding.of_ports(at, inputs, scale) * out;
        const std::array<double, 3> here{of_mode[0] * moved, of_mode[1] * moved,
                                         of_ports / known};
        for (std::size_t k = 0; k < 3; ++k) // not NaN
          if (here[k] > shares[k][at]) shares[k][at] = here[k];
      }
    }
  }
  return shares;
}

/// Modes from `first` on but for those of small shares, whose sum is `left_out` at most.
std::vector<int> all_but_small(const std::vector<double>& shares, int first,
                               double left_out) {
  std::vector<int> order(shares.size() - as_size(first));
  std::iota(order.begin(), order.end(), first);
  const auto share_of = [&](int i) { return shares[as_size(i)]; };
  std::stable_sort(order.begin(), order.end(),
                   [&](int i, int j) { return share_of(i) < share_of(j); });
  double sum = 0;
  auto large = order.begin();
  while (large != order.end() && sum + share_of(*large) <= left_out)
    sum += share_of(*large++);
  std::vector<int> chosen(large, order.end());
  std::sort(chosen.begin(), chosen.end());
  return chosen;
}

} // namespace

SharpSums sums_to_sharpen(MPI_Comm comm, const MediumModel& model,
                          const DenseResponse& response,
                          const ProjectionRounding& rounding,
                          const std::vector<double>& scale,
                          const std::vector<double>& grid, double allowed) {
  Shares shares = shares_of_rounding(model, response, rounding, scale, grid);
  for (auto& of : shares) share_from_first(comm, of);
  const std::vector<int> by_K = all_but_small(shares[0], model.rigid,
                                              std::sqrt(0.7 * allowed)),
                         by_ports = all_but_small(shares[2], model.rigid, 0.1 * allowed);
  SharpSums result{{}, all_but_small(shares[1], 0, std::sqrt(0.2 * allowed))};
  std::set_union(by_K.begin(), by_K.end(), by_ports.begin(), by_ports.end(),
                 std::back_inserter(result.K));
  return result;
}

} // namespace flexgram
