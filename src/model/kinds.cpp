#include "model/kinds.hpp"

#include "base/index.hpp"
#include "base/text.hpp"
#include "model/port_views.hpp"
#include "model/project.hpp"
#include "model/spec.hpp"

#include <algorithm>

namespace flexgram {

void warn_of_kinds(const SecondOrderModel& names, const std::vector<ComplexDense>& H,
                   const std::vector<ComplexDense>& H_r, double overall,
                   Observer& observer) {
  const auto views = port_views(names, {true, {}, {}});
  if (views.size() < 3) return;
  double largest = 0;
  std::string words, of;
  for (std::size_t v = 1; v < views.size(); ++v) {
    double worst = 0;
    for (std::size_t l = 0; l < H.size(); ++l)
      worst = std::max(worst, relative_error(views[v].of(H[l]), views[v].of(H_r[l])));
    words += text("%s%s %.1e", words.empty() ? "" : ", ", views[v].name.c_str(), worst);
    if (worst > largest) of = views[v].name;
    largest = std::max(largest, worst);
  }
  observer.fact("by kind", words + " (not proved)");
  if (largest > 10 * overall)
    observer.warn(
        text("the error of H as a whole mixes m/N and rad/(N m), and hides that "
             "of %s: %.1e at most where it was looked at, not proved. {tol} "
             "instead of {order} chooses by all kinds and proves each",
             of.c_str(), largest));
}

std::string describe_modes(const std::vector<double>& modes, int rigid) {
  const auto count = as_size(rigid);
  if (modes.empty()) return "not known, the reduced M is singular";
  std::string words;
  if (count > 0 && count <= modes.size())
    words = text("%d rigid, up to %.2g Hz", rigid, modes[count - 1] * hz);
  if (count < modes.size())
    words += text("%selastic from %.4g Hz", words.empty() ? "" : ", ", modes[count] * hz);
  return words;
}

} // namespace flexgram
