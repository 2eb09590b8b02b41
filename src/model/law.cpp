#include "model/law.hpp"

#include "base/error.hpp"
#include "base/text.hpp"
#include "model/product_law.hpp"

#include <algorithm>
#include <limits>

namespace flexgram {
namespace {

const LawMaker& maker_of(const std::string& kind) {
  std::vector<std::string> known;
  for (const auto& [name, maker] : law_makers()) {
    if (name == kind) return *maker;
    known.push_back(name);
  }
  throw Error(text("there is no law %s, did you mean %s? There are %s", kind.c_str(),
                   nearest(kind, known).c_str(), join(known).c_str()));
}

/// The kind of the other law of a product; empty: it is none.
std::string factor_of(const std::string& kind) {
  const std::string prefix = product_prefix;
  if (kind.compare(0, prefix.size(), prefix) != 0) return {};
  return kind.substr(prefix.size());
}

/// Lists of finite numbers of one length.
void expect_numbers(const std::string& kind, const std::vector<std::string>& names,
                    const char* help, const LawNumbers& numbers) {
  for (const std::string& name : names) {
    const auto found = numbers.find(name);
    if (found == numbers.end())
      throw Error(text("law %s has no %s: it is %s", kind.c_str(), name.c_str(), help));
    for (double x : found->second)
      if (!std::isfinite(x))
        throw Error(text("law %s: %s holds %g", kind.c_str(), name.c_str(), x));
    if (found->second.size() != numbers.at(names.front()).size())
      throw Error(text("law %s: %s has %zu numbers, %s %zu", kind.c_str(), name.c_str(),
                       found->second.size(), names.front().c_str(),
                       numbers.at(names.front()).size()));
  }
}

std::unique_ptr<LawKind> made(const std::string& kind, const LawNumbers& numbers) {
  if (const std::string factor = factor_of(kind); !factor.empty()) {
    expect_numbers(kind, numbers_of_products(), "a parameter times another law", numbers);
    return product_of(made(factor, numbers), kind, numbers);
  }
  const LawMaker& maker = maker_of(kind);
  expect_numbers(kind, maker.numbers, maker.help, numbers);
  return maker.make(numbers);
}

} // namespace

std::vector<std::string> numbers_of_law(const std::string& kind) {
  std::vector<std::string> names;
  const std::string factor = factor_of(kind);
  if (!factor.empty()) names = numbers_of_products();
  for (const auto& [known, maker] : law_makers())
    if (known == (factor.empty() ? kind : factor))
      names.insert(names.end(), maker->numbers.begin(), maker->numbers.end());
  return names;
}

bool Law::is_circulatory() const {
  return kind_name_ == "circulatory" || factor_of(kind_name_) == "circulatory";
}

bool Law::is_product() const { return !factor_of(kind_name_).empty(); }

double LawSeries::beyond_linear() const {
  double sum = rest;
  for (std::size_t k = 2; k < coefficients.size(); ++k) sum += std::abs(coefficients[k]);
  return sum;
}

double LawSeries::moved() const { return std::abs(coefficients[1]) + beyond_linear(); }

Interval LawKind::known() const { return {0, std::numeric_limits<double>::infinity()}; }

Law::Law(Kind kind) {
  struct Known {
    const char *name, *kind;
    std::shared_ptr<const LawKind> law;
  };
  static const Known known[] = {{"D", "viscous", made("viscous", {})},
                                {"S", "structural", made("structural", {})},
                                {"G", "gyroscopic", made("gyroscopic", {})}};
  const Known& of = known[static_cast<int>(kind)];
  name_ = of.name;
  kind_name_ = of.kind;
  kind_ = of.law;
}

Law::Law(std::string name, const std::string& kind, const LawNumbers& numbers)
    : name_(std::move(name)), kind_name_(kind), kind_(made(kind, numbers)) {}

std::complex<double> Law::at(double omega) const {
  return std::complex<double>(kind_->coefficients({omega, omega}, 1).front());
}

void expect_speeds(const char* law, const LawNumbers& numbers) {
  const auto of = [&](const char* name) { return numbers.at(name).front(); };
  if (numbers.at("least").size() != 1)
    throw Error(text("law %s: one number of each name", law));
  if (!(of("least") >= 0) || !(of("least") < of("most")) ||
      !(of("value") >= of("least")) || !(of("value") <= of("most")))
    throw Error(
        text("law %s: speeds least %g, value %g, most %g must rise from 0 or more", law,
             of("least"), of("value"), of("most")));
}

LawSeries Law::series(const Interval& interval, int degree) const {
  LawSeries series{{}, 2 * kind_->rest(interval, degree)};
  for (const auto& x : kind_->coefficients(interval, degree))
    series.coefficients.emplace_back(x);
  // What no sum of doubles would see belongs to the rest: products are shorter without.
  constexpr double unseen = 1e-18;
  double left = 0;
  const double size = std::abs(series.coefficients.front());
  while (series.coefficients.size() > 2 &&
         left + std::abs(series.coefficients.back()) <= unseen * size) {
    left += std::abs(series.coefficients.back());
    series.coefficients.pop_back();
  }
  series.rest += left;
  return series;
}

double Law::as_damper(double omega) const {
  const double positive = std::max(omega, 1e-300);
  return at(positive).imag() / positive;
}

double Law::number(const std::string& name) const {
  return kind_->numbers().at(name).front();
}

Law Law::with(const std::string& number, double value) const {
  LawNumbers numbers = kind_->numbers();
  numbers.at(number) = {value};
  return {name_, kind_name_, numbers};
}

std::string Law::path() const { return (is_named() ? "/terms/" : "/") + name_; }

} // namespace flexgram
