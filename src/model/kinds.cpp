#include "model/kinds.hpp"

#include "base/text.hpp"
#include "model/port_views.hpp"
#include "model/project.hpp"
#include "model/spec.hpp"

#include <algorithm>

namespace flexgram {

void warn_of_kinds(const SecondOrderModel& names, const std::vector<ComplexDense>& H,
                   const std::vector<ComplexDense>& H_r, double overall,
                   Observer& observer) {
  const auto views = port_views(names, true);
  if (views.size() < 3) return;
  double worst[3] = {0, 0, 0};
  for (std::size_t l = 0; l < H.size(); ++l)
    for (std::size_t v : {1u, 2u})
      worst[v] =
          std::max(worst[v], relative_error(views[v].of(H[l]), views[v].of(H_r[l])));
  observer.fact("by kind", text("%s %.1e, %s %.1e (not proved)", views[1].name.c_str(),
                                worst[1], views[2].name.c_str(), worst[2]));
  if (std::max(worst[1], worst[2]) > 10 * overall)
    observer.warn("the error of eq. (17) adds m/N and rad/(N m) and is blind for the "
                  "smaller: see the line \"by kind\"; {tol} bounds both ({tol_of} "
                  "each_kind)");
}

std::string describe_modes(const std::vector<double>& modes, int rigid) {
  const auto count = static_cast<std::size_t>(rigid);
  if (modes.empty()) return "not known, the reduced M is singular";
  std::string words;
  if (count > 0 && count <= modes.size())
    words = text("%d rigid, up to %.2g Hz", rigid, modes[count - 1] * hz);
  if (count < modes.size())
    words += text("%selastic from %.4g Hz", words.empty() ? "" : ", ", modes[count] * hz);
  return words;
}

} // namespace flexgram
