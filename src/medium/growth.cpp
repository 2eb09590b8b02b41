/// Second half of `certify`: the norm of E = K − ω_c²M, certificates, growth by Krylov
/// blocks until the bound holds everywhere in the bands (docs/proof.md, sections 2 to 4).

#include "medium/builder.hpp"

#include "base/event.hpp"
#include "base/process.hpp"
#include "base/text.hpp"
#include "linalg/sparse_product.hpp"
#include "medium/error_over_band.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numeric>

namespace flexgram {

std::shared_ptr<const DenseResponse> MediumBuilder::ritz_response() const {
  DenseSystem system;
  system.M = space_->M();
  system.K = space_->K();
  system.D = space_->D();
  system.damping = fom_.damping;
  system.B = space_->projected_ports(loads_);
  system.C = system.B;
  return std::make_shared<DenseResponse>(std::move(system), medium_.tau);
}

/// K − ω_c²M, unless it still is what the solver holds: after a restart, or after slow
/// modes were sharpened.
void MediumBuilder::need_cutoff() {
  if (!cutoff_is_factorised_) {
    Stage stage(observer_, "cutoff");
    need_factors();
    factorise(-medium_.cutoff * medium_.cutoff);
    cutoff_is_factorised_ = true;
    inertia_is_safe_ = inertia_is_safe_ && solver_.null_pivots() == 0 &&
                       solver_.negative_pivots() == medium_.rigid + medium_.modes;
  }
}

/// Where rounding is looked at, and the error is not: at peaks too narrow for the grid, and where
/// it was found to be large.
std::vector<double> MediumBuilder::beside_grid() const {
  std::vector<double> peaks = rough_;
  for (const auto& [omega, half_width] : seen_->model().resonances)
    if (half_width > 1e-9 * omega && half_width <= 1e-7 * omega &&
        std::any_of(spec_.bands.begin(), spec_.bands.end(), [&](const Interval& band) {
          return band.first <= omega && omega <= band.last;
        }))
      peaks.push_back(omega);
  return peaks;
}

/// The largest bound of the level that is seen, on the grid.
void MediumBuilder::judge(MediumLevel& level) {
  const MediumModel& model = seen_->model();
  double worst = 0;
  bool proved = true;
  const std::size_t views = model.views.size();
  std::vector<double> largest(views, 0.0); // of ‖H‖, where that is meant
  std::vector<MediumModel::Stretch> values;
  // Of many ports, rough bounds are larger by twice the root of their number at most.
  const double hopeless =
      spec_.relative_to == RelativeTo::band
          ? HUGE_VAL
          : 2 * spec_.target * std::sqrt(static_cast<double>(loads_.columns()));
  // Beside undamped resonances, intervals decide.
  std::erase_if(grid_, [&](double omega) { return model.is_resonance(omega); });
  for (double omega : grid_) values.push_back(model.at(omega, hopeless));
  const auto size = [&](const MediumModel::Stretch& value, std::size_t v) {
    return value.size[v].below[0] - value.bounds[v].error;
  };
  if (spec_.relative_to == RelativeTo::band)
    for (const auto& value : values)
      for (std::size_t v = 0; v < views; ++v)
        if (value.bounds[v].proved) largest[v] = std::max(largest[v], size(value, v));
  double worst_omega = grid_.empty() ? 0 : grid_.front();
  floor_ = 0;
  const std::size_t on_grid = values.size();
  for (double omega : beside_grid()) values.push_back(model.at(omega, hopeless));
  for (std::size_t l = 0; l < values.size(); ++l)
    for (std::size_t v = 0; v < views; ++v) {
      const auto& value = values[l];
      const double known =
          model.views[v].allowed * (largest[v] > 0 ? largest[v] : size(value, v));
      proved = proved && (l >= on_grid || value.bounds[v].proved);
      const double relative = value.bounds[v].error / known,
                   error = known > 0 && std::isfinite(relative) ? relative : HUGE_VAL,
                   floor = value.bounds[v].floor / known;
      if (floor > floor_) floor_ = floor; // not NaN
      if (l >= on_grid) continue;
      if (error > worst) worst_omega = grid_[l];
      worst = std::max(worst, error);
    }
  // Dense work may differ in the last bit from rank to rank; decisions must not.
  std::vector<double> shared{worst, proved ? 1.0 : 0.0, worst_omega, floor_};
  share_from_first(fom_.comm, shared);
  floor_ = shared[3];
  level.worst = shared[0];
  level.proved = shared[1] > 0;
  worst_omega_ = shared[2];
}

/// What rounding may change beside what the level is good to. It is far less where sums with
/// twice the digits take no time worth naming.
double MediumBuilder::allowed_rounding(const MediumLevel& level) const {
  constexpr double little_work = 5e8, little = 2e-10;
  const double N = level.order(),
               work = 10 * static_cast<double>(fom_.nonzeros()) * N + 60 * N * N * N,
               allowed = 0.5 * std::max(spec_.target, std::min(level.worst, 1.0));
  return level.worst < 1 && work < little_work ? std::min(allowed, little) : allowed;
}

bool MediumBuilder::needs_sharper_sums(const MediumLevel& level) const {
  return level.complete && floor_ > allowed_rounding(level);
}

/// Ritz vectors whose energies are to be summed with twice the digits: what plain sums may have
/// lost of the others changes H by little beside what the level is good to. Few vectors matter
/// in a stiff body, at its resonances; slender ones lose digits in static responses too.
/// @param share_of_others  of what is allowed, that the others may lose among themselves.
SharpSums MediumBuilder::vectors_to_sharpen(const ProjectionRounding& rounding,
                                            double share_of_others) const {
  const double allowed = share_of_others * allowed_rounding(medium_.levels.back());
  const MediumModel& model = seen_->model();
  const DenseResponse& response = *plain_.response;
  const int N = medium_.levels.back().order();
  using Shares = std::vector<double>; // of the floor: roots of K's and M's, of the ports'
  std::array<Shares, 3> shares;
  shares.fill(Shares(static_cast<std::size_t>(N), 0.0));
  std::vector<double> grid = beside_grid();
  grid.insert(grid.end(), grid_.begin(), grid_.end());
  for (double omega : grid) {
    const MediumModel::Stretch value = model.at(omega, 0);
    const ComplexDense x = response.modal_response(omega);
    const double a_k = std::abs(response.system().coefficients(omega).k);
    for (std::size_t v = 0; v < model.blocks().size(); ++v) {
      const auto size = [&](int i, const std::vector<int>& ports) {
        double square = 0;
        for (int j : ports)
          square += std::norm(x(i, j)) /
                    std::pow(medium_.scale[static_cast<std::size_t>(j)], 2);
        return std::sqrt(square);
      };
      const auto off = [&](int i, const std::vector<int>& ports) {
        double square = 0;
        for (int j : ports)
          square += std::pow(
              rounding.ports(i, j) / medium_.scale[static_cast<std::size_t>(j)], 2);
        return std::sqrt(square);
      };
      const double known = model.views[v].allowed * value.size[v].below[0];
      for (int i = 0; i < N; ++i) {
        const auto at = static_cast<std::size_t>(i);
        const double in = size(i, model.blocks()[v].inputs),
                     out = size(i, model.blocks()[v].outputs),
                     moved = std::max(in, out) / std::sqrt(known);
        const auto of_mode = rounding.shares(at, a_k, omega);
        const double of_ports = off(i, model.blocks()[v].outputs) * in +
                                off(i, model.blocks()[v].inputs) * out;
        const std::array<double, 3> here{of_mode[0] * moved, of_mode[1] * moved,
                                         of_ports / known};
        for (std::size_t k = 0; k < 3; ++k)
          if (here[k] > shares[k][at]) shares[k][at] = here[k];
      }
    }
  }
  /// Modes but for the small shares, whose sum is `left_out` at most.
  const auto chosen = [&](Shares& of, int first, double left_out) {
    share_from_first(fom_.comm, of);
    std::vector<int> order(static_cast<std::size_t>(N - first));
    std::iota(order.begin(), order.end(), first);
    const auto share_of = [&](int i) { return of[static_cast<std::size_t>(i)]; };
    std::stable_sort(order.begin(), order.end(),
                     [&](int i, int j) { return share_of(i) < share_of(j); });
    double sum = 0;
    std::size_t left = 0;
    while (left < order.size() && sum + share_of(order[left]) <= left_out)
      sum += share_of(order[left++]);
    std::vector<int> those(order.begin() + static_cast<std::ptrdiff_t>(left),
                           order.end());
    std::sort(those.begin(), those.end());
    return those;
  };
  const std::vector<int> by_K =
                             chosen(shares[0], medium_.rigid, std::sqrt(0.7 * allowed)),
                         by_ports = chosen(shares[2], medium_.rigid, 0.1 * allowed);
  SharpSums result{{}, chosen(shares[1], 0, std::sqrt(0.2 * allowed))};
  std::set_union(by_K.begin(), by_K.end(), by_ports.begin(), by_ports.end(),
                 std::back_inserter(result.K));
  return result;
}

/// Whether the bound meets the target between the frequencies of the grid too; if not,
/// the grid gains a frequency where it does not.
bool MediumBuilder::holds_everywhere() {
  const auto spot = ErrorOverBand(*seen_, spec_.relative_to).weak_spot(spec_.target);
  std::vector<double> shared{spot.value_or(-1.0)};
  share_from_first(fom_.comm, shared);
  if (shared[0] < 0) return true;
  grid_.push_back(shared[0]);
  judge(medium_.levels.back());
  return false;
}

/// (−uᵀEu)^−½ uᵀg of the modes u below the cutoff, for each column g: the sum of their
/// squares is what gᵀE⁻¹g, E = K − ω_c²M, has less for them.
Dense MediumBuilder::along_modes(const DenseResponse& response, const Block& g) const {
  const Dense U = first_columns(response.U(), space_->rigid() + expected_);
  Dense along = multiply_transposed(U, inner(space_->V(), g));
  for (int j = 0; j < along.rows; ++j) {
    const double e = -response.energy(j, medium_.cutoff * medium_.cutoff);
    for (int i = 0; i < along.columns; ++i) along(j, i) /= std::sqrt(std::max(e, 1e-300));
  }
  return along;
}

/// TᵀE⁻¹T at least, E = K − ω_c²M, from one block solve X ≈ E⁻¹T, which is kept: with
/// F = T − E X it is TᵀX + XᵀF + FᵀE⁻¹F, and the last term is at most ‖F‖²/min |λ(E)|
/// in size.
ResidualNorm MediumBuilder::norm_of(const DenseResponse& response, const Block& T) {
  ResidualNorm norm;
  norm.of_rounding = of_rounding_;
  image_ = Block();
  if (T.columns() == 0) return norm;
  image_ = solver_.solve(T, ShiftedSolver::Verify::first_column).x;
  medium_.solved_columns += static_cast<int>(T.columns());
  const Dense one = identity(static_cast<int>(T.columns()));
  Block rest = copy(T); // F
  add_product(rest, -1.0, multiply(fom_.K, image_), one);
  add_product(rest, medium_.cutoff * medium_.cutoff, multiply(fom_.M, image_), one);
  norm.gram = inner(T, image_);
  const Dense correction = inner(image_, rest);
  add_to(norm.gram, correction);
  symmetrise(norm.gram);
  space_->scale(rest);
  const Dense left = inner(rest, rest);
  double trace = 0;
  for (int i = 0; i < left.rows; ++i) trace += left(i, i);
  const double most = trace / least_eigenvalue_; // of ± FᵀE⁻¹F, which has any sign
  for (int i = 0; i < left.rows; ++i) norm.gram(i, i) += most;
  norm.added = 2 * most;
  // What rounding left of the modes in T, where E⁻¹ is negative, is taken out again.
  const Dense along = along_modes(response, T);
  const Dense negative = multiply_transposed(along, along);
  add_to(norm.gram, negative);
  share_from_first(fom_.comm, norm.gram.data);
  return norm;
}

/// A lower bound of the least |λ| of E = K − ω_c²M, rows and columns scaled by the
/// diagonal of K + τM: ‖E⁻¹g‖ >= |gᵀv|/|λ| for its eigenvector v, and for entries of g
/// spread evenly over (−1, 1) |gᵀv| < t has a probability of √2 t at most (Ball 1986).
/// Eight vectors, t = 1/10: wrong once in six millions. And how large a random vector is
/// in E⁻¹ once its part along the modes below the cutoff is taken out, where E is positive.
void MediumBuilder::bound_least_eigenvalue(const DenseResponse& response) {
  constexpr double t = 0.1;
  Block g = random_block(fom_.B, 8, 77);
  space_->unscale(g);
  Block x = solver_.solve(g).x;
  Dense energy = inner(g, x);
  const Dense along = along_modes(response, g);
  for (int i = 0; i < 8; ++i)
    for (int j = 0; j < along.rows; ++j) energy(i, i) += along(j, i) * along(j, i);
  space_->unscale(x);
  const Dense size = inner(x, x);
  double largest = 0, longest = 0;
  for (int i = 0; i < 8; ++i) {
    largest = std::max(largest, energy(i, i));
    longest = std::max(longest, size(i, i));
  }
  // gᵀE⁻¹g is a third of the trace of E⁻¹ on average: what a random vector of norm 1 has
  // in E⁻¹ is the n-th part of the trace. Ten times that for safety.
  std::vector<double> shared{t / std::sqrt(longest),
                             std::sqrt(30 * largest / static_cast<double>(fom_.n))};
  share_from_first(fom_.comm, shared);
  least_eigenvalue_ = shared[0];
  of_rounding_ = shared[1];
}

/// The certificate of the last level, with what rounding may do to it.
void MediumBuilder::certify_level(ProjectionRounding rounding,
                                  const ResidualBasis& parts) {
  MediumLevel& last = medium_.levels.back();
  last.certificate = std::make_shared<Certificate>(
      *space_, *last.response, parts, plain_.norm, std::move(rounding), plain_.modes,
      inertia_is_safe_, medium_.cutoff, medium_.scale);
  look_at(medium_.levels.size() - 1);
  judge(last);
}

/// The last level again, with twice the digits for the energies of the vectors that need them.
/// What the others lose meets the forces of these, so more of them may be needed than it seems.
/// @return whether there are others.
bool MediumBuilder::sharpen_sums() {
  static Event event("SharpenEnergies");
  const auto timed = event.timed();
  MediumLevel& last = medium_.levels.back();
  const ProjectionRounding sums = rounding_of_sums(*space_, *plain_.response, loads_);
  const auto all = static_cast<std::size_t>(2 * last.order() - medium_.rigid);
  std::size_t before = 0;
  for (const double share : {1.0, 3e-2, 1e-3}) {
    const SharpSums chosen = vectors_to_sharpen(sums, share);
    const std::size_t count = chosen.K.size() + chosen.M.size();
    if (count == before && share < 1) continue;
    before = count;
    SharpResponse sharp = sharpened(*space_, *plain_.response, sums, loads_, chosen);
    last.response = std::move(sharp.response);
    const ResidualBasis& plain = plain_.parts;
    ResidualBasis parts{Block(),         plain.ports,          plain.K,
                        plain.D,         plain.damped_outside, plain.dropped_ports,
                        plain.dropped_K, plain.dropped_D,      plain.complete};
    turn_residual(parts, sharp.turned, *last.response, medium_.kappa, medium_.cutoff);
    certify_level(std::move(sharp.rounding), parts);
    if (before == all || !needs_sharper_sums(last)) break;
  }
  observer_.detail(
      text("  %zu of %zu energies summed with twice the digits: rounding %.1e of "
           "H at most where it was looked at",
           before, all, floor_));
  sharpened_sums_ = static_cast<int>(before);
  return before < all;
}

void MediumBuilder::sharpen_if_needed() {
  if (sharpened_sums_ == 0 && plain_.response &&
      needs_sharper_sums(medium_.levels.back()))
    sharpen_sums();
}

/// Sharper sums where the grid did not show that they are needed: at zeros of H.
void MediumBuilder::sharpen_between() {
  if (!plain_.response) return; // of a checkpoint
  MediumLevel& last = medium_.levels.back();
  // Claims have room for more than the grid is held to.
  const double allowed = std::max(10 * allowed_rounding(last), 5e-11);
  for (int look = 0; look < 4; ++look) {
    std::vector<double> spots =
        ErrorOverBand(*seen_, spec_.relative_to).rounding_spots(allowed);
    share_list(fom_.comm, spots);
    if (spots.empty()) return;
    rough_.insert(rough_.end(), spots.begin(), spots.end());
    judge(last);
    if (!needs_sharper_sums(last)) return;
    const double before = floor_;
    if (!sharpen_sums() || floor_ > 0.5 * before) return;
  }
}

/// The bound of the space as it is, with one block solve: a level, in the place of an
/// incomplete one of the same order.
void MediumBuilder::prove(int most_columns) {
  need_cutoff();
  MediumLevel level;
  level.response = ritz_response();
  if (least_eigenvalue_ == 0) bound_least_eigenvalue(*level.response);
  if (!space_->tracks_residual()) space_->track_residual(loads_);
  // By Weyl a backward error of that size could have moved an eigenvalue of E across zero.
  inertia_is_safe_ =
      inertia_is_safe_ && least_eigenvalue_ > 16 * std::numeric_limits<double>::epsilon();
  std::vector<double> samples;
  const std::size_t step = std::max<std::size_t>(1, grid_.size() / 24);
  for (std::size_t l = 0; l < grid_.size(); l += step)
    if (!level.response->is_resonance(grid_[l])) samples.push_back(grid_[l]);

  const int modes = space_->rigid() + expected_;
  ResidualBasis parts = residual_basis(*space_, *level.response, samples, modes,
                                       medium_.cutoff, most_columns);
  level.complete = parts.complete;
  const Block T = std::move(parts.T);
  // A wide block brings more than is needed.
  const bool wide = parts.complete && T.columns() > wide_block;
  plain_ = {level.response, std::move(parts), norm_of(*level.response, T), modes};
  auto& levels = medium_.levels;
  if (!levels.empty() && levels.back().order() == level.order()) levels.pop_back();
  if (!spec_.keep_levels) levels.clear();
  levels.push_back(std::move(level));
  rough_.clear();
  sharpened_sums_ = 0;
  certify_level(plain_rounding(*space_, *levels.back().response, loads_), plain_.parts);
  const double worst = levels.back().worst, worst_omega = worst_omega_;
  // A level that is neither kept nor the last one is needed for growing alone.
  if (spec_.keep_levels || levels.back().serves(spec_.target)) sharpen_if_needed();
  worst_omega_ = worst_omega; // what is grown does not hang on which levels are kept
  if (block_was_cut_ && worst > 0.5 * worst_before_) cut_blocks_ = false;
  worst_before_ = worst;
  block_was_cut_ = wide && cut_blocks_ && worst > spec_.target;
  if (block_was_cut_) {
    samples.push_back(worst_omega_);
    for (std::size_t l = grid_.size(); l-- > 0 && grid_.size() - l <= 8;)
      samples.push_back(grid_[l]); // where it was found to be weak
    Dense chosen = directions_to_grow(plain_.parts, plain_.norm.gram, *plain_.response,
                                      samples, seen_->model().blocks(), medium_.scale,
                                      medium_.kappa, medium_.cutoff, modes,
                                      seen_->model().left_out(), 0.3 * spec_.target);
    share_list(fom_.comm, chosen.data);
    chosen.columns = static_cast<int>(chosen.data.size()) / std::max(chosen.rows, 1);
    image_ = combine(image_, chosen);
  }
}

void MediumBuilder::look_at(std::size_t level) {
  const bool to_band = spec_.relative_to == RelativeTo::band; // the largest |H| is needed
  seen_ = std::make_unique<MediumOverBand>(
      MediumModel(medium_, level, find_ports(medium_.body, {}, {}), spec_.kinds,
                  spec_.relative_to),
      spec_.bands, to_band ? grid_ : std::vector<double>());
}

void MediumBuilder::grow() {
  if (medium_.levels.empty() ||
      medium_.levels.back().order() < space_->columns()) // else it may not be needed
    need_cutoff();
  Stage stage(observer_, "krylov");
  const int limit = largest_order();
  const double target = spec_.target;
  const int usual = 3 * static_cast<int>(loads_.columns());
  double previous = HUGE_VAL;
  int stalled = 0;
  const auto count = [&](double worst) {
    stalled = worst > 0.5 * previous ? stalled + 1 : 0;
    previous = std::min(previous, worst);
  };
  double told = now();
  const auto level = [&]() -> const MediumLevel& { return medium_.levels.back(); };
  if (!medium_.levels.empty()) {                              // of a checkpoint
    for (std::size_t k = 0; k < medium_.levels.size(); ++k) { // by what is asked now
      look_at(k);
      judge(medium_.levels[k]);
      if (k + 1 < medium_.levels.size()) count(medium_.levels[k].worst);
    }
  }
  for (;;) {
    if (medium_.levels.empty() || level().order() < space_->columns()) {
      prove(usual);
      if (!level().complete && level().worst <= target) prove(space_->columns() * 3);
      save("a level");
    }
    const std::string line = text(
        "  krylov: order %d, certified %.2e of %.0e, modes within %.0e",
        space_->columns(), level().worst, target, level().certificate->worst_angle());
    if (now() - told > 2.0)
      observer_.say(line);
    else
      observer_.detail(line);
    told = now();
    // Modes that are not exact enough for the proof gain from a block; strong dampers do
    // not.
    if (level().serves(target) && holds_everywhere()) {
      sharpen_between();
      medium_.shortfall.clear();
      return;
    }
    count(level().worst);
    if (stalled >= 3) {
      medium_.shortfall = "more vectors do not lower the bound";
      break;
    }
    if (!image_ ||
        std::min<PetscInt>(fom_.n, space_->columns() + image_.columns()) > limit) {
      medium_.shortfall =
          text("the largest order of the medium model, %d, is reached (%s)", limit,
               why_no_larger().c_str());
      break;
    }
    const int before = space_->columns();
    space_->append(std::move(image_), 1e-7);
    if (space_->columns() == before) {
      medium_.shortfall = "the solves add nothing new to the space";
      break;
    }
    ++blocks_;
  }
  if (!level().complete) prove(space_->columns() * 3);
  sharpen_if_needed();
}

void MediumBuilder::report() {
  count_factorisations();
  const MediumLevel& level = medium_.levels.back();
  const double target = spec_.target;
  observer_.fact(
      "medium model",
      text("order %d, %d factorisations (real), %d solved columns, %d Krylov blocks at "
           "ω_c² after the ports'",
           space_->columns(), medium_.factorisations, medium_.solved_columns, blocks_));
  if (solver_.fell_back())
    observer_.fact("fall-back",
                   "refinement of single precision stalled: double precision");
  const char* const what = resolved(spec_.relative_to, medium_) == RelativeTo::elastic
                               ? "H without rigid motion"
                           : resolved(spec_.relative_to, medium_) == RelativeTo::both
                               ? "H and of H without rigid motion"
                               : "H";
  // Without rounding, which the claim of the small model includes.
  observer_.fact(
      "medium error",
      medium_.shortfall.empty()
          ? text("at most %.0e of %s everywhere in the band%s%s (%.1e at the frequencies "
                 "it grew by)",
                 target, what,
                 medium_.has_sharp_resonances() ? " but beside undamped resonances" : "",
                 level.proved ? "" : ", estimated", level.worst)
          : text("%.1e of %s at the frequencies it grew by, target %.0e not reached: %s",
                 level.worst, what, target, medium_.shortfall.c_str()));
  observer_.skip("complex factorisations", "real shifts span the band");
  if (medium_.shortfall.empty())
    observer_.skip("further Krylov blocks", "the bound does not ask for them");
  else
    observer_.warn(text("the medium model is good to %.1e only, not to %.0e: %s",
                        level.worst, target, medium_.shortfall.c_str()));
  if (!level.proved)
    observer_.warn(
        fom_.D ? "the damping is so strong and local (q δ >= 1) that the error is "
                 "estimated, not proved; a higher {cutoff} helps"
               : "the modes below the cutoff are not known well enough for a proof: the "
                 "error is estimated; a higher {medium_order} helps");
}

} // namespace flexgram
