#include "io/reduced_io.hpp"

#include "base/process.hpp"
#include "base/text.hpp"
#include "io/body_io.hpp"
#include "io/hdf5_file.hpp"

#include <slepcversion.h>

#include <algorithm>
#include <cmath>

namespace flexgram {
namespace {

std::vector<double> row_major(const Dense& a) { return transpose(a).data; }

Dense local_dense(const Block& block) {
  Dense a(static_cast<int>(block.rows()), static_cast<int>(block.columns()));
  const Block::Access access(block);
  std::copy_n(access.column(0), a.data.size(), a.data.begin());
  return a;
}

void write_matrix(Hdf5File& file, const std::string& name, const Dense& a) {
  file.write(name, {a.rows, a.columns}, row_major(a));
}

void write_vector(Hdf5File& file, const std::string& name, const std::vector<double>& v) {
  file.write(name, {static_cast<std::int64_t>(v.size())}, v);
}

void write_log(Hdf5File& file, const ReducedModel& rom, const Options& options,
               const Observer& observer) {
  write_options(file, options);
  file.create_group("/log/seconds");
  for (const auto& [stage, seconds] : observer.stages())
    file.set_attribute("/log/seconds", stage, seconds);
  file.create_group("/log/versions");
  file.set_attribute(
      "/log/versions", "PETSc",
      text("%d.%d.%d", PETSC_VERSION_MAJOR, PETSC_VERSION_MINOR, PETSC_VERSION_SUBMINOR));
  file.set_attribute(
      "/log/versions", "SLEPc",
      text("%d.%d.%d", SLEPC_VERSION_MAJOR, SLEPC_VERSION_MINOR, SLEPC_VERSION_SUBMINOR));
  file.set_attribute("/log/versions", "flexgram", std::string(FLEXGRAM_VERSION));
  file.set_attribute("/log", "body", rom.model.name);
  file.set_attribute("/log", "ranks", static_cast<double>(comm_size(rom.V.comm())));
  file.set_attribute("/log", "factorisations", static_cast<double>(rom.factorisations));
  std::vector<std::string> plan;
  for (const auto& [name, value] : rom.plan) plan.push_back(name + "\t" + value);
  if (!plan.empty()) file.set_attribute("/log", "plan", plan);
  if (rom.medium_order > 0)
    file.set_attribute("/log", "medium_order", static_cast<double>(rom.medium_order));
  const double peak = max_over(rom.V.comm(), peak_memory_mb());
  file.set_attribute("/log", "peak_memory_mb_per_rank", peak);
  if (!observer.warnings().empty())
    file.set_attribute("/log", "warnings", observer.warnings());
}

/// Rows of `a` × blocks of m columns, written with the block index between: rows × blocks
/// × m.
void write_blocks(Hdf5File& file, const std::string& name, const Dense& a, int m) {
  file.write(name, {a.rows, a.columns / m, m}, row_major(a));
}

void write_frame(Hdf5File& file, const ReducedModel& rom) {
  file.create_group("/frame");
  file.set_attribute("/frame", "kind", rom.frame);
  file.set_attribute("/frame", "rigid_modes", static_cast<double>(rom.rigid_modes));
  if (!rom.integrals) return;
  const FrameIntegrals& i = *rom.integrals;
  const int m = static_cast<int>(rom.model.n);
  file.set_attribute("/frame", "mass", i.mass);
  write_vector(file, "/frame/centre", {i.centre.begin(), i.centre.end()});
  write_matrix(file, "/frame/M_r", i.M_r);
  write_matrix(file, "/frame/M_er", i.M_er);
  write_blocks(file, "/frame/gyroscopic", i.gyroscopic, m);
  write_blocks(file, "/frame/inertia_first", i.inertia_first, m);
  file.write("/frame/inertia_second", {3, m, 3, m}, row_major(i.inertia_second));
}

template <std::size_t columns>
void write_rows(Hdf5File& file, const std::string& name,
                const std::vector<std::array<double, columns>>& rows) {
  if (rows.empty()) return;
  std::vector<double> all;
  for (const auto& row : rows) all.insert(all.end(), row.begin(), row.end());
  file.write(name, {static_cast<std::int64_t>(rows.size()), columns}, all);
}

void write_claim(Hdf5File& file, const ErrorClaim& claim) {
  file.set_attribute("/error", "worst", claim.worst);
  file.set_attribute("/error", "whole", claim.whole);
  file.set_attribute("/error", "attained", claim.attained);
  file.set_attribute("/error", "at", claim.at);
  file.set_attribute("/error", "rigid_rounding", claim.rigid_rounding);
  file.set_attribute("/error", "relative_to", claim.relative_to);
  write_rows(file, "/error/bands", claim.bands);
  write_rows(file, "/error/excluded", claim.excluded);
  write_rows(file, "/error/poles", claim.poles);
  if (!claim.tolerance) return;
  file.set_attribute("/error", "tolerance", *claim.tolerance);
  file.set_attribute("/error", "met", claim.met ? 1.0 : 0.0);
}

} // namespace

void write_options(Hdf5File& file, const Options& options) {
  file.create_group("/log/options");
  for (const auto& option : options.all())
    file.set_attribute("/log/options", option.name, option.value);
}

void write_reduced(const ReducedModel& rom, const Options& options,
                   const Observer& observer, const SecondOrderModel& fom,
                   const std::string& path) {
  const SecondOrderModel& model = rom.model;
  Hdf5File file = Hdf5File::create(rom.V.comm(), path);
  file.set_attribute("/", "method", rom.method);
  if (!rom.second_stage.empty())
    file.set_attribute("/", "second_stage", rom.second_stage);
  file.set_attribute("/", "band", std::vector<double>{rom.band[0], rom.band[1]});
  write_matrix(file, "/M", to_dense(model.M));
  write_matrix(file, "/K", to_dense(model.K));
  write_matrix(file, "/D",
               model.D ? to_dense(model.D)
                       : Dense(static_cast<int>(model.n), static_cast<int>(model.n)));
  file.set_attribute("/", "eta", model.damping.eta);
  write_matrix(file, "/B", local_dense(model.B));
  file.set_attribute("/B", "names", model.inputs);
  write_matrix(file, "/C", transpose(local_dense(model.C)));
  file.set_attribute("/C", "names", model.outputs);
  if (rom.V.columns() > 0) { // else cut from a medium model without its basis
    const Block::Access access(rom.V);
    const PetscInt rows = rom.V.local_rows().size(), columns = rom.V.columns();
    std::vector<double> values(static_cast<std::size_t>(rows * columns));
    for (PetscInt j = 0; j < columns; ++j)
      for (PetscInt i = 0; i < rows; ++i)
        values[static_cast<std::size_t>(i * columns + j)] = access.column(j)[i];
    file.write_rows("/V", rom.V.rows(), columns, rom.V.local_rows(), values);
  }
  write_vector(file, "/gramian/sigma", rom.sigma);
  write_vector(file, "/error/omega", rom.omega);
  write_vector(file, "/error/relative", rom.epsilon);
  if (!rom.bound.empty()) {
    write_vector(file, "/error/bound", rom.bound);
    write_vector(file, "/error/floor", rom.floor);
  }
  file.set_attribute("/error", "kind", rom.kind);
  if (rom.claim) write_claim(file, *rom.claim);
  if (!rom.by_kind.empty()) file.set_attribute("/error", "by_kind", rom.by_kind);
  write_vector(file, "/modes/omega", rom.modes);
  write_frame(file, rom);
  write_dof_map(file, fom);
  write_log(file, rom, options, observer);
  file.commit();
}

SecondOrderModel read_reduced(MPI_Comm comm, const std::string& path) {
  const Hdf5File file = Hdf5File::open(comm, path);
  SecondOrderModel model;
  model.name = path;
  model.comm = PETSC_COMM_SELF;
  agree(comm, [&] {
    const auto read = [&](const std::string& name) {
      const auto shape = file.shape(name);
      if (shape.size() != 2)
        throw Error(text("file %s: %s must be a dense matrix: is this a reduced file?",
                         path.c_str(), name.c_str()));
      Dense a(static_cast<int>(shape[1]), static_cast<int>(shape[0]));
      a.data = file.read_all<double>(name);
      if (std::any_of(a.data.begin(), a.data.end(),
                      [](double x) { return !std::isfinite(x); }))
        throw Error(text("file %s: %s holds NaN or Inf", path.c_str(), name.c_str()));
      return transpose(a);
    };
    const Dense K = read("/K"), M = read("/M"), D = read("/D"), B = read("/B"),
                C = read("/C");
    const int m = K.rows;
    const auto expect = [&](const char* name, const Dense& a, int rows, int columns) {
      if (a.rows != rows || a.columns != columns)
        throw Error(text("file %s: %s is %d × %d, expected %d × %d", path.c_str(), name,
                         a.rows, a.columns, rows, columns));
    };
    expect("/K", K, m, m);
    expect("/M", M, m, m);
    expect("/D", D, m, m);
    expect("/B", B, m, B.columns);
    expect("/C", C, C.rows, m);
    model.n = m;
    model.rows = {0, model.n};
    model.K = make_dense(K);
    model.M = make_dense(M);
    if (frobenius_norm(D) > 0) model.D = make_dense(D);
    model.B = make_block(B);
    model.C = make_block(transpose(C));
    model.outputs_are_inputs = false;
    const auto names = [&](const char* name, int count) {
      return file.has_attribute(name, "names")
                 ? file.texts_attribute(name, "names")
                 : std::vector<std::string>(static_cast<std::size_t>(count));
    };
    model.inputs = names("/B", B.columns);
    model.outputs = names("/C", C.rows);
  });
  model.damping = read_damping(file);
  return model;
}

} // namespace flexgram
