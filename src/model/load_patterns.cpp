#include "model/load_patterns.hpp"

#include "base/index.hpp"
#include "base/process.hpp"
#include "base/text.hpp"
#include "linalg/decompositions.hpp"
#include "model/port_views.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <random>

namespace flexgram {
namespace {

/// What makes the mean compliance of each kind of ports the same.
/// @param compliance  of each port, about.
std::vector<double> units_of(const std::vector<std::string>& names,
                             const std::vector<double>& compliance) {
  std::vector<double> units(names.size());
  for (std::size_t i = 0; i < names.size(); ++i) {
    double sum = 0;
    int count = 0;
    for (std::size_t j = 0; j < names.size(); ++j)
      if (kind_of_port(names[j]) == kind_of_port(names[i])) {
        sum += compliance[j];
        ++count;
      }
    units[i] = sum > 0 ? std::sqrt(count / sum) : 1.0;
  }
  return units;
}

/// Normally distributed, the same on every rank and in every run.
Dense random_columns(MPI_Comm comm, int rows, int columns) {
  Dense a(rows, columns);
  std::mt19937_64 engine(1);
  std::normal_distribution<double> normal;
  for (double& x : a.data) x = normal(engine);
  share_from_first(comm, a.data);
  return a;
}

/// G = U Bᵀ(K + τM)⁻¹B U, U the diagonal matrix of the inputs' units: of loads in these
/// units the motion of their points of action.
class Compliance {
public:
  Compliance(const SecondOrderModel& body, double tau, const SolverOptions& options)
      : units(as_size(body.B.columns()), 1.0), body_(body),
        solver_(body.K, body.M, {}, body.node, options) {
    solver_.factorise({1.0, tau}, Definiteness::positive);
  }

  Dense operator()(Dense loads) {
    in_units(loads);
    Dense motion(loads.rows, loads.columns);
    constexpr int panel = 64;
    for (int first = 0; first < loads.columns; first += panel) {
      stop_if_interrupted();
      const int width = std::min(panel, loads.columns - first);
      const Block forces = combine(body_.B, part_of(loads, 0, loads.rows, first, width));
      set_part(
          motion, 0, first,
          inner(body_.B, solver_.solve(forces, ShiftedSolver::Verify::first_column).x));
    }
    share_from_first(body_.comm, motion.data);
    in_units(motion);
    return motion;
  }

  /// U A
  void in_units(Dense& a) const {
    for (int j = 0; j < a.columns; ++j)
      for (int i = 0; i < a.rows; ++i) a(i, j) *= units[as_size(i)];
  }

  std::vector<double> units;

private:
  const SecondOrderModel& body_;
  ShiftedSolver solver_;
};

/// The diagonal of G, by Hutchinson's estimate.
std::vector<double> diagonal_of(const Dense& random, const Dense& response) {
  std::vector<double> diagonal;
  for (int i = 0; i < random.rows; ++i) {
    double sum = 0;
    for (int j = 0; j < random.columns; ++j) sum += random(i, j) * response(i, j);
    diagonal.push_back(std::max(sum / random.columns, 0.0));
  }
  return diagonal;
}

/// What the trace of G has outside the span of Q, by the same: from random loads w, G w
/// and G Q the mean of w̃ᵀG w̃, w̃ = (1 − QQᵀ)w, as wᵀ(1 − QQᵀ)(G w − G Q Qᵀw).
double trace_outside(const Dense& Q, const Dense& GQ, Dense random, const Dense& Gw) {
  const Dense inside = multiply_transposed(Q, random);
  const Dense taken = multiply(Q, inside), moved = multiply(GQ, inside);
  double sum = 0;
  for (std::size_t i = 0; i < random.data.size(); ++i)
    sum += (random.data[i] - taken.data[i]) * (Gw.data[i] - moved.data[i]);
  return std::max(sum / random.columns, 0.0);
}

} // namespace

LeadingPatterns leading_patterns(const SecondOrderModel& body, int count, double tau,
                                 const SolverOptions& options, Observer& observer) {
  Stage stage(observer, "load patterns");
  const int p = static_cast<int>(body.B.columns()),
            k = std::min(p, count + std::max(10, count / 5));
  Compliance G(body, tau, options);
  const Dense random = random_columns(body.comm, p, k);
  Dense first = G(random);
  G.units = units_of(body.inputs, diagonal_of(random, first));
  const double unit = G.units.front();
  if (std::all_of(G.units.begin(), G.units.end(), [&](double u) { return u == unit; }))
    for (double& x : first.data) x *= unit * unit;
  else
    first = G(random);

  Dense Q, GQ = first;
  for (int step = 0; step < 2; ++step) {
    Q = orthonormal_columns(std::move(GQ));
    share_from_first(body.comm, Q.data);
    GQ = G(Q);
  }
  Dense ritz = multiply_transposed(Q, GQ);
  symmetrise(ritz);
  SymmetricEigen eigen = symmetric_eigen(ritz);
  share_from_first(body.comm, eigen.values);
  share_from_first(body.comm, eigen.vectors.data);
  const auto value = [&](int i) { // from the largest
    return eigen.values[as_size(k - 1 - i)];
  };

  int kept = 0;
  std::vector<int> columns;
  double held = 0, trace = k == p ? 0.0 : trace_outside(Q, GQ, random, first);
  for (double v : eigen.values) trace += v;
  for (; kept < std::min(count, k) && value(kept) > 1e-14 * value(0); ++kept) {
    columns.push_back(k - 1 - kept);
    held += value(kept);
  }
  if (kept == 0) throw Error("{load_patterns}: the inputs move nothing");
  LeadingPatterns result{multiply(Q, columns_of(eigen.vectors, columns)), 0, 0};
  G.in_units(result.patterns);
  result.held = std::min(1.0, held / std::max(trace, held));
  result.next = kept < k ? std::max(value(kept), 0.0) / value(0) : 0;
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
    return narrow;
  }
  const Dense direct =
      multiply(body.feedthrough.between(body.outputs, body.inputs), loads.patterns);
  narrow.feedthrough = {};
  for (int j = 0; j < direct.columns; ++j)
    for (int i = 0; i < direct.rows; ++i) {
      if (direct(i, j) == 0) continue;
      narrow.feedthrough.outputs.push_back(body.outputs[as_size(i)]);
      narrow.feedthrough.inputs.push_back(narrow.inputs[as_size(j)]);
      narrow.feedthrough.values.push_back(direct(i, j));
    }
  return narrow;
}

void restore_ports(ReducedModel& rom, const SecondOrderModel& body, LoadSpan loads) {
  rom.system.B = make_block(inner(rom.V, body.B));
  rom.system.inputs = body.inputs;
  rom.system.feedthrough = body.feedthrough;
  if (body.outputs_are_inputs) {
    rom.system.C = rom.system.B.share();
    rom.system.outputs = rom.system.inputs;
  }
  rom.claim.loads = std::move(loads);
  rom.claim.form.reset(); // of the loads
  for (FieldClaim& claim : rom.claim.fields) claim.inputs = "these loads";
}

} // namespace flexgram
