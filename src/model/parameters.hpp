/// Parameters of a body: numbers known between two others, on which laws of terms depend, and the
/// values at which claims are made. Asked by run, medium and basis.

#pragma once

#include "model/law.hpp"

namespace flexgram {

/// A value of each parameter, in the order in which terms first depend on them.
using ParameterValues = std::vector<double>;

/// The place of a law's parameter among those of `laws`, which it joins if it is new.
/// @throws Error if it has other numbers there.
std::size_t place_among(std::vector<Law>& laws, const Law& law);

/// The first law of each. @param terms  of a body.
template <class MatrixType>
std::vector<Law> parameters_of(const std::vector<Term<MatrixType>>& terms) {
  std::vector<Law> laws;
  for (const auto& term : terms)
    if (term.law.varies()) place_among(laws, term.law);
  return laws;
}

/// Gives the parameters other values. @param values  empty: as they are.
template <class MatrixType>
void set_parameters(std::vector<Term<MatrixType>>& terms, const ParameterValues& values) {
  if (values.empty()) return;
  std::vector<Law> laws;
  for (auto& term : terms)
    if (term.law.varies())
      term.law = term.law.with("value", values.at(place_among(laws, term.law)));
}

/// Those that they have.
ParameterValues values_of(const std::vector<Law>& parameters);

/// The values that they have, then others that show the box: all combinations of `each` values of
/// each parameter from its least to its most, evenly spaced: of a speed on a linear scale, and of
/// others where the least is not positive; else on a logarithmic one. @param each  0: 5 of one parameter, 3 of two, else 2.
std::vector<ParameterValues> values_that_show(const std::vector<Law>& parameters,
                                              int each);

/// How many there are of these, at most.
double number_of_values(const std::vector<Law>& parameters, int each);
/// Values between these: the middle of each cell of that grid, 27 at most.
std::vector<ParameterValues> values_between(const std::vector<Law>& parameters, int each);

/// "E_rubber = 2e+06, k_bolt = 1e+05".
std::string words_of(const std::vector<Law>& parameters, const ParameterValues& values);

} // namespace flexgram
