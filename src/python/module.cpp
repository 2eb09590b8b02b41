/// Python module _flexgram: reduction in the caller's process and communicator. The
/// package flexgram (python/flexgram) is its user; nothing here is documented for others.

#include "base/blas.hpp"
#include "base/index.hpp"
#include "base/process.hpp"
#include "base/text.hpp"
#include "fem/shape_functions.hpp"
#include "fem/shell.hpp"
#include "io/body_io.hpp"
#include "io/reduced_fields.hpp"
#include "io/reduced_io.hpp"
#include "medium/medium_io.hpp"
#include "python/body.hpp"
#include "run/reduce.hpp"
#include "run/summary.hpp"

#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>
#include <pybind11/stl.h>

#include <slepcsys.h>

namespace py = pybind11;

namespace flexgram {
namespace {

/// PETSc's options for the time of one call: only what the call gave, not the program's
/// own.
class CallOptions {
public:
  explicit CallOptions(const std::map<std::string, std::string>& values) {
    FG_CALL(PetscOptionsCreate(&own_));
    FG_CALL(PetscOptionsPush(own_));
    for (const auto& [name, value] : values)
      FG_CALL(PetscOptionsSetValue(own_, name.c_str(), value.c_str()));
    install_petsc_error_handler();
  }
  ~CallOptions() {
    PetscPopErrorHandler();
    PetscOptionsPop();
    PetscOptionsDestroy(&own_);
  }
  CallOptions(const CallOptions&) = delete;
  CallOptions& operator=(const CallOptions&) = delete;

private:
  PetscOptions own_ = nullptr;
};

/// Fields of a reduced body, by their names in its file.
class DictSink : public FieldSink {
public:
  void value(const std::string& name, double x) override { fields[name.c_str()] = x; }
  void value(const std::string& name, const std::string& x) override {
    fields[name.c_str()] = x;
  }
  void value(const std::string& name, const std::vector<double>& x) override {
    fields[name.c_str()] = x;
  }
  void value(const std::string& name, const std::vector<std::string>& x) override {
    fields[name.c_str()] = x;
  }
  void array(const std::string& name, const std::vector<std::int64_t>& shape,
             const std::vector<double>& values) override {
    fields[name.c_str()] = Array(shape, values.data());
  }
  py::dict fields;
};

template <class T>
py::array_t<T> array_of(const std::vector<T>& values) {
  return py::array_t<T>(static_cast<py::ssize_t>(values.size()), values.data());
}

/// This rank's rows, by columns, without a copy: the array keeps the block alive.
py::array_t<double> rows_of(const Block& block) {
  const py::ssize_t rows = block.local_rows().size(), columns = block.columns();
  if (rows == 0 || columns == 0) return py::array_t<double>({rows, columns});
  auto owner = std::make_unique<Block>(block.share());
  const Block::Access access(*owner);
  const py::capsule keep(owner.get(),
                         [](void* held) { delete static_cast<Block*>(held); });
  owner.release();
  constexpr auto size = static_cast<py::ssize_t>(sizeof(double));
  return py::array_t<double>({rows, columns}, {size, rows * size}, access.column(0),
                             keep);
}

/// What a call returns: the reduced body, kept together with what its file needs.
struct Reduction {
  Body body;
  Options options;
  std::unique_ptr<Observer> observer;
  ReducedModel rom;

  /// The reduced file's datasets and attributes by their names there, this rank's rows of
  /// V.
  py::dict fields() const {
    DictSink sink;
    visit_fields(rom, sink);
    py::dict f = std::move(sink.fields);
    f["V"] = rows_of(rom.V);
    f["dofs/node"] =
        array_of(body.model.label.empty() ? body.model.node : body.model.label);
    f["dofs/component"] = array_of(body.model.component);
    f["dofs/position"] = array_of(body.model.position);
    f["log/seconds"] = std::map<std::string, double>(observer->stages().begin(),
                                                     observer->stages().end());
    f["log/warnings"] = observer->warnings();
    return f;
  }

