/// E′(ω) + iE″(ω) beside what K holds: values at some frequencies, linear in ω between them, and
/// those of the ends beyond.

#include "base/error.hpp"
#include "base/text.hpp"
#include "model/law.hpp"

#include <algorithm>
#include <cmath>

namespace flexgram {
namespace {

using Long = std::complex<long double>;

class Table : public LawKind {
public:
  Table(std::vector<double> omega, std::vector<double> storage, std::vector<double> loss)
      : omega_(std::move(omega)), storage_(std::move(storage)), loss_(std::move(loss)) {}

  // Exact in an interval between two frequencies of the table; else the chord.
  std::vector<Long> coefficients(const Interval& interval, int) const override {
    const auto half = static_cast<long double>(0.5);
    if (interval.half() == 0) return {at(interval.first), {}};
    const Long first = at(interval.first), last = at(interval.last);
    return {half * (first + last), half * (last - first)};
  }
  double rest(const Interval& interval, int degree) const override {
    if (interval.half() == 0) return 0;
    const std::vector<Long> chord = coefficients(interval, degree);
    double largest = 0;
    for (double omega : omega_) {
      if (!(omega > interval.first && omega < interval.last)) continue;
      const auto t =
          static_cast<long double>((omega - interval.centre()) / interval.half());
      const Long away = at(omega) - (chord[0] + t * chord[1]);
      largest = std::max(largest, static_cast<double>(std::abs(away)));
    }
    return largest * (1 + 1e-12);
  }
  double largest(double omega) const override { // |g| is convex between the frequencies
    double largest = static_cast<double>(std::abs(at(omega)));
    for (std::size_t k = 0; k < omega_.size() && (k == 0 || omega_[k] < omega); ++k)
      largest = std::max(largest, std::hypot(storage_[k], loss_[k]));
    return largest * (1 + 1e-15);
  }
  std::vector<double> breaks() const override { return omega_; }
  Interval known() const override { return {omega_.front(), omega_.back()}; }
  LawNumbers numbers() const override {
    return {{"omega", omega_}, {"storage", storage_}, {"loss", loss_}};
  }
  std::string words() const override {
    return text("viscoelastic (a table of %zu frequencies)", omega_.size());
  }

private:
  Long at(double omega) const {
    const auto value = [&](std::size_t k) {
      return Long(static_cast<long double>(storage_[k]),
                  static_cast<long double>(loss_[k]));
    };
    const auto above = static_cast<std::size_t>(
        std::upper_bound(omega_.begin(), omega_.end(), omega) - omega_.begin());
    if (above == 0) return value(0);
    if (above == omega_.size()) return value(above - 1);
    const auto from = static_cast<long double>(omega_[above - 1]),
               to = static_cast<long double>(omega_[above]);
    const long double t = (static_cast<long double>(omega) - from) / (to - from);
    return value(above - 1) + t * (value(above) - value(above - 1));
  }

  std::vector<double> omega_, storage_, loss_; ///< [rad/s], beside K
};

} // namespace

extern const LawMaker table_law{
    "storage + i loss, by frequency",
    {"omega", "storage", "loss"},
    [](const LawNumbers& numbers) -> std::unique_ptr<LawKind> {
      const auto &omega = numbers.at("omega"), &storage = numbers.at("storage"),
                 &loss = numbers.at("loss");
      if (omega.empty()) throw Error("law table: it has no frequencies");
      for (std::size_t k = 0; k < omega.size(); ++k) {
        if (!(omega[k] >= 0) || (k > 0 && !(omega[k] > omega[k - 1])))
          throw Error("law table: omega must rise from zero or more");
        if (!(storage[k] >= 0) || !(loss[k] >= 0))
          throw Error(
              text("law table: storage %g and loss %g at %g rad/s must not be negative "
                   "(storage counts from the least one, which is in K)",
                   storage[k], loss[k], omega[k]));
      }
      return std::make_unique<Table>(omega, storage, loss);
    }};

} // namespace flexgram
