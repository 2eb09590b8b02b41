#include "basis/claims.hpp"

#include "linalg/block.hpp"
#include "medium/field_error.hpp"
#include "model/port_views.hpp"

#include <algorithm>

namespace flexgram {

ErrorOverBox::Supremum of_first_rank(MPI_Comm comm, ErrorOverBox::Supremum sup) {
  std::vector<double> head{sup.worst, sup.proved ? 1.0 : 0.0,
                           static_cast<double>(sup.excluded.size()),
                           static_cast<double>(sup.intervals)};
  share_from_first(comm, head);
  sup.worst = head[0];
  sup.proved = head[1] > 0;
  sup.excluded.resize(static_cast<std::size_t>(head[2]));
  sup.intervals = static_cast<int>(head[3]);
  for (auto* values : {&sup.worst_of, &sup.attained_of, &sup.at_of})
    share_from_first(comm, *values);
  for (ParameterValues& values : sup.values_of) share_from_first(comm, values);
  std::vector<double> ends;
  for (const Interval& e : sup.excluded) ends.insert(ends.end(), {e.first, e.last});
  share_from_first(comm, ends);
  for (std::size_t i = 0; i < sup.excluded.size(); ++i)
    sup.excluded[i] = {ends[2 * i], ends[2 * i + 1]};
  return sup;
}

std::vector<FieldClaim> field_claims(MPI_Comm comm, MediumOverBand& seen, const Dense& Q,
                                     const DenseSystem& small,
                                     const std::vector<Interval>& excluded) {
  const FieldError field(seen, Q, small);
  std::vector<FieldClaim> claims;
  std::vector<std::vector<int>> known;
  for (const PortView& view : port_views(seen.model().names, {true, {}, {}})) {
    if (std::find(known.begin(), known.end(), view.columns) != known.end()) continue;
    known.push_back(view.columns);
    const FieldSupremum found = field.supremum(view.columns, excluded);
    std::vector<double> shared{found.worst, found.attained, found.at,
                               found.proved ? 1.0 : 0.0};
    share_from_first(comm, shared);
    const auto from = view.name.find(" from ");
    claims.push_back({from == std::string::npos ? view.name : view.name.substr(from + 6),
                      shared[0], shared[1], shared[2], shared[3] > 0});
  }
  return claims;
}

} // namespace flexgram
