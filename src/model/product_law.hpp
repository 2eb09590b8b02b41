/// Laws that are a parameter times another one.

#pragma once

#include "model/law.hpp"

namespace flexgram {

/// What stands before the kind of the other law in the kind of a product: "parameter*prony".
inline constexpr const char* product_prefix = "parameter*";

/// Names of the parameter's numbers; those of the other law follow in files.
const std::vector<std::string>& numbers_of_products();

/// p slope g(ω). The parameter p is named like the term, up to a colon: a term E_rubber:relaxation
/// depends on E_rubber. @param factor  g. @throws Error for a g that varies itself or is skew, and
/// for numbers that make no parameter.
std::unique_ptr<LawKind> product_of(std::unique_ptr<LawKind> factor,
                                    const std::string& kind, const LawNumbers& numbers);

} // namespace flexgram
