#include "medium/port_loads.hpp"

#include "base/index.hpp"
#include "linalg/sparse_product.hpp"
#include "medium/space.hpp"

#include <algorithm>
#include <numeric>

namespace flexgram {

namespace {

/// What an interface measures is what it drives, also where loads or stresses stand beside it.
std::vector<int> equal_ports(const SecondOrderModel& fom) {
  const int inputs = static_cast<int>(fom.B.columns());
  std::vector<int> first(as_size(inputs));
  std::iota(first.begin(), first.end(), 0);
  if (fom.outputs_are_inputs) return first;
  const Block::Access B(fom.B), C(fom.C);
  std::vector<double> differs;
  for (std::size_t j = 0; j < fom.outputs.size(); ++j) {
    const auto named = std::find(fom.inputs.begin(), fom.inputs.end(), fom.outputs[j]);
    const auto i = static_cast<int>(named - fom.inputs.begin());
    const bool same = i < inputs && std::equal(B.column(i), B.column(i) + fom.rows.size(),
                                               C.column(static_cast<PetscInt>(j)));
    first.push_back(i);
    differs.push_back(same ? 0.0 : 1.0);
  }
  MPI_Allreduce(MPI_IN_PLACE, differs.data(), static_cast<int>(differs.size()),
                MPI_DOUBLE, MPI_MAX, fom.comm);
  for (std::size_t j = 0; j < differs.size(); ++j) {
    const std::size_t at = as_size(inputs) + j;
    if (differs[j] > 0) first[at] = static_cast<int>(at);
  }
  return first;
}

} // namespace

PortLoads port_loads(const SecondOrderModel& fom) {
  return {fom.outputs_are_inputs ? copy(fom.B) : concatenate(fom.B, fom.C),
          static_cast<int>(fom.B.columns()), equal_ports(fom)};
}

Block self_equilibrated(const Block& loads, const Block& rigid, Mat M) {
  Block result = copy(loads);
  if (rigid.columns() == 0) return result;
  add_product(result, -1.0, multiply(M, rigid), inner(rigid, result));
  const auto before = column_maxima(loads), after = column_maxima(result);
  std::vector<double> keep;
  for (std::size_t j = 0; j < after.size(); ++j)
    keep.push_back(after[j] > 1e-9 * before[j] ? 1.0 : 0.0);
  scale_columns(result, keep);
  return result;
}

Block without_many_outputs(Block response, const PortLoads& ports) {
  int further = 0; // outputs that are no inputs
  for (int j = ports.inputs; j < ports.count(); ++j) further += ports.is_first(j);
  if (further <= std::max(wide_block, 2 * ports.inputs)) return response;
  std::vector<int> chosen;
  for (int j = 0; j < response.columns(); ++j)
    if (j < ports.inputs || j >= ports.count()) chosen.push_back(j);
  return select_columns(response, chosen);
}

} // namespace flexgram