  void save(const std::string& path) {
    const CallOptions call({});
    check_output(body.model.comm, path, {});
    write_reduced(rom, options, *observer, body.model, path);
  }
};

/// Settings of one call, read from its options.
struct Call {
  Call(MPI_Comm comm, const std::map<std::string, std::string>& values) : guard(values) {
    settings.monitor = Observer::Level::silent;
    settings.describe(options);
    options.reject_unknown();
    observer = std::make_unique<Observer>(comm, settings.prepare(comm));
    settings.check();
    if (settings.restart || settings.checkpoint != CheckpointSpec::When::automatic)
      throw Error("{checkpoint} and {restart} are for the program: in Python keep the "
                  "Medium that certify returns");
    if (comm_size(comm) == 1) interrupt.emplace();
  }
  CallOptions guard;
  std::optional<InterruptGuard> interrupt; ///< Ctrl-C, on one rank
  Settings settings;
  Options options;
  std::unique_ptr<Observer> observer;
};

Body body_of(MPI_Comm comm, PythonBody* given, Call& call) {
  if (!given) return load_body(comm, call.settings, *call.observer);
  Body body;
  body.model = given->body.model.share();
  body.model.damp_parameters(); // not by what α, β and η take over from D and S
  classify_damping(body.model);
  begin_plan(body, call.settings, *call.observer);
  return body;
}

std::unique_ptr<Reduction> result_of(Call& call, const SecondOrderModel& body,
                                     ReducedModel rom) {
  auto result = std::make_unique<Reduction>();
  result->rom = std::move(rom);
  result->body.model = body.head(); // its file needs no more than the dof map
  say_result(result->rom, body, *call.observer);
  say_time(*call.observer, body.comm);
  result->options = std::move(call.options);
  result->observer = std::move(call.observer);
  return result;
}

std::unique_ptr<Reduction> reduce_call(std::intptr_t comm_handle, PythonBody* given,
                                       const std::map<std::string, std::string>& values) {
  start();
  const MPI_Comm comm = comm_of(comm_handle);
  Call call(comm, values);
  call.settings.choose_tolerance(*call.observer);
  const Body body = body_of(comm, given, call);
  ReducedModel rom = reduce_body(body, call.settings, *call.observer);
  return result_of(call, body.model, std::move(rom));
}

/// A certified medium model in Python's hands.
struct PythonMedium {
  Medium medium;
  std::map<std::string, std::string> options; ///< that made it
  std::vector<std::pair<std::string, std::string>> plan;
  std::vector<std::string> warnings;

