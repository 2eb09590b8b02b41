/// Σ_k g_k iωτ_k/(1 + iωτ_k): relaxation of a viscoelastic material, whose long-term stiffness is
/// in K (a generalised Maxwell model).

#include "base/error.hpp"
#include "base/text.hpp"
#include "model/law.hpp"

#include <cmath>

namespace flexgram {
namespace {

using Long = std::complex<long double>;

class Prony : public LawKind {
public:
  Prony(std::vector<double> g, std::vector<double> tau)
      : g_(std::move(g)), tau_(std::move(tau)) {}

  // 1 − 1/(1 + iωτ) = 1 − (1/d) Σ (−q)^k t^k, d = 1 + icτ, q = ihτ/d.
  std::vector<Long> coefficients(const Interval& interval, int degree) const override {
    const auto c = static_cast<long double>(interval.centre()),
               h = static_cast<long double>(interval.half());
    std::vector<Long> sum(degree < 1 ? 2 : static_cast<std::size_t>(degree) + 1);
    for (std::size_t l = 0; l < g_.size(); ++l) {
      const auto g = static_cast<long double>(g_[l]),
                 tau = static_cast<long double>(tau_[l]);
      const Long d(1, c * tau), q = Long(0, h * tau) / d;
      sum[0] += g * Long(0, c * tau) / d;
      Long power = -g / d;
      for (std::size_t k = 1; k < sum.size(); ++k) sum[k] += power *= -q;
    }
    return sum;
  }
  double rest(const Interval& interval, int degree) const override {
    double sum = 0;
    for (std::size_t l = 0; l < g_.size(); ++l) {
      if (g_[l] == 0) continue;
      const double d = std::hypot(1, interval.centre() * tau_[l]),
                   q = interval.half() * tau_[l] / d;
      sum += g_[l] / d * std::pow(q, std::max(degree, 1) + 1) / (1 - q);
    }
    return sum * (1 + 1e-12);
  }
  // It rises with ω: so does |z_k|² of each part z_k, and so does Re z_j z̄_k of each pair.
  double largest(double omega) const override {
    return std::abs(std::complex<double>(coefficients({omega, omega}, 1).front())) *
           (1 + 1e-15);
  }
  LawNumbers numbers() const override { return {{"g", g_}, {"tau", tau_}}; }
  std::string words() const override {
    return text("viscoelastic (%zu Prony term%s)", g_.size(), g_.size() == 1 ? "" : "s");
  }

private:
  std::vector<double> g_, tau_; ///< [1], [s]
};

} // namespace

extern const LawMaker prony_law{
    "Σ g iωτ/(1 + iωτ), relaxation",
    {"g", "tau"},
    [](const LawNumbers& numbers) -> std::unique_ptr<LawKind> {
      const auto &g = numbers.at("g"), &tau = numbers.at("tau");
      if (g.empty()) throw Error("law prony: it has no terms");
      for (std::size_t k = 0; k < g.size(); ++k)
        if (!(g[k] >= 0) || !(tau[k] > 0))
          throw Error(
              text("law prony: g = %g, tau = %g: g must not be negative and tau must be "
                   "positive",
                   g[k], tau[k]));
      return std::make_unique<Prony>(g, tau);
    }};

} // namespace flexgram
