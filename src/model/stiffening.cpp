#include "model/stiffening.hpp"

#include "base/error.hpp"
#include "base/index.hpp"
#include "base/text.hpp"
#include "linalg/decompositions.hpp"

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
  const auto owner = [](const std::string& port) {
    return port.substr(0, port.rfind('.'));
  };
  if (held.empty() || owner(held.front()) == interface) return *this;
  std::vector<int> new_holder;
  std::vector<std::string> interfaces{owner(held.front())};
  for (std::size_t l = 0; l < loads.size(); ++l) {
    if (owner(loads[l]) == interface) new_holder.push_back(static_cast<int>(l));
    interfaces.push_back(owner(loads[l]));
  }
  if (new_holder.size() != 6)
    throw Error(text(
        "{frame_interface}: a free body is held at an interface with six ports; %s has "
        "%zu%s",
        interface.c_str(), new_holder.size(),
        new_holder.empty()
            ? (": did you mean " + nearest(interface, interfaces) + "?").c_str()
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
  for (std::size_t l = 0; l < loads.size(); ++l)
    if (owner(loads[l]) != interface) take(static_cast<int>(l), loads[l]);
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
