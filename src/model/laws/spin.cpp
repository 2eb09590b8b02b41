/// Ω² − least²: what a spin adds to the stiffness, in the frame that turns with the body, at a speed
/// Ω known between two numbers: the stiffness of the centrifugal load's stress less M_c, both at
/// 1 rad/s. K holds them at the least speed.

#include "base/error.hpp"
#include "base/text.hpp"
#include "model/law.hpp"

namespace flexgram {
namespace {

class Spin : public LawKind {
public:
  explicit Spin(LawNumbers numbers)
      : numbers_(std::move(numbers)), least_(numbers_.at("least").front()),
        speed_(numbers_.at("value").front()) {}

  std::vector<std::complex<long double>> coefficients(const Interval&,
                                                      int) const override {
    return {factor(), 0};
  }
  double largest(double) const override {
    return static_cast<double>(factor()) * (1 + 1e-15);
  }
  bool is_semidefinite() const override { return false; }
  bool is_stiffness() const override { return true; }
  std::string parameter(const std::string& /*term*/) const override { return "speed"; }
  std::vector<double> shares(const Interval& values) const override {
    const double c = values.centre(), h = values.half(),
                 most = numbers_.at("most").front(),
                 all = (most - least_) * (most + least_);
    return {(c - least_) * (c + least_) / all, 2 * c * h / all, h * h / all};
  }
  LawNumbers numbers() const override { return numbers_; }
  std::string words() const override {
    return text("stiffness of spin at speeds from %g to %g rad/s", least_,
                numbers_.at("most").front());
  }

private:
  long double factor() const {
    const auto least = static_cast<long double>(least_),
               speed = static_cast<long double>(speed_);
    return (speed - least) * (speed + least);
  }

  LawNumbers numbers_;
  double least_, speed_;
};

} // namespace

extern const LawMaker spin_law{
    "the stiffness of a spin at a speed known between two numbers",
    {"least", "most", "value"},
    [](const LawNumbers& numbers) -> std::unique_ptr<LawKind> {
      expect_speeds("spin", numbers);
      return std::make_unique<Spin>(numbers);
    }};

} // namespace flexgram
