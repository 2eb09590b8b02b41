#include "sampling/frequency_solves.hpp"

#include "base/index.hpp"
#include "base/process.hpp"
#include "base/text.hpp"
#include "io/body_io.hpp"
#include "io/kept_rows.hpp"
#include "linalg/sparse_product.hpp"
#include "model/rigid_body_modes.hpp"

#include <algorithm>
#include <bit>
#include <filesystem>
#include <optional>

namespace flexgram {

namespace {

/// Most groups of equal size whose factors fit beside each other.
int fitting_groups(MPI_Comm world, const FactorEstimate& whole, double matrices_mb,
                   double samples_mb, double limit_mb, int tasks) {
  const int size = comm_size(world);
  for (int groups = std::min(size, tasks); groups > 1; --groups) {
    if (size % groups != 0) continue;
    const double ranks = static_cast<double>(size) / groups;
    // A factorisation over r ranks takes somewhat more than 1/r of the memory on each.
    const double per_rank =
        1.3 * whole.mb_total / ranks + 2 * matrices_mb * groups + 2 * samples_mb;
    if (max_over(world, per_rank - 0.8 * limit_mb) <= 0) return groups;
  }
  return 1;
}

/// X of a damped body is [Re, Im] at every frequency; at ω = 0 it comes real.
Block with_imaginary_part(const Block& x, const SecondOrderModel& model) {
  const PetscInt p = model.B.columns();
  if (x.columns() == 2 * p) return x.share();
  Block both(x.comm(), x.local_rows(), x.rows(), 2 * p);
  const Block::Access from(x);
  Block::Access to(both);
  std::copy_n(from.column(0), x.local_rows().size() * p, to.column(0));
  std::fill_n(to.column(p), x.local_rows().size() * p, 0.0);
  return both;
}

} // namespace

struct FrequencySolves::State {
  void separate_rigid_modes(const SolverOptions& options);
  Block response(double omega, const Block& elastic) const;
  std::string file_of(double omega) const;
  std::optional<Block> kept(double omega) const;
  void keep(double omega, const Block& x, bool end) const;

  CheckpointSpec checkpoint;
  double start = now();