  void save(const std::string& path, bool basis) const {
    const CallOptions guard({});
    check_output(medium.body.comm, path, {});
    write_medium(medium, basis, options, plan, path);
  }
  std::unique_ptr<Reduction> cut(const std::map<std::string, std::string>& values) const {
    Call call(medium.body.comm, values);
    call.settings.choose_tolerance(*call.observer);
    tell_medium(medium, *call.observer);
    ReducedModel rom = cut_medium(medium, call.settings, *call.observer);
    return result_of(call, medium.body, std::move(rom));
  }
  py::dict fields() const {
    py::dict f;
    std::vector<std::pair<double, double>> bands;
    for (const Interval& band : medium.spec.bands)
      bands.emplace_back(band.first, band.last);
    f["n"] = medium.body.n;
    f["order"] = medium.levels.back().order();
    f["levels"] = medium.levels.size();
    f["bands"] = bands;
    f["target"] = medium.spec.target;
    f["reached"] = medium.shortfall.empty() && medium.levels.back().proved;
    f["claim"] = medium.claim();
    f["cutoff"] = medium.cutoff;
    f["modes"] = medium.modes;
    f["rigid_modes"] = medium.rigid;
    const auto [omega, error] = natural_frequencies(medium);
    f["mode_omega"] = omega;
    f["mode_error"] = error;
    f["inputs"] = medium.body.inputs;
    f["outputs"] = medium.body.outputs;
    f["body"] = medium.body.name;
    f["has_basis"] = static_cast<bool>(medium.V);
    f["plan"] = plan;
    f["warnings"] = warnings;
    return f;
  }
};

std::unique_ptr<PythonMedium>
certify_call(std::intptr_t comm_handle, PythonBody* given,
             const std::map<std::string, std::string>& values) {
  start();
  const MPI_Comm comm = comm_of(comm_handle);
  Call call(comm, values);
  auto result = std::make_unique<PythonMedium>();
  if (call.settings.takes_samples())
    throw Error("method pod has no medium model to certify");
  const Body body = body_of(comm, given, call);
  result->medium = certify_body(body, call.settings, true, *call.observer);
  say_time(*call.observer, comm);
  for (const Option& option : call.options.all())
    result->options[option.name] = option.value;
  result->plan = call.observer->facts();
  result->warnings = call.observer->warnings();
  return result;
}

std::unique_ptr<PythonMedium> load_medium(std::intptr_t comm_handle,
                                          const std::string& path) {
  start();
  const CallOptions guard({});
  auto result = std::make_unique<PythonMedium>();
  result->medium = read_medium(comm_of(comm_handle), path);
  return result;
}

/// The registry, for the options reference.
std::vector<std::map<std::string, std::string>> options() {
  Settings settings;
  Options registry(Options::Mode::describe);
  settings.describe(registry);
  std::vector<std::map<std::string, std::string>> result;
  for (const auto& o : registry.all())
    result.push_back({{"section", o.section},
                      {"verbs", o.verbs},
                      {"name", o.name},
                      {"short name", short_name(o.name)},
                      {"type", o.type},
                      {"default", o.value},
                      {"unit", o.unit},
                      {"choices", o.choices},
                      {"help", o.help}});
  return result;
}

/// Points (q, 3), weights (q), N (q, n) and dN (q, n, 3).
py::tuple shape_arrays(ElementType type, const std::vector<ShapePoint>& points) {
  const py::ssize_t count = static_cast<py::ssize_t>(points.size()),
                    nodes = node_count(type);
  py::array_t<double> xi({count, py::ssize_t{3}}), weight(count), N({count, nodes}),
      dN({count, nodes, py::ssize_t{3}});
  for (py::ssize_t q = 0; q < count; ++q) {
    const ShapePoint& p = points[as_size(q)];
    weight.mutable_at(q) = p.weight;
    for (py::ssize_t a = 0; a < 3; ++a) xi.mutable_at(q, a) = p.xi[as_size(a)];
    for (py::ssize_t i = 0; i < nodes; ++i) {
      N.mutable_at(q, i) = p.N[as_size(i)];
      for (py::ssize_t a = 0; a < 3; ++a)
        dN.mutable_at(q, i, a) = p.dN[as_size(i)][as_size(a)];
    }
  }
  return py::make_tuple(xi, weight, N, dN);
}

/// Shape functions at the points of an element's stiffness, or at given ones.
py::tuple shape_functions(const std::string& element, const py::array_t<double>& at) {
  const ElementType type = element_type(element);
  if (at.size() == 0) return shape_arrays(type, stiffness_points(type));
  std::vector<ShapePoint> points;
  for (py::ssize_t q = 0; q < at.shape(0); ++q)
    points.push_back(shape_at(type, {at.at(q, 0), at.at(q, 1), at.at(q, 2)}, 0));
  return shape_arrays(type, points);
}

/// A section of a shell, as Python knows it.
struct PythonShell {
  void add(const std::array<double, 36>& stiffness, double thickness, double angle,
           const std::string& role, double factor,
           const std::optional<std::array<double, 6>>& expansion) {
    const std::map<std::string, ShellRole> roles = {{"all", ShellRole::all},
                                                    {"stretching", ShellRole::stretching},
                                                    {"bending", ShellRole::bending},
                                                    {"shear", ShellRole::shear}};
    layers.push_back(
        {stiffness, 0, thickness, angle, roles.at(role), factor, {}, expansion});
  }
  /// When all layers are there.
  void finish() { law = shell_law(layers); }

