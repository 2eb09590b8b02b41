/// iω: dampers.

#include "model/law.hpp"

namespace flexgram {
namespace {

class Viscous : public LawKind {
public:
  std::vector<std::complex<long double>> coefficients(const Interval& interval,
                                                      int) const override {
    return {{0, static_cast<long double>(interval.centre())},
            {0, static_cast<long double>(interval.half())}};
  }
  double largest(double omega) const override { return omega; }
  bool is_of_rates() const override { return true; }
  std::string words() const override { return "general D"; }
};

} // namespace

extern const LawMaker viscous_law{
    "iω, of dampers", {}, [](const LawNumbers&) -> std::unique_ptr<LawKind> {
      return std::make_unique<Viscous>();
    }};

} // namespace flexgram
