#include "io/body_io.hpp"

#include "base/index.hpp"
#include "base/text.hpp"
#include "io/laws.hpp"
#include "io/matlab_hdf5.hpp"
#include "io/output_form.hpp"
#include "linalg/sparse.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>

namespace flexgram {
namespace {

long long ll(std::int64_t value) { return static_cast<long long>(value); }

/// By columns, as the file has them, and taken for rows: the transpose.
Matrix read_transposed(const Hdf5File& file, const std::string& group, PetscInt n,
                       RowRange rows) {
  const std::int64_t columns = sparse_columns(file, group);
  const std::int64_t row_count = sparse_rows(file, group, columns);
  if (columns != n || row_count != n)
    fail(file, text("%s is %lld × %lld, expected %lld × %lld like K", group.c_str(),
                    ll(row_count), ll(columns), ll(n), ll(n)));
  LocalRows local;
  agree(file.comm(), [&] {
    local = to_rows(file, group, read_columns(file, group, rows.begin, rows.size(), n));
  });
  return make_sparse(file.comm(), rows, n, local);
}

Matrix read_symmetric(const Hdf5File& file, const std::string& group, PetscInt n,
                      RowRange rows, std::vector<std::string>& remarks) {
  Matrix matrix = read_transposed(file, group, n, rows);
  take_symmetric_part(matrix, group, "file " + file.path(), remarks);
  return matrix;
}

void expect_columns(const Hdf5File& file, const std::string& object, std::int64_t ports) {
  if (ports == 0) fail(file, text("%s has no columns", object.c_str()));
}

/// Ports stored as a sparse matrix: n × k, or k × n where `transposed`. Put in place: of
/// thousands of ports they are the largest part of a body.
Block read_sparse_ports(const Hdf5File& file, const std::string& object, PetscInt n,
                        RowRange rows, bool transposed, const char* expected) {
  const std::int64_t columns = sparse_columns(file, object);
  const std::int64_t row_count = sparse_rows(file, object, n);
  if ((transposed ? columns : row_count) != n)
    fail(file, text("%s is %lld × %lld, expected %s with n = %lld", object.c_str(),
                    ll(row_count), ll(columns), expected, ll(n)));
  const std::int64_t ports = transposed ? row_count : columns;
  expect_columns(file, object, ports);
  Block block(file.comm(), rows, n, static_cast<PetscInt>(ports));
  agree(file.comm(), [&] {
    Block::Access access(block);
    const auto local = access.all();
    std::fill(local.begin(), local.end(), 0.0);
    const SparseColumns entries = read_columns(file, object, 0, columns, row_count);
    for (std::int64_t j = 0; j < columns; ++j)
      for (std::int64_t k = entries.start[as_size(j)]; k < entries.start[as_size(j) + 1];
           ++k) {
        const std::int64_t i = entries.row[as_size(k)];
        const std::int64_t row = transposed ? j : i, port = transposed ? i : j;
        if (row >= rows.begin && row < rows.end)
          local[as_size(row - rows.begin + port * rows.size())] +=
              entries.value[as_size(k)];
      }
  });
  return block;
}

Block read_dense_ports(const Hdf5File& file, const std::string& object, PetscInt n,
                       RowRange rows, bool transposed, const char* expected) {
  auto shape = file.shape(object);
  if (shape.size() == 1) shape.push_back(1);
  if (shape.size() != 2)
    fail(file, text("%s must be a matrix, %s; it has %zu dimensions", object.c_str(),
                    expected, shape.size()));
  // In the file's row-major order, n is the last dimension exactly if one of the two
  // reversals (MATLAB's storage, C's transposition) applies.
  const bool n_last = by_columns(file, object) != transposed;
  if (shape.size() != 2 || shape[n_last ? 1 : 0] != n) {
    const bool reversed = by_columns(file, object) && shape.size() == 2;
    fail(file,
         text("%s is %lld × %lld, expected %s with n = %lld", object.c_str(),
              ll(shape[reversed ? 1 : 0]), ll(shape[reversed ? 0 : 1]), expected, ll(n)));
  }
  const std::int64_t ports = shape[n_last ? 0 : 1];
  expect_columns(file, object, ports);
  std::vector<double> local; // column-major, rows.size() × ports
  agree(file.comm(), [&] {
    const bool one_dimension = file.shape(object).size() == 1;
    local = file.read<double>(object, rows.begin, rows.size(),
                              n_last && !one_dimension ? 1 : 0);
    if (!n_last) {
      std::vector<double> columns(local.size());
      for (PetscInt i = 0; i < rows.size(); ++i)
        for (std::int64_t j = 0; j < ports; ++j)
          columns[as_size(i + j * rows.size())] = local[as_size(i * ports + j)];
      local.swap(columns);
    }
    for (double value : local)
      if (!std::isfinite(value))
        fail(file,
             text("%s holds %g: every entry must be finite", object.c_str(), value));
  });
  Block block(file.comm(), rows, n, static_cast<PetscInt>(ports));
  std::copy(local.begin(), local.end(), Block::Access(block).all().begin());
  return block;
}

/// Dense or sparse n × k (or k × n where `transposed`: C is r × n in the file, n × r
/// here).
Block read_ports(const Hdf5File& file, const std::string& object, PetscInt n,
                 RowRange rows, bool transposed) {
  const char* expected = transposed ? "n_out × n" : "n × n_in";
  return file.is_group(object)
             ? read_sparse_ports(file, object, n, rows, transposed, expected)
             : read_dense_ports(file, object, n, rows, transposed, expected);
}

std::vector<std::string> port_names(const Hdf5File& file, const std::string& object,
                                    PetscInt count, const char* prefix) {
  std::vector<std::string> names;
  if (file.has_attribute(object, "names")) {
    names = file.texts_attribute(object, "names");
    if (static_cast<PetscInt>(names.size()) != count)
      fail(file, text("%s has %lld ports and %zu names", object.c_str(), ll(count),
                      names.size()));
    for (const std::string& name : names)
      if (name.find_first_not_of(' ') == std::string::npos ||
          std::any_of(name.begin(), name.end(),
                      [](unsigned char c) { return c < 0x20 || c == 0x7f; }))
        fail(file, text("%s: a port's name is empty or holds control characters",
                        object.c_str()));
    auto sorted = names;
    std::sort(sorted.begin(), sorted.end());
    const auto twice = std::adjacent_find(sorted.begin(), sorted.end());
    if (twice != sorted.end())
      fail(file, text("%s has two ports named %s", object.c_str(), twice->c_str()));
  } else {
    for (PetscInt i = 0; i < count; ++i)
      names.push_back(text("%s%lld", prefix, ll(i + 1)));
  }
  return names;
}

} // namespace

void read_dof_map(const Hdf5File& file, SecondOrderModel& model) {
  if (!file.exists("/dofs/node")) return;
  const auto check = [&](const char* name) {
    if (vector_length(file, name) != model.n)
      fail(file, text("%s has %lld entries, expected one for each of the %lld rows", name,
                      ll(vector_length(file, name)), ll(model.n)));
  };
  check("/dofs/node");
  if (file.exists("/dofs/component")) check("/dofs/component");
  agree(file.comm(), [&] {
    const auto first = model.rows.begin, count = model.rows.size();
    model.node = read_vector<std::int64_t>(file, "/dofs/node", first, count);
    if (file.exists("/dofs/component")) {
      model.component = read_vector<std::int64_t>(file, "/dofs/component", first, count);
      for (auto component : model.component)
        if (component < 0 || component > 5)
          fail(file, text("/dofs/component holds %lld, expected 0 to 5", ll(component)));
    }
    if (file.exists("/nodes/id")) {
      const auto ids = file.read_all<std::int64_t>("/nodes/id");
      for (auto node : model.node) {
        if (node < 0 || node >= static_cast<std::int64_t>(ids.size()))
          fail(file, text("/dofs/node holds %lld, /nodes/id has %zu nodes (0-based)",
                          ll(node), ids.size()));
        model.label.push_back(ids[as_size(node)]);
      }
    }
    if (!file.exists("/nodes/position")) return;
    const auto shape = file.shape("/nodes/position");
    const bool reversed = by_columns(file, "/nodes/position");
    if (shape.size() != 2 || shape[reversed ? 0 : 1] != 3)
      fail(file, "/nodes/position must be nodes × 3");
    const std::int64_t nodes = shape[reversed ? 1 : 0];
    const auto all = file.read_all<double>("/nodes/position");
    for (auto node : model.node) {
      if (node < 0 || node >= nodes)
        fail(file, text("/dofs/node holds %lld, /nodes/position has %lld nodes (0-based)",
                        ll(node), ll(nodes)));
      for (std::int64_t axis = 0; axis < 3; ++axis) {
        const double x = all[as_size(reversed ? axis * nodes + node : 3 * node + axis)];
        if (!std::isfinite(x))
          fail(file, text("/nodes/position of node %lld holds %g", ll(node), x));
        model.position.push_back(x);
      }
    }
  });
}

namespace {

constexpr double rounding_of_symmetry = 1e-10;

/// (A ± Aᵀ)/2 in a matrix of its own: A may be somebody else's.
Matrix half(Mat a, Symmetry of) {
  Matrix part;
  FG_CALL(MatTranspose(a, MAT_INITIAL_MATRIX, part.out()));
  const bool skew = of == Symmetry::skew;
  if (skew) FG_CALL(MatScale(part, -1));
  FG_CALL(MatAXPY(part, 1.0, a, DIFFERENT_NONZERO_PATTERN));
  FG_CALL(MatScale(part, 0.5));
  FG_CALL(MatSetOption(part, MAT_SYMMETRIC, skew ? PETSC_FALSE : PETSC_TRUE));
  return part;
}

void refuse_one_triangle(const Asymmetry& asymmetry, const std::string& name,
                         const std::string& source) {
  if (asymmetry.one_triangle)
    throw Error(text("%s: %s holds only one triangle; both are expected (in MATLAB: "
                     "K + triu(K,1)')",
                     source.c_str(), name.c_str()));
}

void add_gyroscopic(SecondOrderModel& model, Matrix G) {
  for (auto& [law, matrix] : model.terms)
    if (law == Law(Law::Kind::gyroscopic)) {
      FG_CALL(MatAXPY(matrix, 1.0, G, DIFFERENT_NONZERO_PATTERN));
      return;
    }
  model.terms.push_back({Law::Kind::gyroscopic, std::move(G)});
}

} // namespace

void add_damping(SecondOrderModel& model, Matrix D, const std::string& source) {
  const Asymmetry asymmetry = find_asymmetry(D, rounding_of_symmetry);
  if (asymmetry.symmetric) {
    take_symmetric_part(D, "D", source, model.remarks);
  } else {
    constexpr double rounding = 1e-14; // of a skew matrix that somebody computed
    refuse_one_triangle(asymmetry, "D", source);
    add_gyroscopic(model, half(D, Symmetry::skew));
    D = half(D, Symmetry::symmetric);
    PetscReal size = 0;
    FG_CALL(MatNorm(D, NORM_FROBENIUS, &size));
    if (size <= rounding * asymmetry.norm) FG_CALL(MatZeroEntries(D));
    model.remarks.push_back(
        text("the skew part of D, %.1e of it, is taken for gyroscopic "
             "forces",
             asymmetry.skew_norm / asymmetry.norm));
  }
  model.terms.push_back({Law(), std::move(D)});
}

void set_stiffness(SecondOrderModel& model, Matrix K, const std::string& source) {
  const Asymmetry asymmetry = find_asymmetry(K, rounding_of_symmetry);
  if (asymmetry.symmetric) {
    take_symmetric_part(K, "K", source, model.remarks);
  } else {
    refuse_one_triangle(asymmetry, "K", source);
    model.terms.push_back(
        {Law(skew_part_of_K, "circulatory", {}), half(K, Symmetry::skew)});
    K = half(K, Symmetry::symmetric);
    model.remarks.push_back(text(
        "the skew part of K, %.1e of it, is taken for circulatory forces; the "
        "largest is (%lld, %lld) = %.6g beside (%lld, %lld) = %.6g",
        asymmetry.skew_norm / asymmetry.norm, ll(asymmetry.row), ll(asymmetry.column),
        asymmetry.upper, ll(asymmetry.column), ll(asymmetry.row), asymmetry.lower));
    constexpr int few = 3;
    if (asymmetry.pairs <= few)
      model.doubts.push_back(text(
          "%s: K is symmetric but for %lld pair%s of entries, (%lld, %lld) = %.6g and "
          "(%lld, %lld) = %.6g: taken for circulatory forces (of friction, of loads "
          "that follow). Is that meant?",
          source.c_str(), ll(asymmetry.pairs), asymmetry.pairs == 1 ? "" : "s",
          ll(asymmetry.row), ll(asymmetry.column), asymmetry.upper, ll(asymmetry.column),
          ll(asymmetry.row), asymmetry.lower));
  }
  model.K = std::move(K);
}

void add_skew(SecondOrderModel& model, const Law& law, Matrix G,
              const std::string& source) {
  Matrix part = half(G, Symmetry::skew);
  PetscReal whole = 0, skew = 0;
  FG_CALL(MatNorm(G, NORM_FROBENIUS, &whole));
  FG_CALL(MatNorm(part, NORM_FROBENIUS, &skew));
  if (!(skew >= (1 - rounding_of_symmetry) * whole))
    throw Error(text("%s: %s is not skew, Gᵀ = −G: its symmetric part belongs to D",
                     source.c_str(), law.name().c_str()));
  if (law.is_named())
    model.terms.push_back({law, std::move(part)});
  else
    add_gyroscopic(model, std::move(part));
}

void take_symmetric_part(Matrix& matrix, const std::string& name,
                         const std::string& source, std::vector<std::string>& remarks) {
  const Asymmetry asymmetry = find_asymmetry(matrix, rounding_of_symmetry);
  if (asymmetry.symmetric && asymmetry.skew_norm == 0) return;
  if (asymmetry.symmetric) {
    matrix = half(matrix, Symmetry::symmetric);
    remarks.push_back(
        text("%s is replaced by its symmetric part; the skew part is %.1e of it",
             name.c_str(), asymmetry.skew_norm / asymmetry.norm));
    return;
  }
  refuse_one_triangle(asymmetry, name, source);
  const char* kind =
      name.back() == 'M' ? "no mass matrix has one" : "no loss factors give one";
  throw Error(
      text("%s: %s is not symmetric: (%lld, %lld) = %.17g but (%lld, %lld) = %.17g; its "
           "skew part (%s) is %.1e of it, and only K and D may have one",
           source.c_str(), name.c_str(), ll(asymmetry.row), ll(asymmetry.column),
           asymmetry.upper, ll(asymmetry.column), ll(asymmetry.row), asymmetry.lower,
           kind, asymmetry.skew_norm / asymmetry.norm));
}

bool holds_mesh(const Hdf5File& file) {
  const bool mesh = file.exists("/mesh");
  if (file.exists("/gramian"))
    fail(file,
         "this is a reduced file, not a body: reduce its body once more for another "
         "band or tolerance; flexgram sweep BODY ROM compares both");
  if (file.exists("/projected") && file.exists("/spec"))
    fail(file, "this is a medium model, not a body; flexgram cut takes it");
  if (!mesh && file.exists("/H") && file.exists("/omega"))
    fail(file, "this is a sweep file, not a body; flexgram plot takes it");
  if (!mesh && !file.exists("/K"))
    fail(file, "neither /K (a body of matrices) nor /mesh (a body to assemble) is there");
  return mesh;
}

Damping read_damping(const Hdf5File& file) {
  Damping damping;
  const auto number = [&](const std::string& name) {
    double value = 0;
    if (file.has_attribute("/", name))
      value = file.number_attribute("/", name);
    else if (file.exists("/" + name)) {
      if (vector_length(file, "/" + name) != 1)
        fail(file, text("%s must be one number", name.c_str()));
      value = file.read_all<double>("/" + name).front();
    }
    if (!std::isfinite(value) || value < 0)
      fail(file,
           text("%s = %g: damping must be finite and not negative", name.c_str(), value));
    return value;
  };
  agree(file.comm(), [&] { damping = {number("alpha"), number("beta"), number("eta")}; });
  return damping;
}

namespace {

/// Whether α, β and η hold all of the term, and so take it over.
bool is_proportional(const Term<Matrix>& term, SecondOrderModel& model) {
  const auto& [law, T] = term;
  PetscReal largest = 0, size = 0; // of row sums: squares may overflow
  FG_CALL(MatNorm(T, NORM_INFINITY, &largest));
  if (!(largest < 1e120))
    throw Error(text("%s has entries of %.0e, which doubles cannot square: are its units "
                     "right?",
                     law.name().c_str(), largest));
  FG_CALL(MatNorm(T, NORM_FROBENIUS, &size));
  if (size == 0) return true;
  if (law.is_named() || law.is_skew()) return false;
  const ProportionalFit fit = fit_proportional(T, model.M, model.K, 1e-12);
  if (!fit.proportional || fit.alpha < 0 || fit.beta < 0) return false;
  if (law.is_viscous()) {
    model.damping.alpha += fit.alpha;
    model.damping.beta += fit.beta;
    return true;
  }
  if (fit.alpha > 0) return false; // of M: no loss factor
  model.damping.eta += fit.beta;
  return true;
}

} // namespace

void classify_damping(SecondOrderModel& model) {
  for (const auto& one : model.terms)
    if (one.law.is_named() &&
        std::count_if(model.terms.begin(), model.terms.end(), [&](const auto& other) {
          return other.law.name() == one.law.name();
        }) > 1)
      throw Error(
          text("two terms are named %s: the skew part of K has that name, give the "
               "other one another",
               one.law.name().c_str()));
  std::vector<Term<Matrix>> left;
  for (auto& term : model.terms)
    if (!is_proportional(term, model)) left.push_back(std::move(term));
  model.terms = std::move(left);
}

std::string not_read(const Hdf5File& file) {
  static const std::vector<std::string> of_matrices{
      "K",    "M",    "D",        "S",           "G",           "terms",      "B",
      "C",    "dofs", "nodes",    "feedthrough", "output_beta", "output_eta", "alpha",
      "beta", "eta",  "rounding", "geometry",    "interfaces"},
      of_meshes{"mesh",     "materials", "sections",    "interfaces",
                "supports", "loads",     "outputs",     "preload",
                "spin",     "fields",    "masses",      "springs",
                "alpha",    "beta",      "constraints", "eta"};
  const auto& known = file.exists("/mesh") ? of_meshes : of_matrices;
  std::vector<std::string> others;
  for (const std::string& name : file.children("/"))
    if (std::find(known.begin(), known.end(), name) == known.end() && !name.empty() &&
        name.front() != '#') // MATLAB's own
      others.push_back("/" + name);
  if (others.empty()) return "";
  return text("%s of %s is not read: a body has %s", join(others).c_str(),
              file.path().c_str(), join(known).c_str());
}

SecondOrderModel read_body(const Hdf5File& file) {
  SecondOrderModel model;
  model.name = file.path();
  model.comm = file.comm();
  model.n = static_cast<PetscInt>(sparse_columns(file, "/K"));
  if (model.n < 1) fail(file, "/K is empty");
  model.rows = even_rows(model.comm, model.n);
  const std::string source = "file " + file.path();
  const auto transposed = [](const Matrix& a) {
    Matrix other;
    FG_CALL(MatTranspose(a, MAT_INITIAL_MATRIX, other.out()));
    return other;
  };
  Matrix K = read_transposed(file, "/K", model.n, model.rows);
  const bool is_symmetric = find_asymmetry(K, rounding_of_symmetry).symmetric;
  set_stiffness(model, is_symmetric ? std::move(K) : transposed(K), source);
  model.M = read_symmetric(file, "/M", model.n, model.rows, model.remarks);
  model.damping = read_damping(file);
  for (const Law& law : read_laws(file)) {
    Matrix T = read_transposed(file, law.path(), model.n, model.rows);
    if (law.is_skew()) {
      add_skew(model, law, transposed(T), source);
    } else if (law.is_viscous()) {
      const bool symmetric = find_asymmetry(T, rounding_of_symmetry).symmetric;
      add_damping(model, symmetric ? std::move(T) : transposed(T), source);
    } else {
      take_symmetric_part(T, law.path(), source, model.remarks);
      model.terms.push_back({law, std::move(T)});
    }
  }
  agree(file.comm(), [&] {
    if (file.has_attribute("/", "rounding"))
      model.rounding = file.number_attribute("/", "rounding");
    if (!(model.rounding >= 0 && model.rounding < 1))
      fail(file, text("rounding = %g: must be from 0 to 1", model.rounding));
  });
  model.damp_parameters(); // not by what α, β and η take over from D and S
  classify_damping(model);

  if (!file.exists("/B")) fail(file, "dataset /B (input map, n × n_in) is missing");
  model.B = read_ports(file, "/B", model.n, model.rows, false);
  model.inputs = port_names(file, "/B", model.B.columns(), "in");
  model.outputs_are_inputs = !file.exists("/C");
  if (model.outputs_are_inputs) {
    model.C = model.B.share();
    model.outputs = model.inputs;
  } else {
    model.C = read_ports(file, "/C", model.n, model.rows, true);
    model.outputs = port_names(file, "/C", model.C.columns(), "out");
  }
  agree(file.comm(), [&] { read_output_form(file, model); });
  read_dof_map(file, model);
  return model;
}

} // namespace flexgram
