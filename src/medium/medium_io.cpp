/// The file of a certified medium model: what Medium, its levels and their certificates
/// hold, each field by its name, once for writing and reading (`archive`).

#include "medium/medium_io.hpp"

#include "base/index.hpp"
#include "base/text.hpp"
#include "io/archive.hpp"
#include "io/body_io.hpp"
#include "io/kept_rows.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <set>
#include <type_traits>

namespace flexgram {
namespace {

constexpr double version = 15; // of the file's layout

/// Values of parameters, each combination a column.
template <class Archive, class List>
void archive_values(Archive&& a, const char* name, List& list) {
  Dense columns(list.empty() ? 0 : static_cast<int>(list.front().size()),
                static_cast<int>(list.size()));
  for (std::size_t k = 0; k < list.size(); ++k)
    std::copy(list[k].begin(), list[k].end(), columns.column(static_cast<int>(k)));
  a(name, columns);
  if constexpr (!std::is_const_v<List>)
    for (int k = 0; k < columns.columns; ++k)
      list.emplace_back(columns.column(k), columns.column(k) + columns.rows);
}

template <class Archive, class Spec>
void archive_spec(Archive&& a, Spec& spec) {
  std::vector<double> ends;
  for (const Interval& band : spec.bands)
    ends.insert(ends.end(), {band.first, band.last});
  bool to_band = spec.relative_to == RelativeTo::band,
       to_elastic = spec.relative_to == RelativeTo::elastic,
       to_both = spec.relative_to == RelativeTo::both;
  a("bands", ends);
  a("last_needed", spec.last_needed);
  a("target", spec.target);
  a("cutoff_factor", spec.cutoff);
  a("modes_wanted", spec.modes);
  a("order_limit", spec.limit);
  a("relative_to_band", to_band);
  a("relative_to_elastic", to_elastic);
  a("relative_to_both", to_both);
  a("each_kind", spec.kinds.each);
  a("kinds", spec.kinds.kinds);
  a("kinds_allowed", spec.kinds.allowed);
  a("others_allowed", spec.kinds.others);
  archive_values(a, "parameter_values", spec.values);
  archive_values(a, "parameter_values_between", spec.between);
  if constexpr (!std::is_const_v<Spec>) {
    spec.relative_to = to_band      ? RelativeTo::band
                       : to_elastic ? RelativeTo::elastic
                       : to_both    ? RelativeTo::both
                                    : RelativeTo::pointwise;
    for (std::size_t i = 0; i + 1 < ends.size(); i += 2)
      spec.bands.push_back({ends[i], ends[i + 1]});
  }
}

template <class Archive, class M>
void archive_medium(Archive&& a, M& m) {
  auto& body = m.body;
  a("body", body.name);
  a("alpha", body.damping.alpha);
  a("beta", body.damping.beta);
  a("eta", body.damping.eta);
  a("outputs_are_inputs", body.outputs_are_inputs);
  a("inputs", body.inputs);
  a("outputs", body.outputs);
  a("remarks", body.remarks);
  a("feedthrough_outputs", body.feedthrough.outputs);
  a("feedthrough_inputs", body.feedthrough.inputs);
  a("feedthrough", body.feedthrough.values);
  a("damped_outputs", body.output_damping.outputs);
  a("damped_outputs_beta", body.output_damping.beta);
  a("damped_outputs_eta", body.output_damping.eta);
  a("rigid", m.rigid);
  a("modes", m.modes);
  a("cutoff", m.cutoff);
  a("reference", m.reference);
  a("tau", m.tau);
  a("kappa", m.kappa);
  a("scale", m.scale);
  a("shortfall", m.shortfall);
  a("loss_of_orthogonality", m.loss_of_orthogonality);
  a("printed_rounding", m.printed_rounding);
  a("factorisations", m.factorisations);
  a("solved_columns", m.solved_columns);
}

template <class Archive, class Integrals>
void archive_integrals(Archive&& a, Integrals& i) {
  std::vector<double> centre(i.centre.begin(), i.centre.end());
  a("mass", i.mass);
  a("centre", centre);
  a("M_r", i.M_r);
  a("M_er", i.M_er);
  a("gyroscopic", i.gyroscopic);
  a("inertia_first", i.inertia_first);
  a("inertia_second", i.inertia_second);
  a("stiffening_loads", i.stiffening.loads);
  a("stiffening", i.stiffening.matrices);
  a("stiffening_held", i.stiffening.held);
  a("stiffening_resultants", i.stiffening.resultants);
  if constexpr (!std::is_const_v<Integrals>)
    for (std::size_t c = 0; c < 3 && c < centre.size(); ++c) i.centre[c] = centre[c];
}

/// Numbers of a law, those of one name a column; NaN after the last of a short one.
Dense columns_of(const LawNumbers& numbers) {
  if (numbers.empty()) return {};
  std::size_t most = 0;
  for (const auto& [name, values] : numbers) most = std::max(most, values.size());
  Dense columns(static_cast<int>(most), static_cast<int>(numbers.size()));
  std::fill(columns.data.begin(), columns.data.end(),
            std::numeric_limits<double>::quiet_NaN());
  int j = 0;
  for (const auto& [name, values] : numbers)
    std::copy(values.begin(), values.end(), columns.column(j++));
  return columns;
}

Law law_of(const std::string& name, const std::string& kind, const Dense& columns) {
  const auto all = numbers_of_law(kind);
  const std::set<std::string> names(all.begin(), all.end());
  if (names.size() != as_size(columns.columns))
    throw Error(text("law %s has %d columns of numbers: it is damaged", kind.c_str(),
                     columns.columns));
  LawNumbers numbers;
  int j = 0;
  for (const std::string& number : names) {
    const double* values = columns.column(j++);
    numbers[number].assign(values, std::find_if(values, values + columns.rows,
                                                [](double x) { return std::isnan(x); }));
  }
  return {name, kind, numbers};
}

/// The terms with their laws.
template <class Archive, class Terms>
void archive_terms(Archive&& a, Terms& terms) {
  std::vector<Dense> matrices;
  std::vector<std::string> names, kinds;
  std::vector<Dense> numbers; // of each law, columns in the order of its maker's
  for (const auto& [law, matrix] : terms) {
    matrices.push_back(matrix);
    names.push_back(law.name());
    kinds.push_back(law.kind_name());
    numbers.push_back(columns_of(law.kind().numbers()));
  }
  a("terms", matrices);
  a("term_names", names);
  a("laws", kinds);
  a("law_numbers", numbers);
  if constexpr (!std::is_const_v<Terms>) {
    if (names.size() != matrices.size() || kinds.size() != matrices.size() ||
        numbers.size() != matrices.size())
      throw Error("terms and laws do not fit each other: it is damaged");
    for (std::size_t t = 0; t < matrices.size(); ++t)
      terms.push_back({law_of(names[t], kinds[t], numbers[t]), std::move(matrices[t])});
  }
}

/// Whether a matrix has these sizes.
auto is_of(int rows, int columns) {
  return [=](const Dense& a) { return a.rows == rows && a.columns == columns; };
}

/// The projected matrices of a level are the leading parts of the last level's.
DenseSystem leading(const DenseSystem& all, int order) {
  DenseSystem part;
  const auto corner = [&](const Dense& a) { return part_of(a, 0, order, 0, order); };
  part.M = corner(all.M);
  part.K = corner(all.K);
  for (const auto& [law, T] : all.terms) part.terms.push_back({law, corner(T)});
  part.B = part_of(all.B, 0, order, 0, all.B.columns);
  part.C = part.B;
  part.damping = all.damping;
  part.negligible = all.negligible;
  return part;
}

/// Uᵀ(K + τM)U = I and UᵀMU = diag(1/(λ + τ)).
void expect_coordinates(const Hdf5File& file, const DenseSystem& system, double tau,
                        const Dense& U, const std::vector<double>& lambda) {
  Dense E = system.K;
  add_to(E, system.M, tau);
  const Dense one = multiply_transposed(U, multiply(E, U)),
              m = multiply_transposed(U, multiply(system.M, U));
  double worst = 0;
  for (int j = 0; j < U.columns; ++j)
    for (int i = 0; i < U.columns; ++i) {
      const double mass = i == j ? 1 / (lambda[as_size(i)] + tau) : 0.0;
      worst = std::max({worst, std::abs(one(i, j) - (i == j ? 1 : 0)),
                        tau * std::abs(m(i, j) - mass)});
    }
  if (!(worst < 1e-6))
    throw Error(
        text("file %s: its projected matrices and modes do not fit each other: it "
             "is damaged",
             file.path().c_str()));
}

/// What later calls take for granted.
void check(const Hdf5File& file, const Medium& m, const DenseSystem& all) {
  const int ports = static_cast<int>(
      m.body.inputs.size() + (m.body.outputs_are_inputs ? 0 : m.body.outputs.size()));
  const int N = all.K.rows;
  const auto square = [&](const Dense& a) { return a.rows == N && a.columns == N; };
  bool good = N > 0 && ports > 0 && square(all.K) && square(all.M) && all.B.rows == N &&
              all.B.columns == ports && m.scale.size() == as_size(all.B.columns) &&
              m.rigid >= 0 && m.modes >= 0 && m.rigid + m.modes <= N &&
              !m.spec.bands.empty() && !m.levels.empty() && m.tau > 0 &&
              m.reference > 0 && m.cutoff > m.reference && m.levels.back().order() == N &&
              m.body.n >= N;
  for (const Interval& band : m.spec.bands)
    good = good && band.first >= 0 && band.first <= band.last;
  const Feedthrough& direct = m.body.feedthrough;
  good = good && direct.inputs.size() == direct.values.size() &&
         direct.outputs.size() == direct.values.size();
  const OutputDamping& damped = m.body.output_damping;
  good = good && damped.beta.size() == damped.outputs.size() &&
         damped.eta.size() == damped.outputs.size();
  for (double s : m.scale) good = good && s > 0;
  for (const MediumLevel& level : m.levels)
    good = good && m.rigid + m.modes <= level.order() &&
           level.certificate->fits(level.order(), ports, m.rigid + m.modes, m.rigid,
                                   all.terms.size());
  for (const auto& [law, T] : all.terms) good = good && square(T);
  const std::size_t parameters = parameters_of(all.terms).size();
  good = good && m.spec.values.empty() == (parameters == 0);
  for (const auto* list : {&m.spec.values, &m.spec.between})
    for (const ParameterValues& values : *list)
      good = good && values.size() == parameters;
  if (m.integrals) {
    const FrameIntegrals& i = *m.integrals;
    good = good && i.M_r.rows == 6 && i.M_r.columns == 6 && i.M_er.rows == N &&
           i.M_er.columns == 6 && i.gyroscopic.rows == N &&
           i.gyroscopic.columns == 3 * N && i.inertia_first.rows == 3 &&
           i.inertia_first.columns == 3 * N && i.inertia_second.rows == 3 * N &&
           i.inertia_second.columns == 3 * N &&
           i.stiffening.loads.size() == i.stiffening.matrices.size();
    for (const Dense& K : i.stiffening.matrices) good = good && square(K);
    const LoadMatrices& loads = i.stiffening;
    good = good && (loads.held.empty() || (loads.resultants.rows == 6 &&
                                           as_size(loads.resultants.columns) ==
                                               loads.loads.size() + loads.held.size()));
  }
  if (!good)
    throw Error(text("file %s: its parts do not fit each other: it is damaged, certify "
                     "again",
                     file.path().c_str()));
}

} // namespace

void write_levels(Hdf5File& file, const Medium& m) {
  file.set_attribute("/", "flexgram_medium", version);
  file.set_attribute("/", "flexgram", std::string(FLEXGRAM_VERSION));
  file.set_attribute("/", "n", static_cast<double>(m.body.n));
  archive_medium(FieldWriter(file, "/"), m);
  archive_spec(FieldWriter(file, "/spec"), m.spec);
  file.set_attribute("/", "levels", static_cast<double>(m.levels.size()));
  if (m.levels.empty()) return;
  const DenseSystem& all = m.levels.back().response->system();
  FieldWriter system(file, "/projected");
  system("K", all.K);
  system("M", all.M);
  archive_terms(system, all.terms);
  system("ports", all.B);
  for (std::size_t k = 0; k < m.levels.size(); ++k) {
    const MediumLevel& level = m.levels[k];
    const std::string group = text("/level_%zu", k);
    FieldWriter a(file, group);
    a("U", level.response->U());
    a("lambda", level.response->lambda());
    a("inputs", level.response->modal_inputs());
    a("terms", level.response->modal_terms());
    a("complete", level.complete);
    a("worst", level.worst);
    a("proved", level.proved);
    Certificate::archive(FieldWriter(file, group + "/certificate"), *level.certificate);
  }
}

void read_levels(const Hdf5File& file, Medium& m) {
  const std::string& path = file.path();
  if (!file.has_attribute("/", "flexgram_medium"))
    throw Error(
        text("file %s is no medium model: flexgram certify makes one", path.c_str()));
  const double layout = file.number_attribute("/", "flexgram_medium");
  if (layout != version || file.text_attribute("/", "flexgram") != FLEXGRAM_VERSION)
    throw Error(text("file %s was written by another version of flexgram", path.c_str()));
  const double n = file.number_attribute("/", "n");
  if (!(n >= 1) || n > 2e9) throw Error(text("file %s: n is damaged", path.c_str()));
  m.body.comm = file.comm();
  m.body.n = static_cast<PetscInt>(n);
  archive_medium(FieldReader(file, "/"), m);
  archive_spec(FieldReader(file, "/spec"), m.spec);
  int levels = 0;
  FieldReader(file, "/")("levels", levels);
  if (levels <= 0) return;
  DenseSystem all;
  FieldReader system(file, "/projected");
  system("K", all.K);
  system("M", all.M);
  archive_terms(system, all.terms);
  system("ports", all.B);
  all.damping = m.body.damping;
  all.negligible = negligible_rounding(m.spec.target);
  for (int k = 0; k < levels; ++k) {
    MediumLevel level;
    const std::string group = text("/level_%d", k);
    FieldReader a(file, group);
    Dense U, inputs;
    std::vector<Dense> terms;
    std::vector<double> lambda;
    a("U", U);
    a("lambda", lambda);
    a("inputs", inputs);
    a("terms", terms);
    a("complete", level.complete);
    a("worst", level.worst);
    a("proved", level.proved);
    if (U.rows != U.columns || U.rows < 1 || U.rows > all.K.rows || U.rows > all.B.rows ||
        lambda.size() != as_size(U.rows) || inputs.rows != U.rows ||
        inputs.columns != all.B.columns || terms.size() != all.terms.size() ||
        !std::all_of(terms.begin(), terms.end(), is_of(U.rows, U.rows)) ||
        std::any_of(all.terms.begin(), all.terms.end(),
                    [&](const auto& term) {
                      return term.matrix.rows < U.rows || term.matrix.columns < U.rows;
                    }) ||
        U.rows > all.K.columns || U.rows > all.M.rows || U.rows > all.M.columns)
      throw Error(
          text("file %s: %s does not fit: it is damaged", path.c_str(), group.c_str()));
    const int order = U.rows;
    expect_coordinates(file, leading(all, order), m.tau, U, lambda);
    level.response = std::make_shared<DenseResponse>(leading(all, order), m.tau,
                                                     std::move(U), std::move(lambda),
                                                     std::move(inputs), std::move(terms));
    auto certificate = std::make_shared<Certificate>();
    Certificate::archive(FieldReader(file, group + "/certificate"), *certificate);
    level.certificate = std::move(certificate);
    m.levels.push_back(std::move(level));
  }
  if (file.exists("/frame")) {
    m.integrals.emplace();
    archive_integrals(FieldReader(file, "/frame"), *m.integrals);
  }
  check(file, m, all);
  for (MediumLevel& level : m.levels)
    if (!all.terms.empty() && m.spec.values.empty())
      level.certificate =
          std::make_shared<const Certificate>(level.certificate->at(*level.response));
}

void write_medium(const Medium& m, bool basis,
                  const std::map<std::string, std::string>& options,
                  const std::vector<std::pair<std::string, std::string>>& plan,
                  const std::string& path) {
  Hdf5File file = Hdf5File::create(m.body.comm, path);
  write_levels(file, m);
  if (m.integrals) archive_integrals(FieldWriter(file, "/frame"), *m.integrals);
  if (basis && m.V) write_basis(file, "/V", m.V, m.body.n, m.body.rows);
  write_dof_map(file, m.body);
  file.create_group("/log/options");
  for (const auto& [name, value] : options)
    file.set_attribute("/log/options", name, value);
  std::vector<std::string> lines;
  for (const auto& [name, value] : plan) lines.push_back(name + "\t" + value);
  if (!lines.empty()) file.set_attribute("/log", "plan", lines);
  file.commit();
}

Medium read_medium(MPI_Comm comm, const std::string& path) {
  const Hdf5File file = Hdf5File::open(comm, path);
  Medium m;
  agree(comm, [&] {
    read_levels(file, m);
    if (m.levels.empty())
      throw Error(
          text("file %s holds no certified model: it is an unfinished checkpoint, "
               "which {restart} goes on from",
               path.c_str()));
  });
  m.body.rows = even_rows(comm, m.body.n);
  if (file.exists("/V")) {
    m.V.append(read_basis(file, "/V", m.body.n, m.body.rows));
    if (m.V.columns() != m.levels.back().order())
      throw Error(text("file %s: /V does not fit: it is damaged", path.c_str()));
  }
  read_dof_map(file, m.body);
  return m;
}

} // namespace flexgram
