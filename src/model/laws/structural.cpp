/// i: the imaginary part of a stiffness.

#include "model/law.hpp"

namespace flexgram {
namespace {

class Structural : public LawKind {
public:
  std::vector<std::complex<long double>> coefficients(const Interval&,
                                                      int) const override {
    return {{0, 1}, {0, 0}};
  }
  bool is_stiffness() const override { return true; }
  double largest(double) const override { return 1; }
  std::string words() const override {
    return "structural (S, the imaginary part of K: loss factors of parts of the body)";
  }
};

} // namespace

extern const LawMaker structural_law{
    "i, of loss factors", {}, [](const LawNumbers&) -> std::unique_ptr<LawKind> {
      return std::make_unique<Structural>();
    }};

} // namespace flexgram
