#include "basis/tangent_frame.hpp"

#include "base/error.hpp"
#include "base/index.hpp"
#include "base/text.hpp"
#include "linalg/decompositions.hpp"
#include "model/port_views.hpp"

namespace flexgram {

std::string first_with_six_ports(const MediumModel& medium) {
  for (const auto& [name, ports] : interfaces_of(medium.names.inputs))
    if (ports.size() == 6) return name;
  return "";
}

Dense at_rest_at(const MediumModel& medium, const std::string& interface,
                 const Dense& Q) {
  std::vector<int> ports;
  const auto known = interfaces_of(medium.names.inputs);
  for (const auto& [name, own] : known)
    if (name == interface) ports = own;
  if (ports.empty() && !interface.empty()) {
    std::vector<std::string> names;
    for (const auto& entry : known) names.push_back(entry.first);
    throw Error(text("{frame_interface} %s: there is no such interface; there are %s",
                     interface.c_str(), join(names).c_str()));
  }
  if (ports.size() != 6 || medium.rigid != 6)
    throw Error(
        text("{frame} tangent needs a free body and an interface with six ports; %s%s "
             "has %zu, and there are %d rigid modes",
             interface.empty() ? "no interface" : "interface ", interface.c_str(),
             ports.size(), medium.rigid));
  const int m = Q.columns;
  const Dense motion = multiply_transposed(medium.system.B, Q); // n_in × m
  ComplexDense rigid(6, 6), elastic(6, m - 6);
  for (int i = 0; i < 6; ++i) {
    const int port = ports[as_size(i)];
    for (int j = 0; j < 6; ++j) rigid(i, j) = motion(port, j);
    for (int j = 6; j < m; ++j) elastic(i, j - 6) = motion(port, j);
  }
  const ComplexDense share = solve(std::move(rigid), std::move(elastic));
  Dense moved = Q;
  for (int j = 6; j < m; ++j)
    for (int i = 0; i < 6; ++i) moved(i, j) -= share(i, j - 6).real();
  return moved;
}

} // namespace flexgram