  std::vector<ShellLayer> layers;
  ShellLaw law;
  ShellPlace place;
};

py::array_t<double> array_of(const Dense& a) {
  py::array_t<double> result({a.rows, a.columns});
  for (int i = 0; i < a.rows; ++i)
    for (int j = 0; j < a.columns; ++j) result.mutable_at(i, j) = a(i, j);
  return result;
}

/// An element of (E, n, 3), whose material axes are of its own, (E, 3), or those of the section, (0, 3).
std::pair<std::vector<Vector3>, ShellPlace> place_of(const PythonShell& shell,
                                                     const py::array_t<double>& points,
                                                     const py::array_t<double>& axis_1,
                                                     py::ssize_t e) {
  std::vector<Vector3> nodes;
  for (py::ssize_t a = 0; a < points.shape(1); ++a)
    nodes.push_back({points.at(e, a, 0), points.at(e, a, 1), points.at(e, a, 2)});
  ShellPlace place = shell.place;
  if (axis_1.shape(0) > 0)
    place.axis_1 = {axis_1.at(e, 0), axis_1.at(e, 1), axis_1.at(e, 2)};
  return {std::move(nodes), place};
}

/// Of elements: areas (E, q), strains and curvatures (E, q, 6, dofs n), axes (E, q, 2, 3).
py::tuple shell_strain_arrays(const PythonShell& shell, const std::string& element,
                              const py::array_t<double>& points,
                              const py::array_t<double>& axis_1) {
  const ElementType type = element_type(element);
  const auto count = points.shape(0), n = points.shape(1);
  const auto q = static_cast<py::ssize_t>(stiffness_points(type).size());
  py::array_t<double> area({count, q});
  py::array_t<double> stretch(
      std::vector<py::ssize_t>{count, q, 6, dofs_per_node(type) * n});
  py::array_t<double> axes(std::vector<py::ssize_t>{count, q, 2, 3});
  for (py::ssize_t e = 0; e < count; ++e) {
    const auto [nodes, place] = place_of(shell, points, axis_1, e);
    const auto strains = shell_strains(type, nodes, shell.law, place);
    for (py::ssize_t p = 0; p < q; ++p) {
      const ShellStrainPoint& at = strains[static_cast<std::size_t>(p)];
      area.mutable_at(e, p) = at.area;
      for (int i = 0; i < at.stretch.rows; ++i)
        for (int j = 0; j < at.stretch.columns; ++j)
          stretch.mutable_at(e, p, i, j) = at.stretch(i, j);
      for (std::size_t i = 0; i < 2; ++i)
        for (std::size_t c = 0; c < 3; ++c) axes.mutable_at(e, p, i, c) = at.axes[i][c];
    }
  }
  return py::make_tuple(area, stretch, axes);
}

/// Of elements that are held while stress resultants (E, q, 6) hold strains without stress back: forces
/// (E, dofs n) of these strains, and what internal dofs that give way strain (E, q, 6).
py::tuple hold_shells(const PythonShell& shell, const std::string& element,
                      const py::array_t<double>& points,
                      const py::array_t<double>& axis_1,
                      const py::array_t<double>& resultants) {
  const ElementType type = element_type(element);
  const auto count = points.shape(0), n = dofs_per_node(type) * points.shape(1),
             q = resultants.shape(1);
  py::array_t<double> forces({count, n});
  py::array_t<double> strains(std::vector<py::ssize_t>{count, q, 6});
  for (py::ssize_t e = 0; e < count; ++e) {
    const auto [nodes, place] = place_of(shell, points, axis_1, e);
    std::vector<Dense> held;
    for (py::ssize_t p = 0; p < q; ++p) {
      Dense& at = held.emplace_back(6, 1);
      for (int i = 0; i < 6; ++i) at(i, 0) = resultants.at(e, p, i);
    }
    const HeldShell of = hold_shell(type, nodes, shell.law, place, held);
    for (int i = 0; i < of.forces.rows; ++i) forces.mutable_at(e, i) = of.forces(i, 0);
    for (py::ssize_t p = 0; p < q; ++p)
      for (int i = 0; i < 6; ++i)
        strains.mutable_at(e, p, i) = of.strains[static_cast<std::size_t>(p)](i, 0);
  }
  return py::make_tuple(forces, strains);
}

} // namespace
} // namespace flexgram

