#include "model/second_order_model.hpp"

#include "base/index.hpp"
#include "base/text.hpp"
#include "linalg/decompositions.hpp"
#include "linalg/sparse.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <set>

namespace flexgram {

Dense Feedthrough::between(const std::vector<std::string>& rows,
                           const std::vector<std::string>& columns) const {
  Dense a(static_cast<int>(rows.size()), static_cast<int>(columns.size()));
  for (std::size_t k = 0; k < values.size(); ++k) {
    const auto i = std::find(rows.begin(), rows.end(), outputs[k]);
    const auto j = std::find(columns.begin(), columns.end(), inputs[k]);
    if (i != rows.end() && j != columns.end())
      a(static_cast<int>(i - rows.begin()), static_cast<int>(j - columns.begin())) +=
          values[k];
  }
  return a;
}

void Feedthrough::append(const Feedthrough& more) {
  outputs.insert(outputs.end(), more.outputs.begin(), more.outputs.end());
  inputs.insert(inputs.end(), more.inputs.begin(), more.inputs.end());
  values.insert(values.end(), more.values.begin(), more.values.end());
}

OutputForm::OutputForm(const OutputDamping& damping, const Feedthrough& direct,
                       const std::vector<std::string>& outputs,
                       const std::vector<std::string>& inputs) {
  for (std::size_t k = 0; k < damping.outputs.size(); ++k) {
    if (damping.beta[k] == 0 && damping.eta[k] == 0) continue;
    const auto at = std::find(outputs.begin(), outputs.end(), damping.outputs[k]);
    if (at == outputs.end()) continue;
    beta_.resize(outputs.size());
    eta_.resize(outputs.size());
    const auto i = static_cast<std::size_t>(at - outputs.begin());
    beta_[i] = damping.beta[k];
    eta_[i] = damping.eta[k];
  }
  direct_ = direct.between(outputs, inputs);
  if (frobenius_norm(direct_) == 0) direct_ = Dense();
}

void OutputForm::leave_out_direct(int output) {
  if (!has_direct()) return;
  for (int j = 0; j < direct_.columns; ++j) direct_(output, j) = 0;
  if (frobenius_norm(direct_) == 0) direct_ = Dense();
}

void OutputForm::scale(ComplexDense& H, double omega) const {
  if (!has_factors()) return;
  for (int j = 0; j < H.columns; ++j)
    for (int i = 0; i < H.rows; ++i) H(i, j) *= factor(i, omega);
}

void OutputForm::complete(ComplexDense& H, double omega) const {
  scale(H, omega);
  if (!has_direct()) return;
  for (std::size_t k = 0; k < H.data.size(); ++k) H.data[k] += direct_.data[k];
}

PetscInt SecondOrderModel::further_outputs() const {
  if (outputs_are_inputs) return 0;
  const std::set<std::string> known(inputs.begin(), inputs.end());
  return static_cast<PetscInt>(
      std::count_if(outputs.begin(), outputs.end(),
                    [&](const std::string& output) { return !known.count(output); }));
}

bool SecondOrderModel::undamped() const {
  return terms.empty() && damping.alpha == 0 && damping.beta == 0 && damping.eta == 0;
}

void SecondOrderModel::damp_parameters() {
  for (auto& term : terms)
    if (term.law.is_parameter())
      term.law = term.law.with("beta", damping.beta).with("eta", damping.eta);
}

std::string SecondOrderModel::damping_class() const {
  std::vector<std::string> parts;
  if (damping.alpha != 0 || damping.beta != 0)
    parts.push_back(
        text("proportional (α = %g 1/s, β = %g s)", damping.alpha, damping.beta));
  if (damping.eta != 0) parts.push_back(text("structural (η = %g)", damping.eta));
  for (const auto& [law, matrix] : terms)
    if (law.is_parameter()) { // stiffness, with a loss factor perhaps
      if (law.number("loss") > 0)
        parts.push_back(text("%s (η = %g)", law.name().c_str(), law.number("loss")));
    } else if (!law.kind().is_stiffness() || !law.varies()) { // not what spin adds to K
      parts.push_back(law.name() == skew_part_of_K
                          ? law.kind().words() + " (skew part of K)"
                      : law.is_named() ? law.name() + " " + law.kind().words()
                                       : law.kind().words());
    }
  return parts.empty() ? "none" : join(parts, " + ");
}

ShiftCoefficients SecondOrderModel::coefficients(double omega) const {
  ShiftCoefficients c{{1.0, damping.eta + omega * damping.beta},
                      {-omega * omega, omega * damping.alpha}};
  for (const auto& [law, matrix] : terms) c.terms.push_back(law.at(omega));
  return c;
}

Mat SecondOrderModel::term(const Law& law) const {
  for (const auto& [of, matrix] : terms)
    if (of == law) return matrix;
  return nullptr;
}

std::vector<Mat> SecondOrderModel::term_matrices() const {
  std::vector<Mat> all;
  for (const auto& [law, matrix] : terms) all.push_back(matrix);
  return all;
}

SecondOrderModel SecondOrderModel::head() const {
  SecondOrderModel head;
  head.name = name;
  head.comm = comm;
  head.n = n;
  head.rows = rows;
  head.damping = damping;
  head.coriolis = coriolis;

  head.outputs_are_inputs = outputs_are_inputs;
  head.inputs = inputs;
  head.outputs = outputs;
  head.node = node;
  head.label = label;
  head.component = component;
  head.position = position;
  head.remarks = remarks;
  head.doubts = doubts;
  head.rounding = rounding;
  head.feedthrough = feedthrough;
  head.output_damping = output_damping;
  head.stiffening = stiffening;
  return head;
}

SecondOrderModel SecondOrderModel::share() const {
  SecondOrderModel shared = head();
  shared.M = M.share();
  shared.K = K.share();
  for (const auto& [law, matrix] : terms) shared.terms.push_back({law, matrix.share()});
  shared.B = B.share();
  shared.C = C.share();
  return shared;
}

double SecondOrderModel::printed_rounding() const {
  return rounding > 0 ? rounding : printed_digits_rounding(K);
}

std::int64_t SecondOrderModel::nonzeros() const {
  MatInfo info;
  FG_CALL(MatGetInfo(K, MAT_GLOBAL_SUM, &info));
  return static_cast<std::int64_t>(info.nz_used);
}

double SecondOrderModel::memory_mb() const {
  double bytes = 0;
  std::vector<Mat> matrices = term_matrices();
  matrices.insert(matrices.end(), {K.get(), M.get()});
  for (Mat matrix : matrices) {
    if (!matrix) continue;
    MatInfo info;
    FG_CALL(MatGetInfo(matrix, MAT_LOCAL, &info));
    bytes += info.memory;
  }
  return bytes / 1048576.0;
}

SecondOrderModel move_to_group(SecondOrderModel model, const Groups& groups) {
  if (groups.count == 1) return model;
  SecondOrderModel copy;
  const RowRange rows = even_rows(groups.comm, model.n);
  copy.name = model.name;
  copy.comm = groups.comm;
  copy.n = model.n;
  copy.rows = rows;
  copy.M = move_sparse(model.M, groups.comm, rows);
  copy.K = move_sparse(model.K, groups.comm, rows);
  for (const auto& [law, matrix] : model.terms)
    copy.terms.push_back({law, move_sparse(matrix, groups.comm, rows)});
  copy.damping = model.damping;
  copy.B = move_block(groups.world, model.B, groups.comm, rows);
  copy.C = model.outputs_are_inputs
               ? copy.B.share()
               : move_block(groups.world, model.C, groups.comm, rows);
  copy.outputs_are_inputs = model.outputs_are_inputs;
  copy.inputs = model.inputs;
  copy.outputs = model.outputs;
  copy.feedthrough = model.feedthrough;
  copy.output_damping = model.output_damping;
  const auto move_list = [&](const auto& list, int columns) {
    using Value = typename std::decay_t<decltype(list)>::value_type;
    const auto missing = static_cast<std::int64_t>(list.empty() && model.rows.size() > 0);
    if (sum_over(groups.world, missing) > 0) return std::vector<Value>{};
    // Rows of `columns` numbers are moved as ranges that are `columns` times as long.
    return exchange_rows<Value>(
        groups.world, {columns * model.rows.begin, columns * model.rows.end}, list, 1, 0,
        {columns * rows.begin, columns * rows.end}, 1);
  };
  copy.node = move_list(model.node, 1);
  copy.label = move_list(model.label, 1);
  copy.component = move_list(model.component, 1);
  copy.position = move_list(model.position, 3);
  return copy;
}

namespace {

/// Indices of the ports that the words name; all of them for no words.
std::vector<int> ports_named(const std::vector<std::string>& ports,
                             const std::vector<std::string>& words, const char* option) {
  std::vector<int> found;
  if (words.empty()) {
    found.resize(ports.size());
    std::iota(found.begin(), found.end(), 0);
  }
  for (const auto& word : words) {
    const std::size_t before = found.size();
    for (std::size_t i = 0; i < ports.size(); ++i)
      if (ports[i] == word || ports[i].rfind(word + ".", 0) == 0)
        found.push_back(static_cast<int>(i));
    if (found.size() == before) {
      std::vector<std::string> known = ports;
      for (const auto& port : ports) known.push_back(port.substr(0, port.rfind('.')));
      throw Error(text("%s: there is no port %s, did you mean %s? There are %s", option,
                       word.c_str(), nearest(word, known).c_str(), join(ports).c_str()));
    }
  }
  for (std::size_t i = 0; i < found.size(); ++i)
    if (std::find(found.begin(), found.begin() + static_cast<long>(i), found[i]) !=
        found.begin() + static_cast<long>(i))
      throw Error(text("option %s: port %s is named twice", option,
                       ports[as_size(found[i])].c_str()));
  return found;
}

std::vector<std::string> pick(const std::vector<std::string>& names,
                              const std::vector<int>& indices) {
  std::vector<std::string> picked;
  for (int i : indices) picked.push_back(names[as_size(i)]);
  return picked;
}

} // namespace

PortSelection find_ports(const SecondOrderModel& model,
                         const std::vector<std::string>& inputs,
                         const std::vector<std::string>& outputs) {
  PortSelection found;
  found.inputs = ports_named(model.inputs, inputs, "{inputs}");
  found.outputs = model.outputs_are_inputs && outputs.empty()
                      ? found.inputs
                      : ports_named(model.outputs, outputs, "{outputs}");
  found.same = model.outputs_are_inputs && found.inputs == found.outputs;
  return found;
}

void select_names(SecondOrderModel& model, const PortSelection& ports) {
  model.inputs = pick(model.inputs, ports.inputs);
  model.outputs = pick(model.outputs, ports.outputs);
  model.outputs_are_inputs = ports.same;
}

void select_ports(SecondOrderModel& model, const std::vector<std::string>& inputs,
                  const std::vector<std::string>& outputs) {
  if (inputs.empty() && outputs.empty()) return;
  const PortSelection ports = find_ports(model, inputs, outputs);
  Block C = ports.same ? Block() : select_columns(model.C, ports.outputs);
  model.B = select_columns(model.B, ports.inputs);
  model.C = ports.same ? model.B.share() : std::move(C);
  select_names(model, ports);
}

ComplexDense dense_transfer(const SecondOrderModel& model, double omega) {
  const ShiftCoefficients c = model.coefficients(omega);
  const Dense K = to_dense(model.K), M = to_dense(model.M);
  const int m = K.rows;
  ComplexDense a(m, m);
  for (std::size_t i = 0; i < a.data.size(); ++i)
    a.data[i] = c.k * K.data[i] + c.m * M.data[i];
  for (std::size_t t = 0; t < model.terms.size(); ++t) {
    const Dense T = to_dense(model.terms[t].matrix);
    for (std::size_t i = 0; i < a.data.size(); ++i) a.data[i] += c.terms[t] * T.data[i];
  }
  const int p = static_cast<int>(model.B.columns()),
            r = static_cast<int>(model.C.columns());
  ComplexDense x(m, p);
  {
    const Block::Access b(model.B);
    for (std::size_t i = 0; i < x.data.size(); ++i) x.data[i] = b.column(0)[i];
  }
  x = solve(std::move(a), std::move(x));
  ComplexDense h(r, p);
  const Block::Access out(model.C);
  for (int j = 0; j < p; ++j)
    for (int i = 0; i < r; ++i)
      for (int k = 0; k < m; ++k) h(i, j) += out.column(i)[k] * x(k, j);
  model.output_form().complete(h, omega);
  return h;
}

ComplexDense transfer_of(const SecondOrderModel& model, const Block& x, double omega) {
  const Dense parts = inner(model.C, x);
  const int p = static_cast<int>(model.B.columns());
  ComplexDense h(parts.rows, p);
  for (int j = 0; j < p; ++j)
    for (int i = 0; i < parts.rows; ++i)
      h(i, j) = {parts(i, j), parts.columns > p ? parts(i, j + p) : 0.0};
  model.output_form().complete(h, omega);
  return h;
}

Matrix make_dense(const Dense& a) {
  Matrix matrix;
  FG_CALL(MatCreateSeqDense(PETSC_COMM_SELF, a.rows, a.columns, nullptr, matrix.out()));
  PetscScalar* values = nullptr;
  FG_CALL(MatDenseGetArrayWrite(matrix, &values));
  std::copy(a.data.begin(), a.data.end(), values);
  FG_CALL(MatDenseRestoreArrayWrite(matrix, &values));
  FG_CALL(MatAssemblyBegin(matrix, MAT_FINAL_ASSEMBLY));
  FG_CALL(MatAssemblyEnd(matrix, MAT_FINAL_ASSEMBLY));
  return matrix;
}

Block make_block(const Dense& a) {
  Block block(PETSC_COMM_SELF, {0, a.rows}, a.rows, a.columns);
  std::copy(a.data.begin(), a.data.end(), Block::Access(block).all().begin());
  return block;
}

Dense to_dense(Mat a) {
  PetscInt rows = 0, columns = 0;
  FG_CALL(MatGetSize(a, &rows, &columns));
  Dense result(static_cast<int>(rows), static_cast<int>(columns));
  const PetscScalar* values = nullptr;
  FG_CALL(MatDenseGetArrayRead(a, &values));
  std::copy_n(values, result.data.size(), result.data.begin());
  FG_CALL(MatDenseRestoreArrayRead(a, &values));
  return result;
}

} // namespace flexgram
