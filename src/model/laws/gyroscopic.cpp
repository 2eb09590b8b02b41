/// iω, of a skew matrix: Coriolis forces of a body seen in a frame that spins, gyroscopic moments
/// of rotors.

#include "model/law.hpp"

namespace flexgram {
namespace {

class Gyroscopic : public LawKind {
public:
  std::vector<std::complex<long double>> coefficients(const Interval& interval,
                                                      int) const override {
    return {{0, static_cast<long double>(interval.centre())},
            {0, static_cast<long double>(interval.half())}};
  }
  double largest(double omega) const override { return omega; }
  bool is_of_rates() const override { return true; }
  bool is_skew() const override { return true; }
  std::string words() const override { return "gyroscopic forces"; }
};

} // namespace

extern const LawMaker gyroscopic_law{
    "iω, of a skew matrix", {}, [](const LawNumbers&) -> std::unique_ptr<LawKind> {
      return std::make_unique<Gyroscopic>();
    }};

} // namespace flexgram
