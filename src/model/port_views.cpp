#include "model/port_views.hpp"

#include <numeric>

namespace flexgram {
namespace {

std::vector<int> ports_of_kind(const std::vector<std::string>& names, char kind) {
  std::vector<int> found;
  for (std::size_t i = 0; i < names.size(); ++i)
    if (kind_of_port(names[i]) == kind) found.push_back(static_cast<int>(i));
  return found;
}

std::vector<int> all_of(std::size_t count) {
  std::vector<int> all(count);
  std::iota(all.begin(), all.end(), 0);
  return all;
}

} // namespace

char kind_of_port(const std::string& name) {
  const auto dot = name.rfind('.');
  if (dot == std::string::npos || name.size() != dot + 3) return ' ';
  const char kind = name[dot + 1];
  return kind == 'f' || kind == 'm' ? kind : ' ';
}

ComplexDense PortView::of(const ComplexDense& H) const {
  ComplexDense part(static_cast<int>(rows.size()), static_cast<int>(columns.size()));
  for (int j = 0; j < part.columns; ++j)
    for (int i = 0; i < part.rows; ++i)
      part(i, j) =
          H(rows[static_cast<std::size_t>(i)], columns[static_cast<std::size_t>(j)]);
  return part;
}

std::vector<PortView> port_views(const SecondOrderModel& names, bool by_kind) {
  std::vector<PortView> views{
      {"all ports", all_of(names.outputs.size()), all_of(names.inputs.size())}};
  if (!by_kind) return views;
  const PortView force{"displacement from force", ports_of_kind(names.outputs, 'f'),
                       ports_of_kind(names.inputs, 'f')},
      moment{"rotation from moment", ports_of_kind(names.outputs, 'm'),
             ports_of_kind(names.inputs, 'm')};
  for (const PortView* view : {&force, &moment})
    if (view->rows.empty() || view->columns.empty()) return views;
  views.push_back(force);
  views.push_back(moment);
  return views;
}

} // namespace flexgram
