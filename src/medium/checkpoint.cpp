/// The file of an unfinished certify: a medium file with the levels so far, and what the
/// growth needs to go on.

#include "medium/checkpoint.hpp"

#include "base/text.hpp"
#include "io/archive.hpp"
#include "io/body_io.hpp"
#include "io/kept_rows.hpp"
#include "medium/medium_io.hpp"

#include <algorithm>
#include <cmath>
#include <filesystem>

namespace flexgram {
namespace {

template <class Archive, class State>
void archive_state(Archive&& a, State& s) {
  a("K", s.K);
  a("D", s.D);
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

} // namespace

void write_checkpoint(const Medium& medium, const CheckpointState& state,
                      const SecondOrderModel& body, const std::string& path) {
  Hdf5File file = Hdf5File::create(body.comm, path);
  write_levels(file, medium);
  archive_state(FieldWriter(file, "/checkpoint"), state);
  write_identity(file, body);
  write_basis(file, "/V", state.V, body.n, body.rows);
  if (state.image) write_basis(file, "/image", state.image, body.n, body.rows);
  write_dof_map(file, body);
  file.commit();
}

std::optional<CheckpointState> read_checkpoint(const SecondOrderModel& body,
                                               const CertifySpec& spec,
                                               const std::string& path, Medium& medium) {
  std::error_code ignored;
  const bool here = std::filesystem::is_regular_file(path, ignored);
  if (sum_over(body.comm, static_cast<std::int64_t>(here)) < comm_size(body.comm))
    return std::nullopt;
  const Hdf5File file = Hdf5File::open(body.comm, path);
  CheckpointState state;
  medium = Medium();
  agree(body.comm, [&] {
    read_levels(file, medium);
    archive_state(FieldReader(file, "/checkpoint"), state);
    expect_same_job(file, medium, spec);
  });
  expect_identity(file, body);
  state.V.append(read_rows(file, "/V", body));
  if (file.exists("/image")) state.image = read_rows(file, "/image", body);
  const int rigid = medium.rigid;
  const auto ports =
      body.inputs.size() + (body.outputs_are_inputs ? 0 : body.outputs.size());
  const auto square = [&](const Dense& a) {
    return a.rows == rigid && a.columns == rigid;
  };
  if (medium.scale.size() != ports ||
      medium.body.outputs_are_inputs != body.outputs_are_inputs ||
      state.V.columns() < rigid + medium.modes || !square(state.rigid_stiffness) ||
      (!medium.levels.empty() && medium.levels.back().order() > state.V.columns()))
    throw Error(
        text("file %s: its parts do not fit each other: it is damaged", path.c_str()));
  return state;
}

} // namespace flexgram