PYBIND11_MODULE(_flexgram, module) {
  using namespace flexgram;
  fit_blas_kernels();
  set_option_style(OptionStyle::keyword);
  module.def("start", &start);
  module.def("options", &options);
  module.def("shape_functions", &shape_functions);
  module.def("mass_points", [](const std::string& element) {
    const ElementType type = element_type(element);
    return shape_arrays(type, mass_points(type));
  });
  module.def("isotropic",
             [](double E, double nu) { return isotropic(E, nu, 1).stiffness; });
  module.def("orthotropic", [](const std::array<double, 9>& constants,
                               const std::array<double, 9>& axes) {
    return orthotropic(constants, axes, 1).stiffness;
  });
  module.def("anisotropic", [](const std::array<double, 36>& stiffness,
                               const std::array<double, 9>& axes) {
    return anisotropic(stiffness, axes, 1).stiffness;
  });
  py::class_<PythonShell>(module, "Shell")
      .def(py::init([](double offset, const Vector3& axis_1, bool is_isotropic) {
        return PythonShell{{}, {}, {offset, axis_1, is_isotropic}};
      }))
      .def("add", &PythonShell::add)
      .def("finish", &PythonShell::finish)
      .def("law",
           [](const PythonShell& shell) {
             return py::make_tuple(array_of(shell.law.ABD), array_of(shell.law.shear));
           })
      .def("plane_stress",
           [](const PythonShell& shell, std::size_t layer) {
             return array_of(plane_stress(shell.layers.at(layer)));
           })
      .def("heat_strain",
           [](const PythonShell& shell, std::size_t layer) {
             return array_of(heat_strain(shell.layers.at(layer)));
           })
      .def("heat_resultants",
           [](const PythonShell& shell) {
             return array_of(heat_resultants(shell.layers));
           })
      .def("strains", &shell_strain_arrays)
      .def("hold", &hold_shells);
  py::class_<PythonBody>(module, "Body")
      .def(py::init<std::intptr_t, const std::string&>())
      .def("set_law", &PythonBody::set_law)
      .def("set_petsc", &PythonBody::set_petsc)
      .def("set_csr", &PythonBody::set_csr)
      .def("set_ports", &PythonBody::set_ports)
      .def("set_damping", &PythonBody::set_damping)
      .def("set_dofs", &PythonBody::set_dofs)
      .def("rows", [](const PythonBody& b) {
        return std::pair(b.body.model.rows.begin, b.body.model.rows.end);
      });
  py::class_<Reduction>(module, "Reduction")
      .def("save", &Reduction::save)
      .def("fields", &Reduction::fields);
  py::class_<PythonMedium>(module, "Medium")
      .def("save", &PythonMedium::save)
      .def("cut", &PythonMedium::cut)
      .def("fields", &PythonMedium::fields);
  module.def("reduce", &reduce_call, py::arg("comm"), py::arg("body"),
             py::arg("options"));
  module.def("certify", &certify_call, py::arg("comm"), py::arg("body"),
             py::arg("options"));
  module.def("load_medium", &load_medium, py::arg("comm"), py::arg("path"));
  py::register_exception_translator([](std::exception_ptr pointer) {
    try {
      if (pointer) std::rethrow_exception(pointer);
    } catch (const Interrupted&) {
      PyErr_SetString(PyExc_KeyboardInterrupt, "between the steps of flexgram's work");
    } catch (const Error& error) {
      const auto kind = py::module_::import("flexgram.basics").attr("BodyError");
      PyErr_SetString(kind.ptr(), option_names(error.what()).c_str());
    }
  });
}
