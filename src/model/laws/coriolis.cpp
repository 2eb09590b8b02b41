/// iωΩ, of a skew matrix: Coriolis forces, or gyroscopic moments, of a body that spins at a speed Ω
/// known between two numbers.

#include "base/error.hpp"
#include "base/text.hpp"
#include "model/law.hpp"

namespace flexgram {
namespace {

class Coriolis : public LawKind {
public:
  explicit Coriolis(LawNumbers numbers)
      : numbers_(std::move(numbers)), speed_(numbers_.at("value").front()) {}

  std::vector<std::complex<long double>> coefficients(const Interval& interval,
                                                      int) const override {
    const auto speed = static_cast<long double>(speed_);
    return {{0, speed * static_cast<long double>(interval.centre())},
            {0, speed * static_cast<long double>(interval.half())}};
  }
  double largest(double omega) const override { return omega * speed_ * (1 + 1e-15); }
  bool is_of_rates() const override { return true; }
  bool is_skew() const override { return true; }
  std::string parameter(const std::string& /*term*/) const override { return "speed"; }
  std::vector<double> shares(const Interval& values) const override {
    const double most = numbers_.at("most").front();
    return {values.centre() / most, values.half() / most};
  }
  LawNumbers numbers() const override { return numbers_; }
  std::string words() const override {
    return text("gyroscopic forces at speeds from %g to %g rad/s",
                numbers_.at("least").front(), numbers_.at("most").front());
  }

private:
  LawNumbers numbers_;
  double speed_;
};

} // namespace

extern const LawMaker coriolis_law{
    "gyroscopic forces at a speed known between two numbers",
    {"least", "most", "value"},
    [](const LawNumbers& numbers) -> std::unique_ptr<LawKind> {
      expect_speeds("coriolis", numbers);
      return std::make_unique<Coriolis>(numbers);
    }};

} // namespace flexgram
