/// (p − least) slope (1 + i(eta + loss) + iω beta): a stiffness that grows with a parameter p, known
/// between two numbers. K holds it at the least one. `eta` and `beta` are the body's own damping,
/// `loss` the loss factor of this stiffness.

#include "base/error.hpp"
#include "base/text.hpp"
#include "model/law.hpp"

#include <cmath>

namespace flexgram {
namespace {

using Long = std::complex<long double>;

class Parameter : public LawKind {
public:
  explicit Parameter(LawNumbers numbers)
      : numbers_(std::move(numbers)), least_(of("least")), most_(of("most")),
        value_(of("value")), slope_(of("slope")), loss_(of("loss") + of("eta")),
        beta_(of("beta")) {}

  std::vector<Long> coefficients(const Interval& interval, int) const override {
    const auto stiffness =
        static_cast<long double>(slope_) *
        (static_cast<long double>(value_) - static_cast<long double>(least_));
    const auto beta = static_cast<long double>(beta_);
    return {stiffness * Long(1, static_cast<long double>(loss_) +
                                    beta * static_cast<long double>(interval.centre())),
            stiffness * Long(0, beta * static_cast<long double>(interval.half()))};
  }
  double largest(double omega) const override {
    return slope_ * (value_ - least_) * std::hypot(1, loss_ + omega * beta_) *
           (1 + 1e-15);
  }
  bool is_stiffness() const override { return true; }
  std::string parameter(const std::string& term) const override { return term; }
  std::vector<double> shares(const Interval& values) const override {
    return {(values.centre() - least_) / (most_ - least_),
            values.half() / (most_ - least_)};
  }
  LawNumbers numbers() const override { return numbers_; }
  std::string words() const override {
    return text("a parameter from %g to %g", least_, most_);
  }

private:
  double of(const char* name) const { return numbers_.at(name).front(); }

  LawNumbers numbers_;
  double least_, most_, value_, slope_, loss_, beta_;
};

} // namespace

extern const LawMaker parameter_law{
    "a stiffness known between two numbers",
    {"least", "most", "value", "slope", "loss", "eta", "beta"},
    [](const LawNumbers& numbers) -> std::unique_ptr<LawKind> {
      const auto of = [&](const char* name) { return numbers.at(name).front(); };
      if (numbers.at("least").size() != 1)
        throw Error("law parameter: one number of each name");
      if (!(of("least") < of("most")) || !(of("value") >= of("least")) ||
          !(of("value") <= of("most")))
        throw Error(text("law parameter: least %g, value %g, most %g must rise",
                         of("least"), of("value"), of("most")));
      if (!(of("slope") > 0) || !(of("loss") >= 0) || !(of("eta") >= 0) ||
          !(of("beta") >= 0))
        throw Error("law parameter: slope must be positive, loss, eta and beta must not "
                    "be negative");
      return std::make_unique<Parameter>(numbers);
    }};

} // namespace flexgram
