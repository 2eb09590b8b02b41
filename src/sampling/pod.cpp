#include "sampling/pod.hpp"

#include "base/index.hpp"
#include "base/text.hpp"
#include "model/kinds.hpp"
#include "model/port_views.hpp"
#include "model/project.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <numeric>

namespace flexgram {

std::vector<double> check_frequencies(const std::vector<double>& samples, int count,
                                      double first, double last) {
  std::vector<double> sorted = samples, result;
  std::sort(sorted.begin(), sorted.end());
  if (count == 0) return result;
  for (double end : {first, last})
    if (std::abs(end - sorted.front()) > 1e-9 * last &&
        std::abs(end - sorted.back()) > 1e-9 * last)
      result.push_back(end);
  const int gaps = static_cast<int>(sorted.size()) - 1;
  count = std::min(count, gaps);
  for (int i = 0; i < count; ++i) {
    const auto gap = static_cast<std::size_t>((i + 0.5) * gaps / count);
    result.push_back(0.5 * (sorted[gap] + sorted[gap + 1]));
  }
  return result;
}

namespace {

/// The model of the first m basis vectors.
SecondOrderModel leading_part(const SecondOrderModel& rom, int m) {
  SecondOrderModel part;
  const auto corner = [&](Mat a) {
    const Dense whole = to_dense(a);
    Dense c(m, m);
    for (int j = 0; j < m; ++j) std::copy_n(whole.column(j), m, c.column(j));
    return make_dense(c);
  };
  const auto rows = [&](const Block& b) {
    Block top(PETSC_COMM_SELF, {0, m}, m, b.columns());
    const Block::Access from(b);
    Block::Access to(top);
    for (PetscInt j = 0; j < b.columns(); ++j)
      std::copy_n(from.column(j), m, to.column(j));
    return top;
  };
  part.name = rom.name;
  part.comm = rom.comm;
  part.n = m;
  part.rows = {0, m};
  part.K = corner(rom.K);
  part.M = corner(rom.M);
  for (const auto& [law, matrix] : rom.terms) part.terms.push_back({law, corner(matrix)});
  part.damping = rom.damping;
  part.B = rows(rom.B);
  part.outputs_are_inputs = rom.outputs_are_inputs;
  part.C = rom.outputs_are_inputs ? part.B.share() : rows(rom.C);
  part.feedthrough = rom.feedthrough;
  part.output_damping = rom.output_damping;
  part.inputs = rom.inputs;
  part.outputs = rom.outputs;
  return part;
}

/// Smallest m whose error, of H and of each kind of ports if asked, is below the
/// tolerance at every known frequency.
int order_by_tolerance(const SecondOrderModel& rom, const std::vector<double>& omega,
                       const std::vector<ComplexDense>& H, double tolerance,
                       const KindSpec& kinds) {
  const auto views = port_views(rom, kinds);
  std::size_t worst = 0; // the frequency that ruled out the last order rules out most
  for (int m = 1; m <= rom.n; ++m) {
    const SecondOrderModel part = leading_part(rom, m);
    const auto fails = [&](std::size_t l) {
      const ComplexDense H_r = dense_transfer(part, omega[l]);
      return std::any_of(views.begin(), views.end(), [&](const PortView& view) {
        return !(relative_error(view.of(H[l]), view.of(H_r)) <= tolerance * view.allowed);
      });
    };
    if (fails(worst)) continue;
    bool good = true;
    for (std::size_t l = 0; good && l < omega.size(); ++l)
      if (fails(l)) {
        worst = l;
        good = false;
      }
    if (good) return m;
  }
  throw Error(text("{tol} %g is not met by all %d directions of the samples: use more "
                   "{samples}",
                   tolerance, static_cast<int>(rom.n)));
}

/// Errors at the samples, then at the checks; sorted by frequency in the end.
struct Judged {
  double at_samples = 0, between = 0; ///< largest errors
  long checks = 0;
};

Judged judge(ReducedModel& rom, const std::vector<ComplexDense>& H, std::size_t samples) {
  for (std::size_t l = 0; l < H.size(); ++l)
    rom.claim.curve.error.push_back(
        relative_error(H[l], dense_transfer(rom.system, rom.claim.curve.omega[l])));
  Judged judged;
  const auto first_check = rom.claim.curve.error.begin() + static_cast<long>(samples);
  judged.checks = rom.claim.curve.error.end() - first_check;
  judged.at_samples = *std::max_element(rom.claim.curve.error.begin(), first_check);
  judged.between = judged.checks > 0
                       ? *std::max_element(first_check, rom.claim.curve.error.end())
                       : judged.at_samples;
  return judged;
}

void sort_by_frequency(ReducedModel& rom) {
  std::vector<std::size_t> by_frequency(rom.claim.curve.omega.size());
  std::iota(by_frequency.begin(), by_frequency.end(), 0);
  std::sort(by_frequency.begin(), by_frequency.end(), [&](auto a, auto b) {
    return rom.claim.curve.omega[a] < rom.claim.curve.omega[b];
  });
  for (std::vector<double>* values : {&rom.claim.curve.omega, &rom.claim.curve.error}) {
    std::vector<double> sorted;
    for (auto l : by_frequency) sorted.push_back((*values)[l]);
    *values = std::move(sorted);
  }
}

void tell_order(const ReducedModel& rom, PetscInt n, const OrderSpec& asked,
                Observer& observer) {
  const bool by_tolerance = asked.tolerance && asked.order == 0;
  const auto order = as_size(rom.system.n);
  const bool met = order < rom.sigma.size();
  observer.fact("order",
                text("m = %zu of n = %lld, by %s", order, static_cast<long long>(n),
                     asked.order > 0 ? "{order}"
                     : by_tolerance  ? text("{tol} %g", *asked.tolerance).c_str()
                     : met           ? "the rule sigma_(m+1)/sigma_1 < 1.5e-8"
                                     : "what the samples hold"));
  if (!met && asked.order == 0 && !by_tolerance)
    observer.warn("the samples end before the order rule is met: use more {samples}");
  if (!met || rom.sigma.front() <= 0) return;
  const double tail =
      std::accumulate(rom.sigma.begin() + static_cast<long>(order), rom.sigma.end(), 0.0);
  observer.fact("indicators",
                text("sigma_(m+1)/sigma_1 = %.1e, sqrt of the neglected sum = %.1e",
                     rom.sigma[order] / rom.sigma[0], std::sqrt(tail)));
}

void tell_error(const Judged& judged, std::size_t samples, Observer& observer) {
  if (judged.checks > 0 && judged.between > 10 * judged.at_samples &&
      judged.between > 1e-6)
    observer.warn(
        text("between the samples the error is %.0f times as large as at them: use more "
             "{samples}",
             judged.between / judged.at_samples));
  std::string error = text("at most %.1e at the %zu samples", judged.at_samples, samples);
  error += judged.checks > 0
               ? text(", %.1e at %ld others (between them, ends of the band)",
                      judged.between, judged.checks)
               : std::string(", not checked between them");
  observer.fact("error", error + " (estimated, not proved)");
}

} // namespace

ReducedModel reduce_pod(const SecondOrderModel& fom, FrequencySolves& solves,
                        const SamplingSpec& spec, int rigid_modes, Observer& observer) {
  const auto [first, last] = spec.band;
  Snapshots samples;
  {
    Stage stage(observer, "samples");
    samples = sample_band(solves, spec.nodes());
  }
  const bool by_tolerance = spec.order.tolerance && spec.order.order == 0;
  if (spec.equal_ports) scale_ports(samples.Z, fom.M, fom.B.columns());
  GramianBasis basis = gramian_basis(std::move(samples.Z), fom.M, fom.K, last, spec,
                                     by_tolerance, observer);
  ReducedModel rom;
  {
    Stage stage(observer, "project");
    rom.system = project(fom, basis.V);
  }
  rom.claim.curve.omega = samples.omega;
  std::vector<ComplexDense> H = std::move(samples.H);
  {
    Stage stage(observer, "error");
    const auto extra = check_frequencies(samples.omega, spec.checks, first, last);
    auto H_extra = solves.transfer(extra, "check");
    rom.claim.curve.omega.insert(rom.claim.curve.omega.end(), extra.begin(), extra.end());
    std::move(H_extra.begin(), H_extra.end(), std::back_inserter(H));
  }
  if (by_tolerance) {
    int order = order_by_tolerance(rom.system, rom.claim.curve.omega, H,
                                   spec.order.smallest(), spec.order.kinds());
    MPI_Bcast(&order, 1, MPI_INT, 0, fom.comm); // dense work may differ in the last bit
    rom.system = leading_part(rom.system, order);
    std::vector<int> columns(as_size(order));
    std::iota(columns.begin(), columns.end(), 0);
    basis.V = select_columns(basis.V, columns);
  }
  const Judged judged = judge(rom, H, samples.omega.size());
  std::vector<ComplexDense> H_r;
  for (double omega : rom.claim.curve.omega)
    H_r.push_back(dense_transfer(rom.system, omega));
  sort_by_frequency(rom);
  rom.provenance.method = "pod";
  rom.V = std::move(basis.V);
  rom.sigma = basis.sigma;
  rom.modes = eigenfrequencies(rom.system);
  rom.claim.band[0] = first;
  rom.claim.band[1] = last;
  rom.provenance.factorisations = solves.factorisations();
  rom.frame.rigid_modes = rigid_modes;

  observer.fact("inner product", basis.inner_product);
  tell_order(rom, fom.n, spec.order, observer);
  tell_error(judged, samples.omega.size(), observer);
  warn_of_kinds(rom.system, H, H_r, std::max(judged.at_samples, judged.between),
                observer);
  observer.fact("modes", describe_modes(rom.modes, rigid_modes));
  observer.fact("reduced M, K", text("smallest over largest eigenvalue %.1e, %.1e",
                                     relative_smallest_eigenvalue(rom.system.M),
                                     relative_smallest_eigenvalue(rom.system.K)));
  observer.fact("solves",
                text("%d factorisations, backward error at most %.0e",
                     rom.provenance.factorisations, solves.worst_backward_error()));
  observer.print();
  return rom;
}

} // namespace flexgram
