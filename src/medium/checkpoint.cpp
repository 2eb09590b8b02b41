/// The file of an unfinished certify: a medium file with the levels so far, and what the
/// growth needs to go on.

#include "medium/checkpoint.hpp"

#include "base/index.hpp"
#include "base/process.hpp"
#include "base/text.hpp"
#include "io/archive.hpp"
#include "io/body_io.hpp"
#include "io/kept_rows.hpp"
#include "medium/medium_io.hpp"
#include "medium/mode_search.hpp"
#include "medium/port_loads.hpp"

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <numeric>

namespace flexgram {
namespace {

/// The fields of a checkpoint beside the levels of the medium model.
struct Stored {
  Basis V;                  ///< W-orthonormal
  Dense K, ports;           ///< VᵀKV and Vᵀ[B, C], scaled: what tells bodies apart
  std::vector<Dense> terms; ///< VᵀTV: so
  Block image;
  Dense rigid_stiffness; ///< among rigid modes, as the stored K has it (MediumSpace)
  int geometric = 0, blocks = 0;
  bool inertia_is_safe = false;
  int judged_elastic = 0;
  bool exact_modes = false;
  std::vector<double> grid; ///< [rad/s]
  double least_eigenvalue = 0, of_rounding = 0;

  template <class Archive, class Self>
  static void archive(Archive&& a, Self& s) {
    a("K", s.K);
    a("terms", s.terms);
    a("ports", s.ports);
    a("rigid_stiffness", s.rigid_stiffness);
    a("geometric", s.geometric);
    a("blocks", s.blocks);
    a("inertia_is_safe", s.inertia_is_safe);
    a("judged_elastic", s.judged_elastic);
    a("exact_modes", s.exact_modes);
    a("grid", s.grid);
    a("least_eigenvalue", s.least_eigenvalue);
    a("of_rounding", s.of_rounding);
  }
};

Stored stored(const CertifyState& state) {
  const MediumSpace& space = *state.modal.space;
  const int rigid = space.rigid();
  Stored s;
  s.rigid_stiffness =
      rigid > 0 ? part_of(space.rigid_stiffness(), 0, rigid, 0, rigid) : Dense(0, 0);
  s.geometric = space.geometric();
  s.blocks = state.growth.blocks;
  s.inertia_is_safe = state.modal.inertia_is_safe;
  s.judged_elastic = state.modal.judged_elastic;
  s.exact_modes = state.modal.exact;
  s.grid = state.growth.grid;
  s.least_eigenvalue = state.growth.bounds.least_eigenvalue;
  s.of_rounding = state.growth.bounds.of_rounding;
  s.K = space.K();
  s.terms = space.terms();
  s.ports = inner(space.V(), state.modal.loads);
  s.V = space.V().share();
  if (state.growth.image) s.image = state.growth.image.share();
  return s;
}

void expect_same_job(const Hdf5File& file, const Medium& there, const CertifySpec& spec) {
  const auto refuse = [&](const std::string& why) {
    throw Error(text("{restart}: the checkpoint %s is of another job: %s; remove it to "
                     "start afresh",
                     file.path().c_str(), why.c_str()));
  };
  const auto differs = [](double a, double b) {
    return std::abs(a - b) > 1e-10 * std::max(std::abs(a), std::abs(b));
  };
  const auto words = [](const std::vector<Interval>& bands) {
    std::string all;
    for (const Interval& b : bands)
      all += text("%s%g-%g", all.empty() ? "" : ", ", b.first * hz, b.last * hz);
    return all + " Hz";
  };
  bool same = there.spec.bands.size() == spec.bands.size();
  for (std::size_t i = 0; same && i < spec.bands.size(); ++i)
    same = !differs(there.spec.bands[i].first, spec.bands[i].first) &&
           !differs(there.spec.bands[i].last, spec.bands[i].last);
  if (!same)
    refuse("its band is " + words(there.spec.bands) + ", here " + words(spec.bands));
  if (differs(there.spec.cutoff, spec.cutoff) || there.spec.modes != spec.modes ||
      differs(there.spec.last_needed, spec.last_needed))
    refuse(text("it was made with {cutoff} %g and %d modes up to %g rad/s, this job "
                "asks for %g, %d and %g",
                there.spec.cutoff, there.spec.modes, there.spec.last_needed, spec.cutoff,
                spec.modes, spec.last_needed));
}

void write(const CertifyState& state, const SecondOrderModel& body,
           const std::string& path) {
  const Stored s = stored(state);
  Hdf5File file = Hdf5File::create(body.comm, path);
  write_levels(file, state.medium);
  Stored::archive(FieldWriter(file, "/checkpoint"), s);
  write_identity(file, body);
  write_basis(file, "/V", s.V, body.n, body.rows);
  if (s.image) write_basis(file, "/image", s.image, body.n, body.rows);
  write_dof_map(file, body);
  file.commit();
}

/// Rows as this run has them: a body assembled on another number of ranks has them in another
/// order. @return nothing if there is no such file.
/// @param medium  becomes what it was, without V.
std::optional<Stored> read(const SecondOrderModel& body, const CertifySpec& spec,
                           const std::string& path, Medium& medium) {
  std::error_code ignored;
  const bool here = std::filesystem::is_regular_file(path, ignored);
  if (sum_over(body.comm, static_cast<std::int64_t>(here)) < comm_size(body.comm))
    return std::nullopt;
  const Hdf5File file = Hdf5File::open(body.comm, path);
  Stored s;
  agree(body.comm, [&] {
    read_levels(file, medium);
    Stored::archive(FieldReader(file, "/checkpoint"), s);
    expect_same_job(file, medium, spec);
  });
  expect_identity(file, body);
  s.V.append(read_rows(file, "/V", body));
  if (file.exists("/image")) s.image = read_rows(file, "/image", body);
  const int rigid = medium.rigid;
  const auto ports =
      body.inputs.size() + (body.outputs_are_inputs ? 0 : body.outputs.size());
  const auto square = [&](const Dense& a) {
    return a.rows == rigid && a.columns == rigid;
  };
  if (medium.scale.size() != ports ||
      medium.body.outputs_are_inputs != body.outputs_are_inputs ||
      s.V.columns() < rigid + medium.modes || !square(s.rigid_stiffness) ||
      (!medium.levels.empty() && medium.levels.back().order() > s.V.columns()))
    throw Error(
        text("file %s: its parts do not fit each other: it is damaged", path.c_str()));
  return s;
}

/// Whether V is of this body: what it makes of K, the terms and the ports now against what it
/// made of them then, up to rounding of each entry; norms alone would not see a load that
/// moved to another node.
void expect_same_projection(const ModalSpace& modal, const Stored& there, MPI_Comm comm,
                            const std::string& path) {
  const MediumSpace& space = *modal.space;
  const auto& g = space.rounding_weights();
  double worst = loss_of_orthogonality(space.V(), space.product(), 32) / 1e-9;
  const auto compare = [&](const Dense& here, const Dense& kept, auto&& allowed) {
    if (here.rows != kept.rows || here.columns != kept.columns) worst = HUGE_VAL;
    for (int j = 0; j < here.columns && worst < HUGE_VAL; ++j)
      for (int i = 0; i < here.rows; ++i)
        worst = std::max(worst, std::abs(here(i, j) - kept(i, j)) / allowed(i, j));
  };
  const double rounding = 1e3 * space.rounding(), sigma = modal.cutoff * modal.cutoff;
  compare(space.K(), there.K, [&](int i, int j) {
    return rounding * g[as_size(i)] * g[as_size(j)] + 1e-12 * sigma;
  });
  if (space.terms().size() != there.terms.size()) worst = HUGE_VAL;
  for (std::size_t t = 0; t < there.terms.size() && worst < HUGE_VAL; ++t) {
    const double size = frobenius_norm(there.terms[t]);
    compare(space.terms()[t], there.terms[t],
            [&](int, int) { return 1e-9 * size + 1e-300; });
  }
  const Dense ports = inner(space.V(), modal.loads);
  const double size = frobenius_norm(ports);
  compare(ports, there.ports, [&](int, int) { return 1e-9 * size + 1e-300; });
  int below = 0;
  for (double l : ritz_pairs(space).lambda) below += l < sigma;
  if (!(max_over(comm, worst) <= 1) || below != modal.elastic)
    throw Error(text(
        "{restart}: the checkpoint %s is of another body, or damaged: what "
        "its basis makes of K, the damping and the ports differs; remove it to start "
        "afresh",
        path.c_str()));
}

ModalSpace modal_space(const CertifyRun& run, const Medium& medium, Stored& s) {
  ModalSpace modal;
  modal.cutoff = medium.cutoff;
  modal.scale = medium.scale;
  modal.elastic = medium.modes;
  modal.exact = s.exact_modes;
  modal.judged_elastic = s.judged_elastic;
  modal.inertia_is_safe = s.inertia_is_safe;
  modal.loads = port_loads(run.fom).all;
  scale_columns(modal.loads, modal.scale);
  const int rigid = medium.rigid, all = static_cast<int>(s.V.columns());
  std::vector<int> first(as_size(rigid)), rest(as_size(all - rigid));
  std::iota(first.begin(), first.end(), 0);
  std::iota(rest.begin(), rest.end(), rigid);
  const Block V = std::move(s.V).block();
  modal.space = std::make_unique<MediumSpace>(run.fom, medium.kappa, medium.tau);
  modal.space->start_with_rigid_modes(select_columns(V, first),
                                      std::move(s.rigid_stiffness), s.geometric);
  modal.space->restore(select_columns(V, rest));
  return modal;
}

} // namespace

Checkpoints::Checkpoints(const SecondOrderModel& fom, const CheckpointSpec& spec,
                         Observer& observer)
    : fom_(fom), spec_(spec), observer_(observer), last_(now()), seconds_of_mb_(5e-3) {}

bool Checkpoints::is_asked_to_end() const {
  return max_over(fom_.comm, asked_to_end() ? 1.0 : 0.0) > 0;
}

std::optional<CertifyState> Checkpoints::resume(const CertifyRun& run) const {
  if (!spec_.restart || spec_.path.empty()) return std::nullopt;
  Stage stage(observer_, "restart");
  CertifyState state;
  Medium& medium = state.medium;
  auto s = read(fom_, run.spec, spec_.path, medium);
  if (!s) {
    const std::string words =
        text("there is no checkpoint %s: from the beginning", spec_.path.c_str());
    observer_.fact("restart", words);
    observer_.say("  " + words);
    return std::nullopt;
  }
  *spec_.used = true;
  medium.body = fom_.head();
  medium.spec = run.spec;
  medium.shortfall = unfinished;
  run.factors.count_from(medium.factorisations, medium.solved_columns);
  state.growth = {std::move(s->grid),
                  std::move(s->image),
                  s->blocks,
                  {s->least_eigenvalue, s->of_rounding}};
  state.modal = modal_space(run, medium, *s);
  expect_same_projection(state.modal, *s, fom_.comm, spec_.path);
  observer_.fact("restart",
                 text("from %s: %d rigid and %d elastic modes below %.4g Hz, order %d, "
                      "%zu levels certified",
                      spec_.path.c_str(), medium.rigid, medium.modes, medium.cutoff * hz,
                      state.modal.space->columns(), medium.levels.size()));
  return state;
}

void Checkpoints::save(const CertifyRun& run, CertifyState& state, const char* what) {
  if (spec_.path.empty()) return;
  state.medium.factorisations = run.factors.factorisations();
  state.medium.solved_columns = run.factors.solved_columns();
  using When = CheckpointSpec::When;
  const bool end = is_asked_to_end();
  constexpr double share = 0.03, soonest = 20; // of the time since the last one; [s]
  const double mb = 8e-6 * static_cast<double>(fom_.n) * state.modal.space->columns(),
               since = max_over(fom_.comm, now() - last_);
  const bool late = since > std::max(soonest, seconds_of_mb_ * mb / share);
  bool saved = false;
  if (spec_.when == When::always || (spec_.when == When::automatic && (late || end))) {
    Stage stage(observer_, "checkpoint");
    try {
      const double start = now();
      write(state, fom_, spec_.path);
      saved = *spec_.used = true;
      last_ = now();
      seconds_of_mb_ = max_over(fom_.comm, last_ - start) / std::max(mb, 1.0);
      observer_.detail(text("  checkpoint after %s: %s", what, spec_.path.c_str()));
    } catch (const Error& error) { // on all ranks
      if (spec_.when == When::always) throw;
      observer_.warn(text("no checkpoint: %s", error.what()));
    }
  }
  if (end)
    throw Interrupted(
        saved ? text("ended by SIGTERM or Ctrl-C after %s; {restart} goes on from %s",
                     what, spec_.path.c_str())
              : text("ended by SIGTERM or Ctrl-C after %s, without a checkpoint", what));
}

void Checkpoints::end_if_asked(const char* what) const {
  if (!spec_.path.empty() && is_asked_to_end())
    throw Interrupted(
        text("ended by SIGTERM or Ctrl-C before %s was done: there was nothing to "
             "keep yet",
             what));
}

} // namespace flexgram
