#include "run/summary.hpp"

#include "base/parallel.hpp"
#include "base/process.hpp"
#include "base/text.hpp"

#include <algorithm>
#include <cmath>

namespace flexgram {
namespace {

std::string percent_or_power(double error) {
  return error >= 0.1 && error < 10 ? text("%.0f %%", 100 * error) : text("%.1e", error);
}

/// "from 10 to 500 Hz"
std::string over(const std::vector<std::array<double, 2>>& bands) {
  std::vector<std::string> words;
  for (const auto& [first, last] : bands)
    words.push_back(first == last ? text("at the single frequency %g Hz", first * hz)
                                  : text("from %g to %g Hz", first * hz, last * hz));
  return join(words, " and ");
}

} // namespace

std::string words_of(const std::vector<Interval>& bands) {
  std::vector<std::string> words;
  for (const Interval& band : bands)
    words.push_back(band.first == band.last
                        ? text("%g", band.first * hz)
                        : text("%g-%g", band.first * hz, band.last * hz));
  return join(words) + " Hz";
}

std::string words_of(const Claim& claim) {
  if (!claim.supremum) return "";
  const BandClaim& band = *claim.supremum;
  std::string words =
      text("%s %s", claim.kind == "estimated" ? "Estimated, not proved," : "Certified",
           over(band.bands).c_str());
  if (band.values.size() > 1)
    words += text(" with each of %zu values of the parameters", band.values.size());
  const auto largest =
      std::max_element(claim.by_kind.begin(), claim.by_kind.end(),
                       [](const auto& x, const auto& y) { return x.worst < y.worst; });
  const bool is_of_kind = largest != claim.by_kind.end() && largest->worst > band.whole;
  words += std::isfinite(band.worst)
               ? text(": relative error%s at most %s%s", is_of_kind ? "" : " of H",
                      percent_or_power(band.worst).c_str(),
                      band.relative_to == "band" ? " of the largest H in the band" : "")
               : ": relative error without a bound";
  if (band.tolerance)
    words += text(", tolerance %g %s", *band.tolerance, band.met ? "met" : "NOT met");
  words += ".";
  if (band.bands.size() == 1 && band.bands[0][0] == band.bands[0][1])
    words += "\n  For all frequencies between two: {band_hz} FIRST,LAST.";
  if (is_of_kind && std::isfinite(band.worst))
    words += text("\n  It is largest for %s; of H as a whole it is at most %s.",
                  largest->name.c_str(), percent_or_power(band.whole).c_str());
  if (!band.of_all_values.empty())
    words += text("\n  With all values of the parameters it is at most %s.",
                  percent_or_power(*std::max_element(band.of_all_values.begin(),
                                                     band.of_all_values.end()))
                      .c_str());
  if (!band.excluded.empty())
    words += text("\n  Nothing is claimed in %zu narrow interval%s around undamped "
                  "resonances.",
                  band.excluded.size(), band.excluded.size() == 1 ? "" : "s");
  return words;
}

void say_body(const SecondOrderModel& body, const Observer& observer) {
  if (observer.level() != Observer::Level::summary) return;
  const auto inputs = body.inputs.size(), outputs = body.outputs.size();
  const std::string ports = body.outputs_are_inputs
                                ? text("%zu inputs and outputs", inputs)
                                : text("%zu inputs, %zu outputs", inputs, outputs);
  observer.say(text("%s: %lld dofs, %s, damping: %s", body.name.c_str(),
                    static_cast<long long>(body.n), ports.c_str(),
                    body.damping_class().c_str()));
}

namespace {

/// Where the band ends below all natural frequencies, the response is nearly static.
void say_first_mode(const ReducedModel& rom, const Observer& observer) {
  const auto rigid = static_cast<std::size_t>(rom.frame.rigid_modes);
  if (!rom.claim.supremum || rigid >= rom.modes.size()) return;
  const double first = rom.modes[rigid], last = rom.claim.supremum->bands.back()[1];
  if (first > last)
    observer.say(
        text("  No natural frequency lies in the band: the reduced body's first is "
             "at %.5g Hz.",
             first * hz));
}

} // namespace

void say_result(const ReducedModel& rom, const SecondOrderModel& body,
                const Observer& observer) {
  observer.say(text("Reduced from %lld to %lld dofs.", static_cast<long long>(body.n),
                    static_cast<long long>(rom.system.n)));
  if (const int rigid = rom.frame.rigid_modes; rigid > 0 && !rom.frame.integrals)
    observer.say(text("  %d of them %s: nothing holds the body there.", rigid,
                      rigid == 1 ? "is a rigid motion" : "are rigid motions"));
  std::string words = words_of(rom.claim);
  if (words.empty()) // of samples
    for (const auto& [name, value] : observer.facts())
      if (name == "error") words = "Relative error of H " + value + ".";
  observer.say(words);
  say_first_mode(rom, observer);
}

void say_time(const Observer& observer, MPI_Comm comm) {
  constexpr double is_long = 10; // [s]
  const double peak = max_over(comm, peak_memory_mb());
  const bool in_plan = observer.level() >= Observer::Level::plan;
  double whole = 0;
  for (const auto& [stage, seconds] : observer.stages()) whole += seconds;
  if (!in_plan && whole < is_long) return;
  std::string line;
  for (const auto& [stage, seconds] : observer.stages())
    if (in_plan || seconds > 0.05 * whole)
      line += text("%s%s %.*f s", line.empty() ? "" : ", ", stage.c_str(),
                   in_plan ? 2 : 0, seconds);
  observer.say(text("  %-14s %s; peak %.0f MB on a rank", "time", line.c_str(), peak));
}

void say_next(const std::string& command, const Observer& observer) {
  if (observer.level() == Observer::Level::summary)
    observer.say(text("  %-14s %s", "next", command.c_str()));
}

} // namespace flexgram
