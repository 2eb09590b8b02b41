#include "model/load_patterns.hpp"

#include "base/process.hpp"
#include "base/text.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>

namespace flexgram {
namespace {

/// The kind of a port, by the last part of its name: 'f', 'm' or none.
char kind_of(const std::string& name) {
  const auto dot = name.rfind('.');
  return dot != std::string::npos && name.size() == dot + 3 ? name[dot + 1] : ' ';
}

/// What makes the mean compliance of each kind of ports the same.
/// @param compliance  of each port, about.
std::vector<double> units_of(const std::vector<std::string>& names,
                             const std::vector<double>& compliance) {
  std::vector<double> units(names.size());
  for (std::size_t i = 0; i < names.size(); ++i) {
    double sum = 0;
    int count = 0;
    for (std::size_t j = 0; j < names.size(); ++j)
      if (kind_of(names[j]) == kind_of(names[i])) {
        sum += compliance[j];
        ++count;
      }
    units[i] = sum > 0 ? std::sqrt(count / sum) : 1.0;
  }
  return units;
}

void scale_each_row(Dense& a, const std::vector<double>& units) {
  for (int j = 0; j < a.columns; ++j)
    for (int i = 0; i < a.rows; ++i) a(i, j) *= units[static_cast<std::size_t>(i)];
}

/// The same numbers on every rank.
Dense random_columns(int rows, int columns) {
  Dense a(rows, columns);
  std::uint64_t state = 0x9e3779b97f4a7c15;
  const auto uniform = [&] { // splitmix64
    std::uint64_t z = state += 0x9e3779b97f4a7c15;
    z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9;
    z = (z ^ (z >> 27)) * 0x94d049bb133111eb;
    return (static_cast<double>((z ^ (z >> 31)) >> 11) + 0.5) / 9007199254740992.0;
  };
  for (double& x : a.data) // Box and Muller
    x = std::sqrt(-2 * std::log(uniform())) * std::cos(2 * M_PI * uniform());
  return a;
}

} // namespace

LeadingPatterns leading_patterns(const SecondOrderModel& body, int count, double tau,
                                 const SolverOptions& options, Observer& observer) {
  Stage stage(observer, "load patterns");
  const int p = static_cast<int>(body.B.columns());
  const int k = std::min(p, count + std::max(10, count / 5));
  ShiftedSolver solver(body.K, body.M, nullptr, body.node, options);
  solver.factorise({1.0, tau, 0.0}, Definiteness::positive);
  const auto compliance = [&](const Dense& loads) { // Bᵀ(K + τM)⁻¹B · loads
    Dense result(p, loads.columns);
    constexpr int panel = 64;
    for (int first = 0; first < loads.columns; first += panel) {
      stop_if_interrupted();
      const int width = std::min(panel, loads.columns - first);
      const Block forces = combine(body.B, part_of(loads, 0, p, first, width));
      set_part(
          result, 0, first,
          inner(body.B, solver.solve(forces, ShiftedSolver::Verify::first_column).x));
    }
    share_from_first(body.comm, result.data);
    return result;
  };

  const Dense random = random_columns(p, k);
  Dense first = compliance(random), response = first;
  std::vector<double> diagonal; // Hutchinson's estimate
  for (int i = 0; i < p; ++i) {
    double sum = 0;
    for (int j = 0; j < k; ++j) sum += random(i, j) * first(i, j);
    diagonal.push_back(std::max(sum / k, 0.0));
  }
  const std::vector<double> units = units_of(body.inputs, diagonal);
  SymmetricEigen eigen;
  Dense basis;
  for (int step = 0; step < 2; ++step) {
    scale_each_row(response, units);
    basis = orthonormal_columns(response);
    share_from_first(body.comm, basis.data);
    Dense loads = basis;
    scale_each_row(loads, units);
    response = compliance(loads);
  }
  scale_each_row(response, units);
  Dense ritz = multiply_transposed(basis, response);
  symmetrise(ritz);
  eigen = symmetric_eigen(ritz);
  share_from_first(body.comm, eigen.values);
  share_from_first(body.comm, eigen.vectors.data);

  // The trace: what the basis has of it, and of the rest Hutchinson's estimate, from the
  // responses to random loads of unit size.
  Dense unit = random;
  const bool alike = std::all_of(units.begin(), units.end(),
                                 [&](double u) { return u == units.front(); });
  if (!alike) {
    Dense loads = random;
    scale_each_row(loads, units);
    first = compliance(loads);
  } else {
    for (double& x : first.data) x *= units.front();
  }
  scale_each_row(first, units);
  const Dense inside = multiply_transposed(basis, unit);
  const Dense taken = multiply(basis, inside);
  for (std::size_t i = 0; i < unit.data.size(); ++i) unit.data[i] -= taken.data[i];
  double trace = 0; // Σ wᵀG w̃, w̃ = (1 − QQᵀ) w, and G Q Qᵀ w = response · Qᵀw
  const Dense held_part = multiply(response, inside);
  for (std::size_t i = 0; i < unit.data.size(); ++i)
    trace += unit.data[i] * (first.data[i] - held_part.data[i]) / k;
  trace = k == p ? 0.0 : std::max(trace, 0.0);
  for (double value : eigen.values) trace += value;

  int kept = 0; // from the largest
  const double largest = eigen.values.back();
  const auto value = [&](int i) {
    return eigen.values[static_cast<std::size_t>(k - 1 - i)];
  };
  while (kept < std::min(count, k) && value(kept) > 1e-14 * largest) ++kept;
  if (kept == 0) throw Error("{load_patterns}: the inputs move nothing");
  std::vector<int> columns(static_cast<std::size_t>(kept));
  double held = 0;
  for (int i = 0; i < kept; ++i) {
    columns[static_cast<std::size_t>(i)] = k - 1 - i;
    held += value(i);
  }
  LeadingPatterns result{multiply(basis, columns_of(eigen.vectors, columns)), 0, 0};
  scale_each_row(result.patterns, units);
  result.held = std::min(1.0, held / std::max(trace, held));
  result.next = kept < k ? std::max(value(kept), 0.0) / largest : 0;
  return result;
}

SecondOrderModel with_patterns(const SecondOrderModel& body, const LoadSpan& loads) {
  SecondOrderModel narrow = body.share();
  narrow.B = combine(body.B, loads.patterns);
  narrow.inputs.clear();
  for (std::size_t j = 0; j < loads.names.size(); ++j) // not read as names of ports
    narrow.inputs.push_back(text("load %zu", j + 1));
  if (body.outputs_are_inputs) {
    narrow.C = narrow.B.share();
    narrow.outputs = narrow.inputs;
  }
  return narrow;
}

void restore_ports(ReducedModel& rom, const SecondOrderModel& body, LoadSpan loads) {
  rom.model.B = make_block(inner(rom.V, body.B));
  rom.model.inputs = body.inputs;
  if (body.outputs_are_inputs) {
    rom.model.C = rom.model.B.share();
    rom.model.outputs = rom.model.inputs;
  }
  rom.loads = std::move(loads);
}

} // namespace flexgram
