/// Ω^power − least^power: what a spin adds to the stiffness, in the frame that turns with the body, at
/// a speed Ω known between two numbers; the matrix is that at 1 rad/s. K holds it at the least speed.
/// Power 2: the stiffness of the centrifugal load's stress less M_c, which has no sign. Power 4: what
/// moved geometry adds at second order, positive semidefinite.

#include "base/error.hpp"
#include "base/text.hpp"
#include "model/law.hpp"

namespace flexgram {
namespace {

class Spin : public LawKind {
public:
  explicit Spin(LawNumbers numbers)
      : numbers_(std::move(numbers)), least_(of("least")), most_(of("most")),
        speed_(of("value")), is_fourth_(of("power") == 4) {}

  std::vector<std::complex<long double>> coefficients(const Interval&,
                                                      int) const override {
    return {beyond_least(speed_), 0};
  }
  double largest(double) const override {
    return static_cast<double>(beyond_least(speed_)) * (1 + 1e-15);
  }
  bool is_semidefinite() const override { return is_fourth_; }
  bool is_stiffness() const override { return true; }
  std::string parameter(const std::string& /*term*/) const override { return "speed"; }
  std::vector<double> shares(const Interval& values) const override {
    const double c = values.centre(), h = values.half();
    const auto all = static_cast<double>(beyond_least(most_)),
               here = static_cast<double>(beyond_least(c));
    if (!is_fourth_) return {here / all, 2 * c * h / all, h * h / all};
    return {here / all, 4 * c * c * c * h / all, 6 * c * c * h * h / all,
            4 * c * h * h * h / all, h * h * h * h / all};
  }
  LawNumbers numbers() const override { return numbers_; }
  std::string words() const override {
    return text("stiffness of spin at speeds from %g to %g rad/s", least_, most_);
  }

private:
  double of(const char* name) const { return numbers_.at(name).front(); }

  /// speed^power − least^power, without cancelling.
  long double beyond_least(double at) const {
    const auto least = static_cast<long double>(least_),
               speed = static_cast<long double>(at),
               squares = (speed - least) * (speed + least);
    return is_fourth_ ? squares * (speed * speed + least * least) : squares;
  }

  LawNumbers numbers_;
  double least_, most_, speed_;
  bool is_fourth_;
};

} // namespace

extern const LawMaker spin_law{
    "the stiffness of a spin at a speed known between two numbers",
    {"least", "most", "value", "power"},
    [](const LawNumbers& numbers) -> std::unique_ptr<LawKind> {
      expect_speeds("spin", numbers);
      const double power = numbers.at("power").front();
      if (power != 2 && power != 4)
        throw Error(text("law spin: power %g must be 2 or 4", power));
      return std::make_unique<Spin>(numbers);
    }};

} // namespace flexgram
