#include "model/stiffening.hpp"

#include "base/error.hpp"
#include "base/index.hpp"
#include "base/text.hpp"
#include "linalg/decompositions.hpp"
#include "model/port_views.hpp"

#include <algorithm>

namespace flexgram {

LoadMatrices LoadMatrices::project(const Dense& Q) const {
  LoadMatrices result = *this;
  for (Dense& K : result.matrices) {
    K = multiply_transposed(Q, multiply(K, Q));
    symmetrise(K);
  }
  return result;
}

LoadMatrices LoadMatrices::held_at(const std::string& interface) const {
  if (held.empty() || interfaces_of(held).front().first == interface) return *this;
  std::vector<int> new_holder;
  std::vector<std::string> others;
  others.push_back(interfaces_of(held).front().first);
  for (const auto& [name, ports] : interfaces_of(loads)) {
    if (name == interface) new_holder = ports;
    others.push_back(name);
  }
  if (new_holder.size() != 6)
    throw Error(text(
        "{frame_interface}: a free body is held at an interface with six ports; %s has "
        "%zu%s",
        interface.c_str(), new_holder.size(),
        new_holder.empty()
            ? (": did you mean " + nearest(interface, others) + "?").c_str()
            : ""));
  // Of each load the forces at the new holder that have its resultant.
  const ComplexDense forces =
      solve(as_complex(columns_of(resultants, new_holder)), as_complex(resultants));
  LoadMatrices result;
  std::vector<int> order;
  const auto take = [&](int l, const std::string& name) {
    Dense K = l < static_cast<int>(loads.size())
                  ? matrices[as_size(l)]
                  : Dense(matrices.front().rows, matrices.front().columns);
    for (int j = 0; j < 6; ++j)
      add_to(K, matrices[as_size(new_holder[as_size(j)])], -forces(j, l).real());
    result.loads.push_back(name);
    result.matrices.push_back(std::move(K));
    order.push_back(l);
  };
  for (int l = 0; l < static_cast<int>(loads.size()); ++l)
    if (std::find(new_holder.begin(), new_holder.end(), l) == new_holder.end())
      take(l, loads[as_size(l)]);
  for (std::size_t j = 0; j < held.size(); ++j)
    take(static_cast<int>(loads.size() + j), held[j]);
  for (int l : new_holder) {
    result.held.push_back(loads[as_size(l)]);
    order.push_back(l);
  }
  result.resultants = columns_of(resultants, order);
  return result;
}

} // namespace flexgram
