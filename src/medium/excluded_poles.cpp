/// Bounds of frequency and residue where a resonance is excluded (Kato 1949, Davis and
/// Kahan 1970; docs/proof.md, section 4). A member of MediumModel, called by basis/cut.

#include "base/index.hpp"
#include "medium/model.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

namespace flexgram {
namespace {

constexpr double epsilon = std::numeric_limits<double>::epsilon();
constexpr double infinity = std::numeric_limits<double>::infinity();

/// The modes of a dense system in an interval: columns of U from `first`, `count` of
/// them.
struct Cluster {
  int first = 0, count = 0;
};

Cluster modes_within(const DenseResponse& response, const Interval& interval) {
  Cluster found;
  for (double lambda : response.lambda()) {
    if (lambda < interval.first * interval.first) ++found.first;
    if (lambda >= interval.first * interval.first &&
        lambda <= interval.last * interval.last)
      ++found.count;
  }
  return found;
}

Dense rows_within(const Dense& a, const Cluster& modes) {
  return part_of(a, modes.first, modes.count, 0, a.columns);
}

double distance(const Dense& a, const Dense& b) {
  double square = 0;
  for (std::size_t i = 0; i < a.data.size(); ++i)
    square += std::pow(a.data[i] - b.data[i], 2);
  return std::sqrt(square);
}

} // namespace

std::vector<MediumModel::Pole>
MediumModel::poles_within(const DenseSystem& small,
                          const std::vector<Interval>& intervals) const {
  std::vector<Pole> poles;
  if (intervals.empty() || !level_.response->is_diagonal()) return poles;
  const DenseResponse reduced(small, tau);
  const Certificate::Modes body = level_.certificate->modes();
  const std::vector<double> outside = level_.certificate->outside(*level_.response);
  // ‖E^−½P‖ of the inputs and of the outputs, in the units of the ports.
  const auto size_of = [&](const std::vector<int>& ports) {
    double square = 0;
    for (int port : ports) {
      const auto at = as_size(port);
      const double* x = level_.response->modal_inputs().column(port);
      for (int l = 0; l < level_.response->modal_inputs().rows; ++l)
        square += std::pow(x[l] / ports_.scale[at], 2);
      square += std::pow(outside[at], 2);
    }
    return std::sqrt(square);
  };
  const double in = size_of(ports_.inputs), out = size_of(ports_.outputs);
  Dense modal_inputs(level_.response->modal_inputs().rows,
                     static_cast<int>(ports_.inputs.size()));
  for (int j = 0; j < modal_inputs.columns; ++j)
    for (int l = 0; l < modal_inputs.rows; ++l) {
      const int port = ports_.inputs[as_size(j)];
      modal_inputs(l, j) =
          level_.response->modal_inputs()(l, port) / ports_.scale[as_size(port)];
    }

  for (const Interval& interval : intervals) {
    const Cluster here = modes_within(*level_.response, interval),
                  there = modes_within(reduced, interval);
    const auto first = as_size(here.first), end = first + as_size(here.count);
    if (here.count == 0 || end > body.mu.size()) continue;
    // The sine of the angle between the modes' span and the body's (Davis and Kahan).
    double square = 0;
    for (std::size_t k = first; k < end; ++k) square += std::pow(body.residual[k], 2);
    const double below =
        body.mu[end - 1] - (end < body.mu.size() ? body.largest_mu[end] : body.rest);
    const double above = first > 0 ? body.mu[first - 1] - body.mu[first] : infinity;
    double rounded = 0; // of the enclosures' ends
    for (std::size_t k = first; k < end; ++k)
      rounded = std::max(rounded, body.mu[k] * level_.certificate->rounding_of_mode(k));
    const double gap = std::min(above, below) - 2 * rounded;
    // Rounding of the projected K turns Ritz vectors into each other.
    const auto& mu = level_.response->mu();
    double mixed = 0;
    for (std::size_t k = first; k < end; ++k)
      for (std::size_t j = 0; j < mu.size(); ++j)
        if (j < first || j >= end)
          mixed += std::pow(std::max(mu[j], mu[k]) *
                                level_.certificate->rounding_between(j, k) /
                                std::max(std::abs(mu[j] - mu[k]), 1e-300),
                            2);
    const double sine =
        gap > 0 ? std::hypot(std::sqrt(square) / gap, std::sqrt(mixed)) : infinity;

    const Dense b = rows_within(modal_inputs, here),
                c = rows_within(ports_.modal_outputs, here);
    const Dense residue = multiply_transposed(c, b),
                residue_r =
                    multiply_transposed(rows_within(reduced.modal_outputs(), there),
                                        rows_within(reduced.modal_inputs(), there));
    const double size_b = frobenius_norm(b), size_c = frobenius_norm(c),
                 turned = sine * ((size_c + sine * out) * in + out * size_b);
    const double size_r = frobenius_norm(residue_r),
                 away = distance(residue, residue_r) + turned;
    const double relative = size_r > 0 && sine < 1 ? away / size_r : infinity;
    for (std::size_t k = first; k < end; ++k) {
      const double ritz = 1 / body.mu[k] - tau, least = 1 / body.largest_mu[k] - tau;
      Pole pole{std::sqrt(ritz), infinity, relative};
      if (there.count == here.count && least > 0) {
        pole.omega = std::sqrt(reduced.lambda()[k - first + as_size(there.first)]);
        pole.frequency =
            std::max(std::abs(std::sqrt(ritz) - pole.omega),
                     std::abs(std::sqrt(least) - pole.omega)) /
                pole.omega +
            level_.certificate->rounding_of_mode(k) / (2 * ritz * body.mu[k]) +
            2 * epsilon * (1 + tau / ritz); // 1/μ − τ, and the roots
      }
      poles.push_back(pole);
    }
  }
  return poles;
}

} // namespace flexgram
