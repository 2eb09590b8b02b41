/// Ω⁴ − least⁴: what the geometry that a spin has moved adds to the stiffness, beyond what is
/// proportional to Ω², at a speed Ω known between two numbers. K holds it at the least speed.

#include "base/error.hpp"
#include "base/text.hpp"
#include "model/law.hpp"

namespace flexgram {
namespace {

class SpinMoved : public LawKind {
public:
  explicit SpinMoved(LawNumbers numbers)
      : numbers_(std::move(numbers)), least_(numbers_.at("least").front()),
        speed_(numbers_.at("value").front()) {}

  std::vector<std::complex<long double>> coefficients(const Interval&,
                                                      int) const override {
    return {factor(), 0};
  }
  double largest(double) const override {
    return static_cast<double>(factor()) * (1 + 1e-15);
  }
  bool is_stiffness() const override { return true; }
  std::string parameter(const std::string& /*term*/) const override { return "speed"; }
  std::vector<double> shares(const Interval& values) const override {
    const double c = values.centre(), h = values.half(), c2 = c * c, h2 = h * h,
                 most = numbers_.at("most").front(), l2 = least_ * least_,
                 all = (most - least_) * (most + least_) * (most * most + l2);
    return {(c - least_) * (c + least_) * (c2 + l2) / all, 4 * c2 * c * h / all,
            6 * c2 * h2 / all, 4 * c * h2 * h / all, h2 * h2 / all};
  }
  LawNumbers numbers() const override { return numbers_; }
  std::string words() const override {
    return text("moved geometry at speeds from %g to %g rad/s", least_,
                numbers_.at("most").front());
  }

private:
  long double factor() const {
    const auto least = static_cast<long double>(least_),
               speed = static_cast<long double>(speed_);
    return (speed - least) * (speed + least) * (speed * speed + least * least);
  }

  LawNumbers numbers_;
  double least_, speed_;
};

} // namespace

extern const LawMaker spin_moved_law{
    "the stiffness of geometry that a spin moves, at a speed known between two numbers",
    {"least", "most", "value"},
    [](const LawNumbers& numbers) -> std::unique_ptr<LawKind> {
      expect_speeds("spin_moved", numbers);
      return std::make_unique<SpinMoved>(numbers);
    }};

} // namespace flexgram
