#include "io/reduced_io.hpp"

#include "base/index.hpp"
#include "base/process.hpp"
#include "base/text.hpp"
#include "io/body_io.hpp"
#include "io/hdf5_file.hpp"
#include "io/kept_rows.hpp"
#include "io/laws.hpp"
#include "io/output_form.hpp"
#include "io/reduced_fields.hpp"
#include "io/versions.hpp"

#include <algorithm>
#include <cmath>

namespace flexgram {
namespace {

/// Names are paths in the file.
class FileSink : public FieldSink {
public:
  explicit FileSink(Hdf5File& file) : file_(file) {}
  void value(const std::string& name, double x) override { attribute(name, x); }
  void value(const std::string& name, const std::string& x) override {
    attribute(name, x);
  }
  void value(const std::string& name, const std::vector<double>& x) override {
    attribute(name, x);
  }
  void value(const std::string& name, const std::vector<std::string>& x) override {
    attribute(name, x);
  }
  void array(const std::string& name, const std::vector<std::int64_t>& shape,
             const std::vector<double>& values) override {
    file_.write("/" + name, shape, values);
  }

private:
  template <class T>
  void attribute(const std::string& path, const T& value) {
    const std::size_t slash = path.rfind('/');
    const std::string object = slash == std::string::npos ? "" : path.substr(0, slash);
    if (!object.empty() && !file_.exists("/" + object)) file_.create_group("/" + object);
    file_.set_attribute("/" + object, path.substr(slash + 1), value);
  }
  Hdf5File& file_;
};

void write_log(Hdf5File& file, const ReducedModel& rom, const Options& options,
               const Observer& observer) {
  write_options(file, options);
  file.create_group("/log/seconds");
  for (const auto& [stage, seconds] : observer.stages())
    file.set_attribute("/log/seconds", stage, seconds);
  file.create_group("/log/versions");
  for (const auto& [name, version] : versions())
    file.set_attribute("/log/versions", name, version);
  file.set_attribute("/log", "date", utc_time());
  file.set_attribute("/log", "host", host_name());
  file.set_attribute("/log", "ranks", static_cast<double>(comm_size(rom.V.comm())));
  const double peak = max_over(rom.V.comm(), peak_memory_mb());
  file.set_attribute("/log", "peak_memory_mb_per_rank", peak);
  if (!observer.warnings().empty())
    file.set_attribute("/log", "warnings", observer.warnings());
}

} // namespace

void write_options(Hdf5File& file, const Options& options) {
  file.create_group("/log/options");
  for (const auto& option : options.all())
    file.set_attribute("/log/options", option.name, option.value);
  std::string given;
  for (const auto& option : options.all())
    if (option.set_by_user)
      given += (given.empty() ? "" : " ") + option.name + " " + option.value;
  file.set_attribute("/log", "given", given);
}

void write_reduced(const ReducedModel& rom, const Options& options,
                   const Observer& observer, const SecondOrderModel& fom,
                   const std::string& path) {
  Hdf5File file = Hdf5File::create(rom.V.comm(), path);
  FileSink sink(file);
  visit_fields(rom, sink);
  if (rom.V.columns() > 0) // else cut from a medium model without its basis
    write_basis(file, "/V", rom.V, rom.V.rows(), rom.V.local_rows());
  write_dof_map(file, fom);
  write_log(file, rom, options, observer);
  file.commit();
}

SecondOrderModel read_reduced(MPI_Comm comm, const std::string& path) {
  const Hdf5File file = Hdf5File::open(comm, path);
  SecondOrderModel model;
  model.name = path;
  model.comm = PETSC_COMM_SELF;
  const std::vector<Law> laws = read_laws(file);
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
    const auto factor = [&](const char* name) {
      return file.has_attribute("/", name) ? file.number_attribute("/", name) : 0.0;
    };
    const bool by_factors = factor("alpha") != 0 || factor("beta") != 0; // all of D
    Dense skew = D, symmetric = D;
    symmetrise(skew, Symmetry::skew);
    symmetrise(symmetric);
    constexpr double rounding = 1e-13;
    if (frobenius_norm(skew) > rounding * frobenius_norm(D))
      model.terms.push_back({Law::Kind::gyroscopic, make_dense(skew)});
    if (!by_factors && frobenius_norm(symmetric) > 0)
      model.terms.push_back({Law(), make_dense(symmetric)});
    for (const Law& law : laws) {
      if (law.is_of_rates() && !law.is_named()) continue;
      const Dense T = read(law.path());
      expect(law.path().c_str(), T, m, m);
      model.terms.push_back({law, make_dense(T)});
    }
    model.B = make_block(B);
    model.C = make_block(transpose(C));
    model.outputs_are_inputs = false;
    const auto names = [&](const char* name, int count) {
      return file.has_attribute(name, "names") ? file.texts_attribute(name, "names")
                                               : std::vector<std::string>(as_size(count));
    };
    model.inputs = names("/B", B.columns);
    model.outputs = names("/C", C.rows);
    read_output_form(file, model);
  });
  model.damping = read_damping(file);
  return model;
}

} // namespace flexgram
