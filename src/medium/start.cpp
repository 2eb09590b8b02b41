/// First half of `certify`: rigid modes, the cutoff and its inertia, the modes below it
/// (docs/proof.md, section 2, and section 6, "Inertia").

#include "medium/builder.hpp"

#include "base/process.hpp"
#include "base/text.hpp"
#include "linalg/sparse.hpp"
#include "linalg/sparse_product.hpp"
#include "medium/checkpoint.hpp"
#include "medium/factors.hpp"
#include "medium/mode_search.hpp"
#include "model/rigid_body_modes.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>

namespace flexgram {

namespace {

/// Of each port, inputs first, the first one that is the same: what an interface measures
/// is what it drives, also where loads or stresses stand beside it. @note Collective.
std::vector<int> equal_ports(const SecondOrderModel& fom) {
  const int inputs = static_cast<int>(fom.B.columns());
  std::vector<int> first(static_cast<std::size_t>(inputs));
  std::iota(first.begin(), first.end(), 0);
  if (fom.outputs_are_inputs) return first;
  const Block::Access B(fom.B), C(fom.C);
  std::vector<double> differs;
  for (std::size_t j = 0; j < fom.outputs.size(); ++j) {
    const auto named = std::find(fom.inputs.begin(), fom.inputs.end(), fom.outputs[j]);
    const auto i = static_cast<int>(named - fom.inputs.begin());
    const bool same = i < inputs && std::equal(B.column(i), B.column(i) + fom.rows.size(),
                                               C.column(static_cast<PetscInt>(j)));
    first.push_back(i);
    differs.push_back(same ? 0.0 : 1.0);
  }
  MPI_Allreduce(MPI_IN_PLACE, differs.data(), static_cast<int>(differs.size()),
                MPI_DOUBLE, MPI_MAX, fom.comm);
  for (std::size_t j = 0; j < differs.size(); ++j) {
    const std::size_t at = static_cast<std::size_t>(inputs) + j;
    if (differs[j] > 0) first[at] = static_cast<int>(at);
  }
  return first;
}

/// x^−½ as a power of two, which leaves all digits of what it is multiplied with.
double inverse_root(double x) { return std::exp2(std::round(-0.5 * std::log2(x))); }

} // namespace

MediumBuilder::MediumBuilder(const SecondOrderModel& fom, const CertifySpec& spec,
                             const SolverOptions& solver, Observer& observer,
                             const CheckpointSpec& checkpoint)
    : fom_(fom), spec_(spec), checkpoint_(checkpoint), observer_(observer), start_(now()),
      options_(counting(solver)), solver_(fom.K, fom.M, nullptr, fom.node, options_) {
  solver_.count_pivots(true);
  loads_ = fom.outputs_are_inputs ? copy(fom.B) : concatenate(fom.B, fom.C);
  same_as_ = equal_ports(fom);
  medium_.body = fom.head();
  medium_.spec = spec;
  medium_.shortfall = unfinished;
}

void MediumBuilder::find_rigid_modes() {
  threshold_ = rigid_threshold(fom_);
  RigidSplit split;
  Block rigid = rigid_body_modes(fom_, &split);
  rigid_stiffness_ = std::move(split.stiffness);
  geometric_ = static_cast<int>(rigid.columns());
  ports_ = copy(loads_);
  // Self-equilibrated loads: no part of the response to them is rigid.
  if (geometric_ > 0) {
    add_product(ports_, -1.0, multiply(fom_.M, rigid), inner(rigid, ports_));
    // Gravity moves a free body rigidly: what is left of it is rounding.
    const auto before = column_maxima(loads_), after = column_maxima(ports_);
    std::vector<double> keep;
    for (std::size_t j = 0; j < after.size(); ++j)
      keep.push_back(after[j] > 1e-9 * before[j] ? 1.0 : 0.0);
    scale_columns(ports_, keep);
  }
  rigid_modes_ = std::move(rigid);
}

/// Dofs that by themselves would vibrate a million times faster than ω: as good as
/// massless.
bool MediumBuilder::has_light_dofs(const SecondOrderModel& fom, double omega) {
  const auto k = diagonal(fom.K), m = diagonal(fom.M);
  double fastest = 0;
  for (std::size_t i = 0; i < k.size(); ++i)
    if (k[i] > 0) fastest = std::max(fastest, m[i] > 0 ? k[i] / m[i] : HUGE_VAL);
  return max_over(fom.comm, fastest) > 1e12 * omega * omega;
}

/// The loads of few ports with random ones beside them, if there are modes to be found:
/// blocks of some width cost little more than narrow ones, and hundreds of modes would
/// take as many Krylov steps.
Block MediumBuilder::with_company(const Block& ports) const {
  const int width = std::clamp(expected_ / 10, 8, wide_block);
  const int more = std::min(expected_, width) - static_cast<int>(ports.columns());
  return more > 0 ? concatenate(ports, multiply(fom_.M, random_block(fom_.B, more, 99)))
                  : ports.share();
}

/// Chooses the arithmetic of the factors, once.
void MediumBuilder::need_factors() {
  if (!factors_are_chosen_) choose_factors(solver_, fom_, options_, observer_, false);
  factors_are_chosen_ = true;
}

/// Factorises K + sM.
void MediumBuilder::factorise(double s) {
  solver_.factorise({1.0, s, 0.0});
  solver_.forget_pattern();
}

void MediumBuilder::count_factorisations() {
  medium_.factorisations = factorisations_before_ + solver_.factorisations();
}

/// Factorises K − ω_c²M with ω_c near `omega`, away from eigenvalues and with enough
/// modes below; chooses the inner product. Returns the response to all ports, and to what
/// keeps them company.
Block MediumBuilder::start(double omega, bool mass_is_singular) {
  need_factors();
  const int modes_wanted = spec_.modes;
  int last_null = 0; // pivots without size at the cutoff before
  for (int attempt = 0; attempt < 12; ++attempt) {
    end_if_asked("the first factorisation");
    solver_.count_pivots(true);
    with_context(text("factorising K - ω²M at the cutoff, %g Hz", omega * hz),
                 [&] { factorise(-omega * omega); });
    cutoff_is_factorised_ = true;
    const int below = solver_.negative_pivots();
    if (below < modes_wanted) {
      omega *= std::min(3.0, 1.1 * std::sqrt((modes_wanted + 2.0) / std::max(below, 1)));
      continue;
    }
    expected_ = below - geometric_;
    medium_.cutoff = omega;
    const double kappa = 1 / (omega * omega);
    Block response;
    const int null = solver_.null_pivots();
    bool regular = null == 0;
    if (null > 0 && last_null > 0)
      throw Error(text(
          "K and M share %d null vector%s: the body has a mechanism without mass and "
          "stiffness (an unconnected node, a massless hinge)",
          null, null == 1 ? "" : "s"));
    last_null = null;
    if (regular) try {
        // Equal ports are answered once.
        std::vector<int> alone, place(same_as_.size());
        for (std::size_t j = 0; j < same_as_.size(); ++j) {
          const bool first = same_as_[j] == static_cast<int>(j);
          place[j] = first ? static_cast<int>(alone.size())
                           : place[static_cast<std::size_t>(same_as_[j])];
          if (first) alone.push_back(static_cast<int>(j));
        }
        response = solver_.solve(with_company(select_columns(ports_, alone))).x;
        medium_.solved_columns += static_cast<int>(response.columns());
        if (alone.size() < place.size()) {
          for (auto j = static_cast<int>(alone.size()); j < response.columns(); ++j)
            place.push_back(j);
          response = select_columns(response, place);
        }
      } catch (const ShiftError&) {
        regular = false;
      }
    if (regular) {
      const Block none;
      const Block Z =
          orthonormalise(copy(response), none, {fom_.M, fom_.K, kappa}, 1e-7).vectors;
      Dense m = inner(Z, multiply(fom_.M, Z));
      symmetrise(m);
      auto eigen = symmetric_eigen(m);
      share_from_first(fom_.comm, eigen.values);
      if (eigen.values.empty())
        throw Error("the ports move nothing, or so little that doubles cannot square it: "
                    "are the units of B and C right?");
      // zᵀMz = 1/(1 + λ/ω_c²) of a Ritz vector; λ = ω_c² to many digits: the shift hits a
      // mode.
      for (double value : eigen.values)
        regular = regular && std::abs(2 * value - 1) > 1e-7;
      mass_is_singular = mass_is_singular || has_light_dofs(fom_, omega) ||
                         eigen.values.front() * 1e3 * eigenvalue_scale(fom_) * kappa < 1;
    }
    if (regular) {
      medium_.kappa = mass_is_singular ? kappa : 0;
      observer_.fact("inner product",
                     mass_is_singular ? "M + K/ω_c² (M is singular)" : "M");
      return response;
    }
    omega *= 1.0123;
  }
  throw Error(text("no cutoff was found with %d modes below and no eigenvalue near",
                   modes_wanted));
}

/// Ports of equal weight: each divided by about the norm of its response.
void MediumBuilder::scale_ports(Block& response) {
  const InnerProduct product{fom_.M, fom_.K, 1 / (medium_.cutoff * medium_.cutoff)};
  const Dense gram = inner(response, product.apply(response));
  for (int j = 0; j < ports_.columns(); ++j)
    medium_.scale.push_back(gram(j, j) > 0 ? inverse_root(gram(j, j)) : 1.0);
  share_from_first(fom_.comm, medium_.scale);
  for (Block* block : {&loads_, &ports_}) scale_columns(*block, medium_.scale);
  std::vector<double> all = medium_.scale;
  for (auto j = static_cast<int>(all.size()); j < gram.rows; ++j)
    all.push_back(inverse_root(gram(j, j)));
  scale_columns(response, all);
}

void MediumBuilder::unscale_ports() {
  for (double& x : medium_.scale) x = 1 / x;
  for (Block* block : {&loads_, &ports_}) scale_columns(*block, medium_.scale);
  medium_.scale.clear();
}

/// What the user allows, or what memory does: V, S and one more of that size.
int MediumBuilder::largest_order() const {
  if (spec_.limit > 0) return spec_.limit;
  const double memory = 0.5 * available_memory_mb(fom_.comm) * 1e6;
  const double each =
      3 * 8.0 * static_cast<double>(std::max<PetscInt>(fom_.rows.size(), 1));
  const double limit = std::min({2000.0, memory / each, static_cast<double>(fom_.n)});
  return static_cast<int>(-max_over(fom_.comm, -limit));
}

/// Whether a backward error of the factorisation, 1000 ε of each entry of K, could not
/// have moved an eigenvalue across the cutoff.
bool MediumBuilder::cutoff_is_in_a_gap() const {
  const RitzPairs pairs = ritz_pairs(*space_);
  const auto& g = space_->rounding_weights();
  const double sigma = medium_.cutoff * medium_.cutoff;
  bool safe = true;
  for (std::size_t j = 0; j < pairs.lambda.size(); ++j) {
    double weight = 0; // φᵀdiag(K)φ
    const double* u = pairs.vectors.column(static_cast<int>(j));
    for (std::size_t i = 0; i < g.size(); ++i) weight += std::pow(g[i] * u[i], 2);
    safe = safe && std::abs(pairs.lambda[j] - sigma) >
                       1e3 * std::numeric_limits<double>::epsilon() * weight;
  }
  if (!safe)
    observer_.warn("an eigenvalue lies so near the cutoff that the inertia may have "
                   "miscounted: another {cutoff} helps");
  return safe;
}

/// Modes so slow that they may be rigid, which no geometry told: sharpened by a
/// factorisation of their own, K + sM with s far below the elastic modes, and judged.
void MediumBuilder::take_out_rigid_modes() {
  RitzPairs pairs = ritz_pairs(*space_);
  const auto candidates = static_cast<int>(std::min<std::ptrdiff_t>(
      expected_, std::lower_bound(pairs.lambda.begin(), pairs.lambda.end(), slow()) -
                     pairs.lambda.begin()));
  judged_elastic_ = candidates;
  if (candidates == 0) return;
  factorise(1e-2 * slow());
  cutoff_is_factorised_ = false;
  for (int step = 0; step < 3; ++step) { // each divides what is elastic by λ_1/s
    const Block loads =
        multiply(fom_.M, combine(space_->V(), first_columns(pairs.vectors, candidates)));
    space_->append(solver_.solve(loads, ShiftedSolver::Verify::none).x, 1e-11);
    medium_.solved_columns += candidates;
    pairs = ritz_pairs(*space_);
  }
  const Dense slow_ones = first_columns(pairs.vectors, candidates);
  const RigidSplit split = split_rigid(fom_, combine(space_->V(), slow_ones), true);
  const int null = split.count;
  observer_.fact("slow modes",
                 text("%d below %.3g Hz: %d of them rigid, by a factorisation of "
                      "K + sM (the body has no coordinates, or soft mounts)",
                      candidates, std::sqrt(slow()) * hz, null));
  judged_elastic_ -= null;
  if (null == 0) return;
  Dense vectors = pairs.vectors;
  set_part(vectors, 0, 0, multiply(slow_ones, split.rotation));
  const Dense all = orthonormal_columns(std::move(vectors));
  begin_with_null_vectors(first_columns(all, null),
                          part_of(all, 0, all.rows, null, all.columns - null));
  expected_ -= null;
}

/// The space again, null vectors of K among its rigid modes: their exact image under K, and the
/// factor of K + sM, take away what is elastic in them, down to the rounding of their entries.
/// @param null, elastic  in the coordinates of V.
void MediumBuilder::begin_with_null_vectors(const Dense& null, const Dense& elastic) {
  const int before = space_->rigid();
  Block known;
  if (before > 0)
    known = combine(space_->V(), first_columns(identity(space_->columns()), before));
  Block rigid = combine(space_->V(), null);
  for (int step = 0; step < 2; ++step)
    add_product(rigid, -1.0,
                solver_
                    .solve(multiply_accurately(fom_.K, rigid).product,
                           ShiftedSolver::Verify::none)
                    .x,
                identity(null.columns));
  // Vectors that the stored K resists a little have become shorter.
  rigid = orthonormalise(std::move(rigid), known, {fom_.M, fom_.K, 0}, 1e-12).vectors;
  Dense of_null = inner(rigid, multiply_accurately(fom_.K, rigid).product);
  symmetrise(of_null);
  Dense stiffness(before + null.columns, before + null.columns);
  if (before > 0)
    set_part(stiffness, 0, 0, part_of(space_->rigid_stiffness(), 0, before, 0, before));
  set_part(stiffness, before, before, of_null);
  Block rest = combine(space_->V(), elastic); // Ritz vectors, which stay as they are
  add_product(rest, -1.0, rigid, inner(multiply(fom_.M, rigid), rest));
  space_ = std::make_unique<MediumSpace>(fom_, medium_.kappa, medium_.tau);
  space_->start_with_rigid_modes(before > 0 ? concatenate(known, rigid) : rigid.share(),
                                 std::move(stiffness), geometric_);
  space_->restore(std::move(rest));
}

/// Who says that the medium model may not be larger.
std::string MediumBuilder::why_no_larger() const {
  if (spec_.limit > 0) return "{medium_order}";
  return largest_order() < std::min<double>(2000.0, static_cast<double>(fom_.n))
             ? "what the memory allows that is free"
             : "{medium_order} allows more";
}

/// How exact the modes must be when the search ends. The certificate takes any, and the
/// Krylov blocks that follow improve them; where modes are asked for themselves, or stand
/// for H beside resonances without damping, they must be good.
double MediumBuilder::angle_of_modes() const {
  if (spec_.modes > 0 || exact_modes_) return 1e-6;
  const Damping& d = fom_.damping;
  const double loss = d.eta + d.alpha / medium_.cutoff + d.beta * medium_.cutoff;
  return loss < 1e-5 ? 1e-3 : 3.0;
}

/// All modes below the cutoff into the space; those without stiffness are rigid.
void MediumBuilder::search_modes() {
  int solves = 0;
  if (expected_ + geometric_ > largest_order())
    throw Error(text(
        "%d modes lie below the cutoff of %g Hz, more than a medium model of order %d "
        "can hold (%s): narrow {band_hz}, lower {cutoff}, or take {method} pod%s",
        expected_, medium_.cutoff * hz, largest_order(), why_no_larger().c_str(),
        expected_ > 1000 ? "; are the units of the body right?" : ""));
  if (expected_ > 0) {
    Stage stage(observer_, "modes");
    solves = find_modes(*space_, solver_, medium_.cutoff * medium_.cutoff, expected_,
                        angle_of_modes(), threshold_, observer_);
    medium_.solved_columns += solves;
    take_out_rigid_modes();
  }
  medium_.modes = expected_;
  inertia_is_safe_ = cutoff_is_in_a_gap();
  medium_.rigid = space_->rigid();
  if (medium_.rigid > 0 && fom_.D && spec_.relative_to == RelativeTo::elastic)
    refuse_elastic_part();
  std::string words = text("%d elastic below the cutoff of %.4g Hz, counted by inertia",
                           expected_, medium_.cutoff * hz);
  if (expected_ == 0 && medium_.rigid == 6)
    words += " (the band is in Hz, up to the first elastic modes or beyond?)";
  if (expected_ > 0) words += text(", all found (%d solves beside the ports)", solves);
  observer_.fact("modes", words);
  observer_.fact("rigid modes",
                 medium_.rigid == 0
                     ? "none"
                     : text("%d, %s, taken out analytically", medium_.rigid,
                            medium_.rigid == geometric_ ? "from the geometry"
                                                        : "from the null space of K"));
}

} // namespace flexgram
