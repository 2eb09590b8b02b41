/// 1, of a skew matrix: circulatory forces, as of oil films, friction and loads that follow a body.

#include "model/law.hpp"

namespace flexgram {
namespace {

class Circulatory : public LawKind {
public:
  std::vector<std::complex<long double>> coefficients(const Interval&,
                                                      int) const override {
    return {1, 0};
  }
  double largest(double) const override { return 1; }
  bool is_skew() const override { return true; }
  bool is_semidefinite() const override { return true; } // xᴴNx is imaginary
  std::string words() const override { return "circulatory forces"; }
};

} // namespace

extern const LawMaker circulatory_law{
    "1, of a skew matrix", {}, [](const LawNumbers&) -> std::unique_ptr<LawKind> {
      return std::make_unique<Circulatory>();
    }};

} // namespace flexgram
