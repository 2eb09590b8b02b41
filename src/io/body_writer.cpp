#include "io/body_io.hpp"
#include "io/kept_rows.hpp"
#include "io/laws.hpp"
#include "io/output_form.hpp"

#include "linalg/sparse.hpp"

#include <algorithm>

namespace flexgram {
namespace {

/// Rows of a as columns: those of the transpose.
void write_sparse(Hdf5File& file, const std::string& group, Mat a) {
  std::vector<std::uint64_t> start, row;
  std::vector<double> value;
  PetscInt n = 0;
  FG_CALL(MatGetSize(a, &n, nullptr));
  const RowRange rows = owned_rows(a);
  for (PetscInt i = rows.begin; i < rows.end; ++i) {
    PetscInt count = 0;
    const PetscInt* columns = nullptr;
    const PetscScalar* values = nullptr;
    FG_CALL(MatGetRow(a, i, &count, &columns, &values));
    row.insert(row.end(), columns, columns + count);
    value.insert(value.end(), values, values + count);
    start.push_back(row.size());
    FG_CALL(MatRestoreRow(a, i, &count, &columns, &values));
  }
  const std::int64_t here = static_cast<std::int64_t>(row.size());
  std::int64_t before = 0;
  MPI_Exscan(&here, &before, 1, MPI_INT64_T, MPI_SUM, file.comm());
  if (comm_rank(file.comm()) == 0) before = 0;
  for (auto& position : start) position += static_cast<std::uint64_t>(before);
  if (rows.begin == 0 && comm_rank(file.comm()) == 0) start.insert(start.begin(), 0);
  const std::int64_t total = sum_over(file.comm(), here);
  file.create_group(group);
  file.set_attribute(group, "MATLAB_class", std::string("double"));
  file.set_count_attribute(group, "MATLAB_sparse", static_cast<std::uint64_t>(n));
  file.write_part(group + "/jc", n + 1, comm_rank(file.comm()) == 0 ? 0 : rows.begin + 1,
                  start);
  file.write_part(group + "/ir", total, before, row);
  file.write_part(group + "/data", total, before, value);
}

} // namespace

void write_dof_map(Hdf5File& file, const SecondOrderModel& model) {
  const MPI_Comm comm = model.comm;
  const auto known = static_cast<std::int64_t>(
      std::min(model.position.size() / 3, model.component.size()));
  if (sum_over(comm, known) != model.n) return;
  std::vector<std::int64_t> ids, node_of_row;
  std::vector<double> positions;
  for (std::size_t row = 0; row < model.node.size(); ++row) {
    if (row == 0 || model.node[row] != model.node[row - 1]) {
      ids.push_back(model.label.empty() ? model.node[row] : model.label[row]);
      positions.insert(positions.end(),
                       model.position.begin() + static_cast<long>(3 * row),
                       model.position.begin() + static_cast<long>(3 * row + 3));
    }
    node_of_row.push_back(static_cast<std::int64_t>(ids.size()) - 1);
  }
  const std::int64_t here = static_cast<std::int64_t>(ids.size());
  std::int64_t before = 0;
  MPI_Exscan(&here, &before, 1, MPI_INT64_T, MPI_SUM, comm);
  if (comm_rank(comm) == 0) before = 0;
  for (auto& node : node_of_row) node += before;
  const std::int64_t nodes = sum_over(comm, here);
  file.write_part("/dofs/node", model.n, model.rows.begin, node_of_row);
  file.write_part("/dofs/component", model.n, model.rows.begin, model.component);
  file.write_part("/nodes/id", nodes, before, ids);
  file.write_rows("/nodes/position", nodes, 3,
                  {static_cast<PetscInt>(before), static_cast<PetscInt>(before + here)},
                  [&](RowRange part, double* to) {
                    std::copy_n(positions.begin() + 3 * (part.begin - before),
                                3 * part.size(), to);
                  });
}

void write_body(const SecondOrderModel& model, const std::string& path) {
  Hdf5File file = Hdf5File::create(model.comm, path);
  write_sparse(file, "/K", model.K);
  write_sparse(file, "/M", model.M);
  for (const auto& [law, matrix] : model.terms) {
    Matrix columns = matrix.share();
    if (law.is_skew()) FG_CALL(MatTranspose(matrix, MAT_INITIAL_MATRIX, columns.out()));
    write_sparse(file, law.path(), columns);
    write_law(file, law);
  }
  file.set_attribute("/", "alpha", model.damping.alpha);
  file.set_attribute("/", "beta", model.damping.beta);
  file.set_attribute("/", "eta", model.damping.eta);
  if (model.rounding > 0) file.set_attribute("/", "rounding", model.rounding);
  write_basis(file, "/B", model.B, model.n, model.rows);
  file.set_attribute("/B", "names", model.inputs);
  if (!model.outputs_are_inputs) {
    // C is n_out × n: column-major rows of Cᵀ are what MATLAB_class announces.
    write_basis(file, "/C", model.C, model.n, model.rows);
    file.set_attribute("/C", "MATLAB_class", std::string("double"));
    file.set_attribute("/C", "names", model.outputs);
  }
  write_output_form(file, model);
  write_dof_map(file, model);
  file.commit();
}

} // namespace flexgram
