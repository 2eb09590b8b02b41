#include "model/product_law.hpp"

#include "base/error.hpp"
#include "base/text.hpp"

namespace flexgram {
namespace {

using Long = std::complex<long double>;

class Product : public LawKind {
public:
  Product(std::unique_ptr<LawKind> factor, LawNumbers numbers)
      : factor_(std::move(factor)), numbers_(std::move(numbers)), least_(of("least")),
        most_(of("most")), times_(of("slope") * of("value")) {}

  std::vector<Long> coefficients(const Interval& interval, int degree) const override {
    std::vector<Long> all = factor_->coefficients(interval, degree);
    const auto times =
        static_cast<long double>(of("slope")) * static_cast<long double>(of("value"));
    for (Long& x : all) x *= times;
    return all;
  }
  double rest(const Interval& interval, int degree) const override {
    return times_ * factor_->rest(interval, degree) * (1 + 1e-15);
  }
  double largest(double omega) const override {
    return times_ * factor_->largest(omega) * (1 + 1e-15);
  }
  std::vector<double> breaks() const override { return factor_->breaks(); }
  bool is_of_rates() const override { return factor_->is_of_rates(); }
  bool is_skew() const override { return factor_->is_skew(); }
  bool is_semidefinite() const override { return factor_->is_semidefinite(); }
  std::string parameter(const std::string& term) const override {
    return term.substr(0, term.find(':'));
  }
  std::vector<double> shares(const Interval& values) const override {
    return {values.centre() / most_, values.half() / most_};
  }
  Interval known() const override { return factor_->known(); }
  LawNumbers numbers() const override { return numbers_; }
  std::string words() const override {
    return text("%s, times a parameter from %g to %g", factor_->words().c_str(), least_,
                most_);
  }

private:
  double of(const char* name) const { return numbers_.at(name).front(); }

  std::unique_ptr<LawKind> factor_;
  LawNumbers numbers_; ///< those of the factor too
  double least_, most_, times_;
};

} // namespace

const std::vector<std::string>& numbers_of_products() {
  static const std::vector<std::string> names{"least", "most", "value", "slope"};
  return names;
}

std::unique_ptr<LawKind> product_of(std::unique_ptr<LawKind> factor,
                                    const std::string& kind, const LawNumbers& numbers) {
  if (!factor->parameter("any").empty() || !factor->is_semidefinite())
    throw Error(
        text("law %s: a parameter multiplies laws of dampers, loss factors, Prony "
             "terms, tables and circulatory forces",
             kind.c_str()));
  const auto of = [&](const char* name) { return numbers.at(name).front(); };
  if (!(of("least") >= 0) || !(of("least") < of("most")) ||
      !(of("value") >= of("least")) || !(of("value") <= of("most")) || !(of("slope") > 0))
    throw Error(
        text("law %s: least %g, value %g, most %g must rise from 0 or more, slope "
             "%g must be positive",
             kind.c_str(), of("least"), of("value"), of("most"), of("slope")));
  return std::make_unique<Product>(std::move(factor), numbers);
}

} // namespace flexgram
