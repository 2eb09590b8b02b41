#include "model/parameters.hpp"

#include "base/error.hpp"
#include "base/text.hpp"

#include <algorithm>
#include <cmath>

namespace flexgram {
namespace {

/// So many of each parameter.
int values_of_each(const std::vector<Law>& parameters, int each) {
  return each > 0 ? each : parameters.size() == 1 ? 5 : parameters.size() == 2 ? 3 : 2;
}

/// The value at a share of the way from the least to the most.
double value_at(const Law& parameter, double share) {
  const double least = parameter.number("least"), most = parameter.number("most");
  if (share == 0) return least;
  if (share == 1) return most;
  const bool by_ratios = parameter.is_parameter() || parameter.is_product();
  return by_ratios && least > 0 ? least * std::pow(most / least, share)
                                : least + share * (most - least);
}

/// Calls visit with all combinations of `count` numbers 0 … count − 1, while it returns true.
template <class Visit>
void for_combinations(std::size_t digits, int count, const Visit& visit) {
  std::vector<int> at(digits, 0);
  while (visit(at)) {
    std::size_t digit = 0;
    while (digit < digits && ++at[digit] == count) at[digit++] = 0;
    if (digit == digits) return;
  }
}

} // namespace

std::size_t place_among(std::vector<Law>& laws, const Law& law) {
  const std::string name = law.parameter();
  std::size_t place = 0;
  while (place < laws.size() && laws[place].parameter() != name) ++place;
  if (place == laws.size()) {
    laws.push_back(law);
    return place;
  }
  for (const char* number : {"least", "most", "value"})
    if (law.number(number) != laws[place].number(number))
      throw Error(text("terms %s and %s: %s of %s is %g and %g",
                       laws[place].name().c_str(), law.name().c_str(), number,
                       name.c_str(), laws[place].number(number), law.number(number)));
  return place;
}

ParameterValues values_of(const std::vector<Law>& parameters) {
  ParameterValues values;
  for (const Law& parameter : parameters) values.push_back(parameter.number("value"));
  return values;
}

double number_of_values(const std::vector<Law>& parameters, int each) {
  if (parameters.empty()) return 0;
  const double count = values_of_each(parameters, each);
  return 1 + std::pow(count, static_cast<double>(parameters.size()));
}

std::vector<ParameterValues> values_that_show(const std::vector<Law>& parameters,
                                              int each) {
  if (parameters.empty()) return {};
  std::vector<ParameterValues> all{values_of(parameters)};
  const int count = values_of_each(parameters, each);
  if (count == 1) return all;
  for_combinations(parameters.size(), count, [&](const std::vector<int>& at) {
    ParameterValues values;
    for (std::size_t k = 0; k < at.size(); ++k)
      values.push_back(value_at(parameters[k], static_cast<double>(at[k]) / (count - 1)));
    if (values != all.front()) all.push_back(std::move(values));
    return true;
  });
  return all;
}

std::vector<ParameterValues> values_between(const std::vector<Law>& parameters,
                                            int each) {
  constexpr std::size_t most = 27;
  std::vector<ParameterValues> all;
  const int count = values_of_each(parameters, each) - 1;
  if (parameters.empty() || count < 1) return all;
  for_combinations(parameters.size(), count, [&](const std::vector<int>& at) {
    ParameterValues values;
    for (std::size_t k = 0; k < at.size(); ++k)
      values.push_back(value_at(parameters[k], (at[k] + 0.5) / count));
    all.push_back(std::move(values));
    return all.size() < most;
  });
  return all;
}

std::string words_of(const std::vector<Law>& parameters, const ParameterValues& values) {
  std::string words;
  for (std::size_t k = 0; k < parameters.size(); ++k)
    words += text("%s%s = %g", k == 0 ? "" : ", ", parameters[k].parameter().c_str(),
                  values[k]);
  return words;
}

} // namespace flexgram
