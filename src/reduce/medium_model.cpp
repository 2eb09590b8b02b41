#include "reduce/medium_builder.hpp"

#include "base/process.hpp"
#include "base/text.hpp"
#include "linalg/sparse_product.hpp"
#include "model/rigid_body_modes.hpp"
#include "reduce/band_gramian.hpp"
#include "reduce/error_over_band.hpp"
#include "reduce/mode_search.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <numeric>

namespace flexgram {
namespace {
constexpr double hz = 0.5 / std::numbers::pi;
} // namespace

void MediumOptions::describe(Options& options) {
  options.section("Medium model (every method but pod)");
  options.add(
      "-mor_cutoff", cutoff, "",
      "all modes up to this many times the end of the band are found and counted; more "
      "modes, but fewer Krylov blocks");
  options.add("-mor_medium_order", limit, "",
              "largest order of the medium model; 0: what memory and the body allow");
  options.add(
      "-mor_medium_tol", target, "",
      "certified relative error of the medium model; 0: a fiftieth of -mor_tol, or 1e-8 "
      "where the order is given or ruled");
  options.add_choice(
      "-mor_tol_relative_to", relative_to, {"pointwise", "band"},
      "what errors of H are divided by: |H| at the same frequency (eq. 17; near an "
      "antiresonance, where H itself vanishes, the order grows to meet it), or the "
      "largest "
      "|H| over the band, which forgives such frequencies");
}

RelativeTo MediumOptions::relative() const {
  return relative_to == "band" ? RelativeTo::band : RelativeTo::pointwise;
}

void MediumOptions::check() const {
  require_option(cutoff >= 1.05, "-mor_cutoff", text("%g", cutoff), "1.05 or more");
  require_option(limit >= 0, "-mor_medium_order", std::to_string(limit),
                 "0 (automatic) or more");
  require_option(target >= 0 && target < 1, "-mor_medium_tol", text("%g", target),
                 "0 (automatic) or below 1");
}

std::optional<MediumModel::Stretch> MediumModel::over(Interval interval,
                                                      int degree) const {
  const auto x = response_series(*response_, interval, degree);
  if (!x) return std::nullopt;
  const MatrixSeries all = multiply_transposed(modal_outputs_, x->x);
  const int n_out = all.rows(), n_in = static_cast<int>(inputs_.size()),
            parts = 2 * (all.degree() + 1);
  Stretch stretch{{n_in, Dense(n_out, n_in * parts), Dense(n_out, n_in)},
                  certificate_.over(*response_, *x, blocks_)};
  for (int j = 0; j < n_in; ++j) {
    const int port = inputs_[static_cast<std::size_t>(j)];
    const double scale = 1 / scale_[static_cast<std::size_t>(port)];
    for (int i = 0; i < n_out; ++i) {
      for (int part = 0; part < parts; ++part)
        stretch.H.coefficients(i, n_in * part + j) =
            scale * all.coefficients(i, all.columns * part + port);
      stretch.H.tail(i, j) = scale * all.tail(i, port);
    }
  }
  return stretch;
}

MediumModel::Value MediumModel::at(double omega) const {
  auto here = over({omega, omega}, 0);
  if (!here) throw ShiftError("the body is undamped and the frequency is a resonance");
  return {here->H.centre(), std::move(here->bounds)};
}

std::vector<Resonance> MediumBuilder::resonances() const {
  const RitzPairs pairs = ritz_pairs(*space_);
  std::vector<Resonance> result;
  for (int j = 0; j < expected_; ++j) {
    const double l = std::max(pairs.lambda[static_cast<std::size_t>(j)], 0.0),
                 omega = std::sqrt(l);
    double d = fom_.damping.alpha + fom_.damping.beta * l + fom_.damping.eta * omega;
    if (fom_.D) {
      const Dense u = part_of(pairs.vectors, 0, pairs.vectors.rows, j, 1);
      d += multiply_transposed(u, multiply(space_->D(), u))(0, 0) /
           multiply_transposed(u, multiply(space_->M(), u))(0, 0);
    }
    result.push_back({omega, 0.5 * d});
  }
  return result;
}

void MediumBuilder::factorise_norm() {
  const ShiftCoefficients shift{1.0, model_.tau, 0.0};
  ++model_.factorisations;
  solver_.factorise(shift, Definiteness::positive); // in the place of the last factors
  if (solver_.null_pivots() > 0 || solver_.negative_pivots() > 0)
    throw Error(
        text("K + τM is not positive definite (%d null, %d negative eigenvalues): the "
             "body has a mechanism without mass and stiffness, or K is indefinite",
             solver_.null_pivots(), solver_.negative_pivots()));
}

/// The largest bound on the grid.
void MediumBuilder::judge() {
  double worst = 0;
  model_.proved = true;
  std::vector<double> largest(model_.views.size(), 0.0); // of ‖H‖, where that is meant
  std::vector<MediumModel::Value> values;
  for (double omega : grid_) values.push_back(model_.at(omega));
  const auto size = [&](const MediumModel::Value& value, std::size_t v) {
    return frobenius_norm(model_.views[v].of(value.H)) - value.bounds[v].error;
  };
  if (options_.relative() == RelativeTo::band)
    for (const auto& value : values)
      for (std::size_t v = 0; v < largest.size(); ++v)
        largest[v] = std::max(largest[v], size(value, v));
  for (const auto& value : values)
    for (std::size_t v = 0; v < largest.size(); ++v) {
      const double known = largest[v] > 0 ? largest[v] : size(value, v);
      model_.proved = model_.proved && value.bounds[v].proved;
      worst = std::max(worst, known > 0 ? value.bounds[v].error / known : HUGE_VAL);
    }
  // Dense work may differ in the last bit from rank to rank; decisions must not.
  std::vector<double> shared{worst, model_.proved ? 1.0 : 0.0};
  share_from_first(fom_.comm, shared);
  model_.worst = shared[0];
  model_.proved = shared[1] > 0;
}

/// Whether the bound meets the target between the frequencies of the grid too; if not,
/// the grid gains a frequency where it does not.
bool MediumBuilder::holds_everywhere(double target) {
  model_.resonances = resonances();
  const bool to_band =
      options_.relative() == RelativeTo::band; // the largest |H| is needed
  ErrorOverBand errors(model_, bands_, to_band ? grid_ : std::vector<double>(),
                       options_.relative());
  const auto spot = errors.weak_spot(target);
  std::vector<double> shared{spot.value_or(-1.0)};
  share_from_first(fom_.comm, shared);
  if (shared[0] < 0) return true;
  grid_.push_back(shared[0]);
  judge();
  return false;
}

/// TᵀE⁻¹T at least, E = K + τM, from one block solve X ≈ E⁻¹T, which is kept: with
/// F = T − E X it is TᵀX + XᵀF + FᵀE⁻¹F, and the last term is at most ‖F‖²/λ_min(E).
ResidualNorm MediumBuilder::norm_of(const Block& T) {
  ResidualNorm norm;
  norm.of_rounding = of_rounding_;
  image_ = Block();
  if (T.columns() == 0) return norm;
  image_ = solver_.solve(T, ShiftedSolver::Verify::first_column).x;
  model_.solved_columns += static_cast<int>(T.columns());
  Block rest = copy(T); // F
  add_product(rest, -1.0, multiply(fom_.K, image_),
              identity(static_cast<int>(T.columns())));
  add_product(rest, -model_.tau, multiply(fom_.M, image_),
              identity(static_cast<int>(T.columns())));
  norm.gram = inner(T, image_);
  const Dense correction = inner(image_, rest);
  for (std::size_t i = 0; i < norm.gram.data.size(); ++i)
    norm.gram.data[i] += correction.data[i];
  symmetrise(norm.gram);
  space_->scale(rest);
  const Dense left = inner(rest, rest);
  double trace = 0;
  for (int i = 0; i < left.rows; ++i) trace += left(i, i);
  norm.added = trace / least_eigenvalue_;
  for (int i = 0; i < left.rows; ++i) norm.gram(i, i) += norm.added;
  share_from_first(fom_.comm, norm.gram.data);
  return norm;
}

/// A lower bound of the least eigenvalue λ of E, rows and columns scaled to a unit
/// diagonal: gᵀE⁻¹g >= (gᵀv)²/λ for its eigenvector v, and for entries of g spread evenly
/// over (−1, 1) |gᵀv| < t has a probability of √2 t at most (Ball 1986). Eight vectors,
/// t = 1/10: wrong once in six millions.
void MediumBuilder::bound_least_eigenvalue() {
  constexpr double t = 0.1;
  Block g = random_block(fom_.B, 8, 77);
  space_->unscale(g);
  const Dense energy = inner(g, solver_.solve(g).x);
  double largest = 0;
  for (int i = 0; i < energy.rows; ++i) largest = std::max(largest, energy(i, i));
  // gᵀE⁻¹g is a third of the trace of E⁻¹ on average: what a random vector of norm 1 has
  // in E⁻¹ is the n-th part of the trace. Ten times that for safety.
  std::vector<double> shared{t * t / largest,
                             std::sqrt(30 * largest / static_cast<double>(fom_.n))};
  share_from_first(fom_.comm, shared);
  least_eigenvalue_ = shared[0];
  of_rounding_ = shared[1];
}

/// The bound of the space as it is, with one block solve.
void MediumBuilder::certify(int most_columns) {
  DenseSystem system;
  system.M = space_->M();
  system.K = space_->K();
  system.D = space_->D();
  system.damping = fom_.damping;
  system.B = inner(space_->V(), loads_);
  system.C = system.B;
  model_.response_ = std::make_shared<DenseResponse>(std::move(system), model_.tau);
  std::vector<double> samples;
  const std::size_t step = std::max<std::size_t>(1, grid_.size() / 24);
  for (std::size_t l = 0; l < grid_.size(); l += step) samples.push_back(grid_[l]);

  const int modes = space_->rigid() + expected_;
  model_.lambda.assign(model_.response_->lambda().begin() + space_->rigid(),
                       model_.response_->lambda().begin() + modes);
  ResidualBasis basis = residual_basis(*space_, *model_.response_, samples, modes,
                                       model_.cutoff, most_columns);
  complete_ = basis.complete;
  basis.complete = basis.complete && inertia_is_safe_;
  const ResidualNorm norm = norm_of(basis.T);
  model_.certificate_ = Certificate(*space_, *model_.response_, std::move(basis), norm,
                                    modes, model_.cutoff, model_.scale_);
  model_.modal_outputs_ =
      Dense(space_->columns(), static_cast<int>(model_.outputs_.size()));
  for (int i = 0; i < model_.modal_outputs_.columns; ++i) {
    const int port = model_.outputs_[static_cast<std::size_t>(i)];
    for (int l = 0; l < model_.modal_outputs_.rows; ++l)
      model_.modal_outputs_(l, i) = model_.response_->modal_inputs()(l, port) /
                                    model_.scale_[static_cast<std::size_t>(port)];
  }
  judge();
}

void MediumBuilder::grow(double target) {
  Stage stage(monitor_, "krylov");
  const int limit = largest_order();
  space_->track_residual(loads_);
  const int usual = 3 * static_cast<int>(loads_.columns());
  double previous = HUGE_VAL;
  for (int stalled = 0;;) {
    certify(usual);
    if (!complete_ && model_.worst <= target) certify(space_->columns() * 3);
    monitor_.detail(text("  krylov: order %d, certified %.2e, modes within %.0e",
                         space_->columns(), model_.worst,
                         model_.certificate_.worst_angle()));
    // Modes that are not exact enough for the proof gain from a block; strong dampers do
    // not.
    if (complete_ && model_.worst <= target &&
        (model_.proved || model_.worst <= 1e-3 * target) && holds_everywhere(target))
      return;
    stalled = model_.worst > 0.5 * previous ? stalled + 1 : 0;
    previous = std::min(previous, model_.worst);
    if (stalled >= 3) {
      end_ = "more vectors do not lower the bound";
      break;
    }
    if (!image_ || space_->columns() + static_cast<int>(image_.columns()) > limit) {
      end_ = text("the largest order of the medium model, %d, is reached", limit);
      break;
    }
    const int before = space_->columns();
    space_->append(std::move(image_), 1e-7);
    if (space_->columns() == before) {
      end_ = "the solves add nothing new to the space";
      break;
    }
    ++blocks_;
  }
  if (!complete_) certify(space_->columns() * 3);
}

void MediumBuilder::report(double target) {
  plan_.fact(
      "medium model",
      text(
          "order %d, %d factorisations (real), %d solved columns, %d Krylov blocks at -τ "
          "after the ports' at ω_c²",
          space_->columns(), model_.factorisations, model_.solved_columns, blocks_));
  // Without rounding, which the claim of the small model includes.
  plan_.fact(
      "medium error",
      end_.empty()
          ? text("at most %.0e of H everywhere in the band%s (%.1e at the frequencies "
                 "it grew by)",
                 target, model_.proved ? "" : ", estimated", model_.worst)
          : text("%.1e of H at the frequencies it grew by, target %.0e not reached: %s",
                 model_.worst, target, end_.c_str()));
  plan_.skip("complex factorisations", "real shifts span the band");
  if (end_.empty())
    plan_.skip("further Krylov blocks", "the bound does not ask for them");
  if (!end_.empty())
    monitor_.warn(text("the medium model is good to %.1e only, not to %.0e: %s",
                       model_.worst, target, end_.c_str()));
  if (!model_.proved)
    monitor_.warn(
        fom_.D ? "the damping is so strong and local (q δ >= 1) that the error is "
                 "estimated, not proved; a higher -mor_cutoff helps"
               : "the modes below the cutoff are not known well enough for a proof: the "
                 "error is estimated; a higher -mor_medium_order helps");
}

MediumModel MediumBuilder::build(const std::vector<Interval>& bands, double last_needed,
                                 int modes_wanted, bool mass_is_singular, double target) {
  bands_ = bands;
  const double first = bands.front().first, last = bands.back().last;
  double reference = std::max(last, last_needed);
  if (reference == 0) reference = std::sqrt(1e-9 * eigenvalue_scale(fom_)); // statics
  model_.tau = 0.25 * reference * reference;
  modes_exact_ = modes_wanted > 0;
  {
    Stage stage(monitor_, "cutoff");
    find_rigid_modes();
    if (first == 0 && geometric_ > 0)
      throw Error("the band starts at 0 Hz, where a free body has no finite response: "
                  "-mor_band_hz must start above");
    Block response = start(options_.cutoff * reference, modes_wanted, mass_is_singular);
    scale_ports(response);
    space_ = std::make_unique<MediumSpace>(fom_, model_.kappa, model_.tau);
    space_->start_with_rigid_modes(std::move(rigid_modes_), rigid_stiffness_);
    space_->append(std::move(response), 1e-7);
  }
  search_modes();
  if (first == 0 && model_.rigid > 0)
    throw Error("the band starts at 0 Hz, where a free body has no finite response: "
                "-mor_band_hz must start above");
  {
    Stage stage(monitor_, "norm");
    factorise_norm();
    bound_least_eigenvalue();
  }
  for (const Interval& band : bands) {
    const auto part = band_grid(band.first, band.last,
                                120 / static_cast<int>(bands.size()), resonances());
    grid_.insert(grid_.end(), part.begin(), part.end());
  }
  grow(target);
  report(target);
  model_.loss_of_orthogonality = loss_of_orthogonality(space_->V(), space_->WV());
  model_.system = model_.response_->system();
  Dense B(space_->columns(), static_cast<int>(model_.inputs_.size())),
      C(space_->columns(), static_cast<int>(model_.outputs_.size()));
  for (int j = 0; j < B.columns; ++j)
    for (int i = 0; i < B.rows; ++i)
      B(i, j) = model_.system.B(i, j) / model_.scale_[static_cast<std::size_t>(j)];
  for (int j = 0; j < C.columns; ++j) {
    const int port = model_.outputs_[static_cast<std::size_t>(j)];
    for (int i = 0; i < C.rows; ++i)
      C(i, j) = model_.system.B(i, port) / model_.scale_[static_cast<std::size_t>(port)];
  }
  model_.system.B = std::move(B);
  model_.system.C = std::move(C);
  model_.system.outputs_are_inputs = fom_.outputs_are_inputs;
  model_.resonances = resonances();
  if (fom_.D && space_->columns() <= 250) { // strong dampers move the peaks
    model_.resonances.clear();
    for (const auto& pole : poles(*model_.response_, 0))
      if (pole.real() > 0 && pole.real() < model_.cutoff && pole.imag() < pole.real())
        model_.resonances.push_back({pole.real(), std::max(pole.imag(), 0.0)});
  }
  std::vector<double> peaks{static_cast<double>(model_.resonances.size())};
  share_from_first(fom_.comm, peaks); // decisions about intervals must not differ
  model_.resonances.resize(static_cast<std::size_t>(peaks[0]));
  peaks.clear();
  for (const auto& [omega, half_width] : model_.resonances)
    peaks.insert(peaks.end(), {omega, half_width});
  share_from_first(fom_.comm, peaks);
  for (std::size_t i = 0; i < model_.resonances.size(); ++i)
    model_.resonances[i] = {peaks[2 * i], peaks[2 * i + 1]};
  model_.V = space_->V().share();
  return std::move(model_);
}

MediumModel medium_model(const SecondOrderModel& fom, const std::vector<Interval>& bands,
                         double last_needed, int modes_wanted, bool mass_is_singular,
                         const MediumOptions& options, double target,
                         const SolverOptions& solver, Plan& plan, Monitor& monitor) {
  return MediumBuilder(fom, options, solver, plan, monitor)
      .build(bands, last_needed, modes_wanted, mass_is_singular, target);
}

} // namespace flexgram
