#include "medium/modal_space.hpp"

#include "base/process.hpp"
#include "base/text.hpp"
#include "medium/cutoff.hpp"
#include "medium/lanczos.hpp"
#include "medium/mode_search.hpp"
#include "medium/model.hpp"
#include "medium/null_vectors.hpp"
#include "medium/port_loads.hpp"
#include "model/rigid_body_modes.hpp"

#include <cmath>
#include <limits>
#include <numbers>
#include <numeric>

namespace flexgram {

namespace {

/// So many that a user should know: the band may have been meant otherwise.
constexpr int many_modes = 400;

/// What is known of a body before a cutoff is chosen.
struct Start {
  PortLoads ports;
  Block rigid;     ///< modes from the geometry
  Dense stiffness; ///< that the stored K holds of these
  Block balanced;  ///< the ports' loads, self-equilibrated
  bool mass_is_singular = false;
  int geometric() const { return static_cast<int>(rigid.columns()); }
};

Start look_at_body(const CertifyRun& run, bool mass_is_singular) {
  Stage stage(run.observer, "cutoff");
  Start start;
  start.ports = port_loads(run.fom);
  RigidSplit split;
  start.rigid = rigid_body_modes(run.fom, &split);
  start.stiffness = std::move(split.stiffness);
  start.balanced = self_equilibrated(start.ports.all, start.rigid, run.fom.M);
  start.mass_is_singular = mass_is_singular;
  return start;
}

/// x^−½ as a power of two, which leaves all digits of what it is multiplied with.
double inverse_root(double x) { return std::exp2(std::round(-0.5 * std::log2(x))); }

/// Ports of equal weight: each divided by about the norm of its response.
/// @return the scale of each port. @param response  becomes that to the scaled ports.
std::vector<double> scale_ports(const SecondOrderModel& fom, double omega, int ports,
                                Block& response) {
  const InnerProduct product{fom.M, fom.K, 1 / (omega * omega)};
  const Dense gram = inner(response, product.apply(response));
  std::vector<double> scale;
  for (int j = 0; j < ports; ++j)
    scale.push_back(gram(j, j) > 0 ? inverse_root(gram(j, j)) : 1.0);
  share_from_first(fom.comm, scale);
  std::vector<double> all = scale;
  for (int j = ports; j < gram.rows; ++j) all.push_back(inverse_root(gram(j, j)));
  scale_columns(response, all);
  return scale;
}

/// How exact the modes must be when the search ends. The certificate takes any, and the
/// Krylov blocks that follow improve them; where modes are asked for themselves, or stand
/// for H beside resonances without damping, they must be good.
double angle_of_modes(const CertifyRun& run, const ModalSpace& modal) {
  if (run.spec.modes > 0 || modal.exact) return 1e-6;
  const Damping& d = run.fom.damping;
  const double loss = d.eta + d.alpha / modal.cutoff + d.beta * modal.cutoff;
  return loss < 1e-5 ? 1e-3 : 3.0;
}

/// Where many modes are searched from [rad²/s²]: at the cutoff, or lower, where fewer Krylov vectors
/// serve both ends of the spectrum, if these save more than two factorisations cost. By flops.
double search_shift(const CertifyRun& run, const ModalSpace& modal) {
  constexpr double within = 0.35;
  const FactorEstimate& factor = run.factors.estimate();
  const auto flops = [&](double columns_of_a_mode) {
    const double columns = columns_of_a_mode * modal.elastic;
    return 4 * factor.factor_entries * columns +
           2 * static_cast<double>(run.fom.n) * columns * columns;
  };
  const bool pays = flops(from_cutoff) - flops(from_within) > 2 * factor.flops;
  return (pays ? within : 1) * modal.cutoff * modal.cutoff;
}

/// What the run will take with the vectors of many modes.
void tell_memory(const CertifyRun& run, double modes, bool within) {
  const double columns = (within ? from_within : from_cutoff) * modes,
               most = max_over(run.fom.comm,
                               resident_memory_mb() +
                                   memory_of_modes(run.fom.rows.size(), columns));
  run.observer.fact("memory", text("the run about %.0f MB on a rank, with the vectors of "
                                   "%.0f modes",
                                   most, modes));
  warn_of_memory(most, run.factors.memory_limit_mb(), run.observer);
  run.observer.print(); // before it is used
}

/// K − σM for a σ near this that is no eigenvalue. @return σ
double hold_regular(const CertifyRun& run, double sigma) {
  for (int attempt = 0; attempt < 4; ++attempt, sigma *= 0.9877) {
    run.factors.hold(-sigma);
    if (run.factors.null() == 0) break;
  }
  return sigma;
}

/// Many modes by Lanczos, and what the responses need beside them; not the Krylov space that it takes
/// to find them. @param response  to the ports, and to random loads after these.
void add_many_modes(const CertifyRun& run, const Start& start, ModalSpace& modal,
                    Block response, int ports) {
  Stage stage(run.observer, "modes");
  const double cutoff = modal.cutoff * modal.cutoff;
  const double sigma = search_shift(run, modal);
  tell_memory(run, modal.elastic, sigma < cutoff);
  constexpr int samples = 16;
  const double target = std::sqrt(run.spec.target); // errors of H are products of two
  LanczosSpec spec{.product = modal.space->product(),
                   .shift = hold_regular(run, sigma),
                   .cutoff = cutoff,
                   .expected = modal.elastic,
                   .enough = std::min(angle_of_modes(run, modal),
                                      std::clamp(1e-2 * target, 1e-7, 1e-2)),
                   .ports = ports,
                   .negligible = std::clamp(2e-2 * target, 1e-7, 1e-2),
                   .most = run.columns_in_memory()};
  for (int k = 0; k <= samples; ++k)
    spec.samples.push_back(
        std::pow(run.reference * std::sin(0.5 * std::numbers::pi * k / samples), 2));
  std::vector<int> first(as_size(ports));
  std::iota(first.begin(), first.end(), 0);
  Block of_ports = select_columns(response, first);
  LanczosModes found =
      lanczos_modes(spec, run.factors, start.rigid, std::move(response), run.observer);
  run.factors.hold(-cutoff);
  modal.space->restore(std::move(found.modes));
  modal.space->append(concatenate(of_ports, found.beside), 1e-7);
  modal.found = std::move(found.lambda);
  modal.solves = found.solves;
  run.observer.fact("search",
                    text("block Lanczos about %.4g Hz, %d columns: the modes are kept, "
                         "and %d directions of responses",
                         std::sqrt(spec.shift) * hz, found.columns,
                         modal.space->columns() - modal.rigid() - modal.elastic));
}

/// The space of the rigid modes that the geometry tells and the response to the ports.
ModalSpace space_of_ports(const CertifyRun& run, const Start& start, double omega) {
  Cutoff cutoff = [&] {
    Stage stage(run.observer, "cutoff");
    return choose_cutoff(run, start.ports, start.balanced, start.geometric(), omega,
                         start.mass_is_singular);
  }();
  ModalSpace modal;
  modal.cutoff = cutoff.omega;
  modal.elastic = cutoff.below - start.geometric();
  if (modal.elastic > many_modes)
    run.observer.say(
        text("  %d natural frequencies lie below the cutoff of %.4g Hz: their "
             "search takes long. Is the mesh fine enough for them?",
             modal.elastic, modal.cutoff * hz));
  modal.scale = scale_ports(run.fom, cutoff.omega, start.ports.count(), cutoff.response);
  modal.loads = copy(start.ports.all);
  scale_columns(modal.loads, modal.scale);
  modal.space = std::make_unique<MediumSpace>(run.fom, cutoff.kappa, run.tau);
  modal.space->start_with_rigid_modes(start.rigid.share(), start.stiffness,
                                      start.geometric());
  const int company = static_cast<int>(cutoff.response.columns()) - start.ports.count();
  Block response = without_many_outputs(std::move(cutoff.response), start.ports);
  // With few modes the Krylov vectors beside them serve the responses, and are kept. A start of many
  // ports would leave Lanczos too few steps.
  if (modal.elastic > wide_block && response.columns() <= wide_block &&
      modal.elastic <= run.largest_order())
    add_many_modes(run, start, modal, std::move(response),
                   static_cast<int>(response.columns()) - company);
  else
    modal.space->append(std::move(response), 1e-7);
  return modal;
}

/// Whether a backward error of the factorisation, 1000 ε of each entry of K, could not
/// have moved an eigenvalue across the cutoff.
bool cutoff_is_in_a_gap(const CertifyRun& run, const ModalSpace& modal) {
  const RitzPairs pairs = ritz_pairs(*modal.space);
  const auto& g = modal.space->rounding_weights();
  const double sigma = modal.cutoff * modal.cutoff;
  bool safe = true;
  for (std::size_t j = 0; j < pairs.lambda.size(); ++j) {
    double weight = 0; // φᵀdiag(K)φ
    const double* u = pairs.vectors.column(static_cast<int>(j));
    for (std::size_t i = 0; i < g.size(); ++i) weight += std::pow(g[i] * u[i], 2);
    safe = safe && std::abs(pairs.lambda[j] - sigma) >
                       1e3 * std::numeric_limits<double>::epsilon() * weight;
  }
  if (!safe)
    run.observer.warn("an eigenvalue lies so near the cutoff that the inertia may have "
                      "miscounted: another {cutoff} helps");
  return safe;
}

/// All modes below the cutoff into the space; those without stiffness are rigid.
void add_modes(const CertifyRun& run, ModalSpace& modal, int geometric) {
  if (modal.elastic + geometric > run.largest_order())
    throw Error(text(
        "%d modes lie below the cutoff of %g Hz, more than a medium model of order %d "
        "can hold (%s): narrow {band_hz}, lower {cutoff}, or take {method} pod%s",
        modal.elastic, modal.cutoff * hz, run.largest_order(),
        run.why_no_larger().c_str(),
        modal.elastic > 1000 ? "; are the units of the body right?" : ""));
  int solves = 0;
  if (modal.elastic > 0) {
    Stage stage(run.observer, "modes");
    solves = modal.solves +
             find_modes(*modal.space, run.factors, modal.cutoff * modal.cutoff,
                        modal.elastic, angle_of_modes(run, modal),
                        rigid_threshold(run.fom), run.observer, std::move(modal.found));
    take_out_null_vectors(run, modal);
  }
  modal.inertia_is_safe = cutoff_is_in_a_gap(run, modal);
  const int rigid = modal.rigid();
  std::string words = text("%d elastic below the cutoff of %.4g Hz, counted by inertia",
                           modal.elastic, modal.cutoff * hz);
  if (modal.elastic == 0 && rigid == 6)
    words += " (the band is in Hz, up to the first elastic modes or beyond?)";
  if (modal.elastic > 0)
    words += text(", all found (%d solves beside the ports)", solves);
  run.observer.fact("modes", words);
  if (rigid > 6)
    run.observer.warn(
        text("the body has %d rigid modes, more than the six of one body: loose parts or "
             "hinges move by themselves",
             rigid));
  run.observer.fact("rigid modes",
                    rigid == 0 ? "none"
                               : text("%d, %s, taken out analytically", rigid,
                                      rigid == geometric ? "from the geometry"
                                                         : "from the null space of K"));
}

} // namespace

ModalSpace find_modal_space(const CertifyRun& run, double omega, bool mass_is_singular,
                            bool exact) {
  const Start start = look_at_body(run, mass_is_singular);
  const double first = run.spec.bands.front().first;
  if (start.geometric() > 0) refuse_statics_of_a_free_body(first);
  for (int attempt = 1;; ++attempt) {
    ModalSpace modal = space_of_ports(run, start, omega);
    modal.exact = exact;
    try {
      add_modes(run, modal, start.geometric());
    } catch (const MiscountError&) {
      if (attempt == 3) throw;
      omega = 1.0123 * modal.cutoff; // a mode on the cutoff: beside it
      continue;
    }
    if (modal.rigid() > 0) {
      refuse_statics_of_a_free_body(first);
      if (!run.fom.terms.empty() && run.spec.relative_to == RelativeTo::elastic)
        refuse_elastic_part();
    }
    return modal;
  }
}

void hold_cutoff(const CertifyRun& run, ModalSpace& modal) {
  const double shift = -modal.cutoff * modal.cutoff;
  if (run.factors.holds(shift)) return; // if not: a restart, or slow modes were sharpened
  Stage stage(run.observer, "cutoff");
  run.factors.hold(shift);
  modal.inertia_is_safe = modal.inertia_is_safe && run.factors.null() == 0 &&
                          run.factors.negative() == modal.modes();
}

std::shared_ptr<const DenseResponse> ritz_response(const CertifyRun& run,
                                                   const ModalSpace& modal) {
  const MediumSpace& space = *modal.space;
  DenseSystem system;
  system.M = space.M();
  system.K = space.K();
  for (std::size_t t = 0; t < space.terms().size(); ++t)
    system.terms.push_back({run.fom.terms[t].law, space.terms()[t]});
  system.damping = run.fom.damping;
  system.B = space.projected_ports(modal.loads);
  system.C = system.B;
  system.negligible = negligible_rounding(run.spec.target);
  return std::make_shared<DenseResponse>(std::move(system), run.tau);
}

} // namespace flexgram