  Observer* observer;
  std::unique_ptr<Groups> groups;
  RowRange world_rows;
  SecondOrderModel model;
  std::unique_ptr<ShiftedSolver> solver;
  FactorEstimate estimate;
  Block rigid, weighted_rigid, elastic_loads; ///< Φ, MΦ, B − MΦΦᵀB of a free body
  Dense resultants;                           ///< ΦᵀB
  double worst_backward_error = 0, target_backward_error = 0;
};

/// The response of a free body is the sum of its rigid and its elastic part. Together,
/// the rounding of K on the rigid modes, amplified by ‖K‖/(ω²‖M‖), would spoil low
/// frequencies; apart, the rigid part is exact. A damper to ground couples the two, so
/// only without terms.
void FrequencySolves::State::separate_rigid_modes(const SolverOptions& options) {
  elastic_loads = model.B.share();
  if (!model.terms.empty()) return;
  rigid =
      has_coordinates(model) ? rigid_body_modes(model) : null_space_modes(model, options);
  if (rigid.columns() == 0) return;
  weighted_rigid = multiply(model.M, rigid);
  resultants = inner(rigid, model.B);
  elastic_loads = copy(model.B);
  add_product(elastic_loads, -1.0, weighted_rigid, resultants);
}

Block FrequencySolves::State::response(double omega, const Block& elastic) const {
  const Block x =
      model.undamped() ? elastic.share() : with_imaginary_part(elastic, model);
  if (rigid.columns() == 0) return x.share();
  const std::complex<double> a = model.coefficients(omega).m;
  if (a == 0.0) throw ShiftError("a free body has no finite response at 0 Hz");
  Block sum = copy(x);
  add_product(sum, -1.0, rigid, inner(weighted_rigid, x));
  Dense amplitudes(resultants.rows, static_cast<int>(x.columns()));
  for (int j = 0; j < amplitudes.columns; ++j)
    for (int i = 0; i < amplitudes.rows; ++i) {
      const auto value = resultants(i, j % resultants.columns) / a;
      amplitudes(i, j) = j < resultants.columns ? value.real() : value.imag();
    }
  add_product(sum, 1.0, rigid, amplitudes);
  return sum;
}

FrequencySolves::FrequencySolves(SecondOrderModel model, int groups,
                                 const SolverOptions& solver, int tasks,
                                 double samples_mb, Observer& observer)
    : state_(std::make_unique<State>()) {
  State& s = *state_;
  Stage stage(observer, "analyse");
  s.observer = &observer;
  s.target_backward_error = solver.backward_error;
  s.world_rows = model.rows;
  const MPI_Comm world = model.comm;
  const bool real = model.undamped();
  SolverOptions how = solver;
  if (how.mumps.ordering == Ordering::automatic && tasks > 2)
    how.mumps.ordering = Ordering::best;
  const auto prepare = [&] {
    s.solver = std::make_unique<ShiftedSolver>(
        s.model.K, s.model.M, s.model.term_matrices(), s.model.node, how,
        is_symmetric(s.model.terms) ? MatrixKind::symmetric : MatrixKind::general);
    s.estimate = s.solver->analyse(real);
  };
  int count = groups;
  s.model = std::move(model);
  if (count == 0 && comm_size(world) > 1 && tasks > 1) {
    prepare();
    count = fitting_groups(world, s.estimate, s.model.memory_mb(), samples_mb,
                           solver.mumps.memory_limit_mb, tasks);
  }
  s.groups = std::make_unique<Groups>(world, std::max(count, 1));
  if (s.groups->count > 1) {
    s.solver.reset();
    s.model = move_to_group(std::move(s.model), *s.groups);
  }
  if (!s.solver) prepare();
  s.separate_rigid_modes(solver);
}

FrequencySolves::~FrequencySolves() = default;
FrequencySolves::FrequencySolves(FrequencySolves&&) noexcept = default;

std::vector<std::size_t> FrequencySolves::mine(std::size_t count) const {
  std::vector<std::size_t> list;
  for (auto l = as_size(state_->groups->mine); l < count;
       l += as_size(state_->groups->count))
    list.push_back(l);
  return list;
}

void FrequencySolves::keep(const CheckpointSpec& checkpoint) {
  state_->checkpoint = checkpoint;
}

/// A file by the frequency's bits: the same number, the same file.
std::string FrequencySolves::State::file_of(double omega) const {
  return text("%s/%016llx.h5", checkpoint.path.c_str(),
              static_cast<unsigned long long>(std::bit_cast<std::uint64_t>(omega)));
}

std::optional<Block> FrequencySolves::State::kept(double omega) const {
  if (!checkpoint.restart || checkpoint.path.empty()) return std::nullopt;
  const std::string path = file_of(omega);
  std::error_code ignored;
  const bool here = std::filesystem::exists(path, ignored);
  if (sum_over(groups->comm, static_cast<std::int64_t>(here)) < comm_size(groups->comm))
    return std::nullopt;
  *checkpoint.used = true;
  const Hdf5File file = Hdf5File::open(groups->comm, path);
  expect_identity(file, model);
  return read_rows(file, "/X", model);
}

void FrequencySolves::State::keep(double omega, const Block& x, bool end) const {
  using When = CheckpointSpec::When;
  const bool late = max_over(groups->comm, now() - start) > 20;
  if (checkpoint.path.empty() || checkpoint.when == When::never ||
      (checkpoint.when == When::automatic && !late && !end))
    return;
  agree(groups->comm, [&] {
    std::error_code failed;
    if (comm_rank(groups->comm) == 0)
      std::filesystem::create_directories(checkpoint.path, failed);
    if (failed)
      throw Error(text("cannot make the folder %s: %s", checkpoint.path.c_str(),
                       failed.message().c_str()));
  });
  Hdf5File file = Hdf5File::create(groups->comm, file_of(omega));
  write_identity(file, model);
  write_basis(file, "/X", x, model.n, model.rows);
  write_dof_map(file, model);
  file.commit();
  *checkpoint.used = true;
}

void FrequencySolves::for_each(const std::vector<double>& omega, const char* what,
                               const Use& use) {
  State& s = *state_;
  const auto list = mine(omega.size());
  bool ended = false;
  agree(s.groups->world, [&] { // errors inside a group are common to its ranks
    const int groups = s.groups->count;
    Progress progress(*s.observer,
                      groups > 1 ? text("%s (one of %d groups)", what, groups) : what,
                      static_cast<int>(list.size()));
    for (std::size_t l : list) {
      if (ended) break;
      with_context(text("%s %zu of %zu, %g Hz", what, l + 1, omega.size(), omega[l] * hz),
                   [&] {
                     if (const auto known = s.kept(omega[l])) {
                       use(l, *known);
                       progress.step(text("%.4g Hz, kept", omega[l] * hz));
                       return;
                     }
                     const double start = now();
                     s.solver->factorise(s.model.coefficients(omega[l]));
                     const double factorised = now();
                     const auto solution = s.solver->solve(s.elastic_loads);
                     s.worst_backward_error =
                         std::max(s.worst_backward_error, solution.backward_error);
                     const Block x = s.response(omega[l], solution.x);
                     use(l, x);
                     ended = !s.checkpoint.path.empty() &&
                             max_over(s.groups->comm, asked_to_end() ? 1.0 : 0.0) > 0;
                     s.keep(omega[l], x, ended);
                     progress.step(text("%.4g Hz, factor %.2f s, solve %.2f s, backward "
                                        "error %.0e",
                                        omega[l] * hz, factorised - start,
                                        now() - factorised, solution.backward_error));
                   });
    }
  });
  if (max_over(s.groups->world, ended ? 1.0 : 0.0) > 0)
    throw Interrupted(
        s.checkpoint.when == CheckpointSpec::When::never
            ? std::string(
                  "ended by SIGTERM or Ctrl-C, without a checkpoint ({checkpoint} no)")
            : text("ended by SIGTERM or Ctrl-C; {restart} goes on from %s",
                   s.checkpoint.path.c_str()));
  bool& used = *s.checkpoint.used; // by any group
  used = max_over(s.groups->world, used ? 1.0 : 0.0) > 0;
  s.worst_backward_error = max_over(s.groups->world, s.worst_backward_error);
  if (s.worst_backward_error > s.target_backward_error)
    s.observer->warn(
        text("backward error of the solves up to %.0e, above {backward_error} "
             "%.0e: pivoting may be too loose ({mumps_cntl_1}), or "
             "{refinements} too few",
             s.worst_backward_error, s.target_backward_error));
}

std::vector<ComplexDense> FrequencySolves::transfer(const std::vector<double>& omega,
                                                    const char* what) {
  std::vector<ComplexDense> h(omega.size());
  for_each(omega, what, [&](std::size_t l, const Block& x) {
    h[l] = transfer_of(model(), x, omega[l]);
  });
  return share_transfer(std::move(h));
}

std::vector<ComplexDense>
FrequencySolves::share_transfer(std::vector<ComplexDense> mine) const {
  const State& s = *state_;
  const int r = static_cast<int>(s.model.C.columns()),
            p = static_cast<int>(s.model.B.columns());
  const bool speaker = comm_rank(s.groups->comm) == 0; // one rank a group contributes
  for (auto& h : mine) {
    if (h.data.empty() || !speaker) h = ComplexDense(r, p);
    MPI_Allreduce(MPI_IN_PLACE, h.data.data(), 2 * r * p, MPI_DOUBLE, MPI_SUM,
                  s.groups->world);
  }
  return mine;
}

const SecondOrderModel& FrequencySolves::model() const { return state_->model; }
const Groups& FrequencySolves::groups() const { return *state_->groups; }
RowRange FrequencySolves::world_rows() const { return state_->world_rows; }
const FactorEstimate& FrequencySolves::estimate() const { return state_->estimate; }
const std::string& FrequencySolves::ordering() const {
  return state_->solver->ordering();
}
int FrequencySolves::factorisations() const {
  const bool speaker = comm_rank(state_->groups->comm) == 0;
  return static_cast<int>(sum_over(
      state_->groups->world,
      static_cast<std::int64_t>(speaker ? state_->solver->factorisations() : 0)));
}
double FrequencySolves::worst_backward_error() const {
  return state_->worst_backward_error;
}

} // namespace flexgram
