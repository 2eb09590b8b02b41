#include "basis/tell.hpp"

#include "base/index.hpp"
#include "base/text.hpp"
#include "basis/held.hpp"
#include "model/kinds.hpp"
#include "model/project.hpp"

#include <algorithm>
#include <cmath>

namespace flexgram {
namespace {

/// What is claimed, as it is printed.
std::string label_of(const ReducedModel& rom) {
  if (rom.claim.kind == "estimated") return "estimated, not proved";
  const auto& excluded = rom.claim.supremum->excluded;
  if (excluded.empty()) return "certified";
  double widest = 0;
  for (const auto& [first, last] : excluded)
    widest = std::max(widest, (last - first) / last);
  std::string words =
      text("certified outside %zu interval%s of relative width %.0e at most, around "
           "undamped resonances",
           excluded.size(), excluded.size() == 1 ? "" : "s", widest);
  double frequency = 0, residue = 0;
  for (const auto& pole : rom.claim.supremum->poles) {
    frequency = std::max(frequency, pole[1]);
    residue = std::max(residue, pole[2]);
  }
  if (!rom.claim.supremum->poles.empty())
    words += text(", known by their frequencies to %.0e and heights (residues) to %.0e",
                  frequency, residue);
  return words;
}

/// "at most 1e-4", or that there is none.
std::string bound_words(double bound, const char* format) {
  return std::isfinite(bound) ? text(format, bound) : "without a bound";
}

/// Where H vanishes, or nearly, no error relative to it is small: whether that is why the
/// error is large, in words.
std::string at_a_zero(const CutStory& cut) {
  const ErrorOverBox::Supremum& sup = cut.sup;
  const MediumModel& medium = cut.seen.model();
  if (cut.request.relative_to == RelativeTo::band || sup.worst < 1) return "";
  if (!cut.whole.spec.values.empty()) return ""; // known with the body's own values alone
  const auto worst = std::max_element(sup.attained_of.begin(), sup.attained_of.end());
  const auto view = as_size(worst - sup.attained_of.begin());
  const double omega = sup.at_of[view];
  if (!(*worst > 0) || !(omega > 0)) return "";
  const auto& sizes = cut.seen.grid().views[view].size;
  const double here = medium.at(omega, 0).size[view].at[0],
               largest = *std::max_element(sizes.begin(), sizes.end());
  if (!(here < 1e-3 * largest)) return "";
  return text(
      "near %.5g Hz H vanishes or nearly so, and no error relative to it is small "
      "there: {tol_relative_to} band forgives that, and so does damping",
      omega * hz);
}

/// Whether H itself at all frequencies of the curve would cost as much as the claim.
bool too_many_ports(const MediumModel& medium) {
  return medium.names.inputs.size() * medium.names.outputs.size() > 2500;
}

/// What joints and springs at its ports leave of a free body's motion is elastic, and small
/// beside the motion as a rigid body that |H| is mostly made of at low frequencies: how large
/// the error is relative to that, where errors are not relative to it anyway.
void tell_elastic_part(const CutStory& cut, const ReducedModel& rom, Observer& observer) {
  const MediumModel& medium = cut.seen.model();
  if (!medium.has_elastic_part()) return;
  const auto& sizes = cut.seen.grid().views.front();
  // Of very many ports at some of the frequencies.
  const std::size_t step =
      too_many_ports(medium) ? rom.claim.curve.omega.size() / 12 + 1 : 1;
  const auto excluded = [&](double omega) {
    return std::any_of(rom.claim.supremum->excluded.begin(),
                       rom.claim.supremum->excluded.end(),
                       [&](const auto& e) { return omega >= e[0] && omega <= e[1]; });
  };
  double worst = 0, at = 0;
  for (std::size_t l = 0; l < rom.claim.curve.omega.size(); l += step) {
    if (excluded(rom.claim.curve.omega[l])) continue;
    const double reference = cut.request.relative_to == RelativeTo::band
                                 ? sizes.largest
                                 : sizes.size[l] - sizes.error[l] - sizes.floor[l],
                 error = rom.claim.curve.bound[l] * reference / sizes.size[l] *
                         medium.whole_over_elastic(rom.claim.curve.omega[l]);
    if (error <= worst) continue;
    at = rom.claim.curve.omega[l];
    worst = std::isnan(error) ? HUGE_VAL : error;
  }
  std::vector<double> shared{worst, at};
  share_from_first(medium.names.comm, shared);
  worst = shared[0];
  at = shared[1] * hz;
  constexpr double hardly_any = 10; // times the elastic motion
  const std::string size = worst > hardly_any ? "more than all" : text("%.2g", worst);
  observer.fact(
      "elastic part",
      text("relative to |H| without rigid motion: about %s at %.4g Hz (an estimate; "
           "{tol_relative_to} both certifies it)",
           size.c_str(), at));
  if (worst > 0.05)
    observer.warn(text(
        "the body is free, and its error is %s of its elastic motion at %.4g Hz. Where "
        "joints or springs hold the body, that motion is what counts. {tol_relative_to} "
        "both, the default, bounds the error of that too",
        worst > hardly_any ? "more than all" : text("%.0f %%", 100 * worst).c_str(), at));
}

/// Where the tolerance is met and where not, in words; empty if it is met nowhere.
std::string unmet_words(const BandClaim& claim) {
  double all = 0, missed = 0;
  for (const auto& [first, last] : claim.bands) all += last - first;
  auto intervals = claim.unmet;
  for (const auto& [first, last] : intervals) missed += last - first;
  if (intervals.empty() || !(all > 0) || missed > 0.999 * all) return "";
  std::stable_sort(intervals.begin(), intervals.end(), [](const auto& a, const auto& b) {
    return a[1] - a[0] > b[1] - b[0];
  });
  const double share = 100 * (1 - missed / all);
  std::string words =
      text(". It is met in %.4g %% of the band%s, but not", share > 99.99 ? 99.99 : share,
           claim.bands.size() > 1 ? "s" : "");
  constexpr std::size_t most = 3;
  for (std::size_t i = 0; i < std::min(intervals.size(), most); ++i) {
    const auto [first, last] = intervals[i];
    words += text(i == 0 ? " " : ", ");
    words += last - first > 0.1 * last
                 ? text("from %.5g to %.5g Hz", first * hz, last * hz)
                 : text("within %.1g Hz of %.6g Hz", 0.5 * (last - first) * hz,
                        0.5 * (first + last) * hz);
  }
  if (intervals.size() > most)
    words += text(" and in %zu smaller intervals", intervals.size() - most);
  return words;
}

/// Circulatory forces may excite a body, gyroscopic ones hold one that is unstable without them;
/// at each of the parameters' values that the claim is of.
void tell_stability(const CutStory& cut, const ReducedModel& rom, Observer& observer) {
  constexpr double rounding = 1e-9;
  const auto is_linear = [](const auto& term) { return term.law.is_linear(); };
  const bool may_be_unstable =
      !is_symmetric(cut.small.terms) || !are_semidefinite(cut.small.terms);
  if (!may_be_unstable || cut.small.damping.eta > 0) return;
  std::vector<ParameterValues> all = rom.claim.supremum->values;
  if (all.empty()) all.emplace_back();
  std::vector<double> worst{0, 0, 0}; // [1/s] growth, [rad/s], at which values
  double softest = 0;
  for (std::size_t k = 0; k < all.size(); ++k) {
    const DenseResponse response(cut.small.at(all[k]).stiffened(), cut.whole.tau);
    const auto& terms = response.system().terms;
    if (!std::all_of(terms.begin(), terms.end(), is_linear)) return;
    const double least =
        *std::min_element(response.lambda().begin(), response.lambda().end());
    softest = std::min(softest, least);
    std::vector<std::complex<double>> found = poles(response); // motion is exp(iωt)
    if (terms.empty() && least < 0) found.emplace_back(0, -std::sqrt(-least)); // about
    for (const std::complex<double>& pole : found)
      if (-pole.imag() > std::max(worst[0], rounding * std::abs(pole)))
        worst = {-pole.imag(), std::abs(pole.real()), static_cast<double>(k)};
  }
  share_from_first(cut.whole.body.comm, worst);
  const std::vector<Law> parameters = parameters_of(cut.small.terms);
  const ParameterValues& values = all[static_cast<std::size_t>(worst[2])];
  if (worst[0] > 0)
    observer.warn(
        text("the reduced body is unstable%s%s: a motion of %.4g Hz grows by e in %.3g "
             "s. H is what the equations give, no vibration that lasts",
             values.empty() ? "" : " with ",
             values.empty() ? "" : words_of(parameters, values).c_str(), worst[1] * hz,
             1 / worst[0]));
  else if (softest < 0)
    observer.fact("stability",
                  "K has negative eigenvalues; gyroscopic forces hold the reduced "
                  "body: no motion of it grows");
}

/// The claim, and what it is relative to.
void tell_supremum(const CutStory& cut, const ReducedModel& rom, Observer& observer) {
  const ErrorOverBox::Supremum& sup = cut.sup;
  const MediumModel& medium = cut.seen.model();
  const std::string label = label_of(rom);
  const bool to_band = cut.request.relative_to == RelativeTo::band;
  const RelativeTo relative_to = cut.relative_to();
  const bool of_elastic =
      relative_to == RelativeTo::elastic || relative_to == RelativeTo::both;
  const char* const references[] = {
      "|H| at each frequency", "the largest |H| in the band",
      "|H| without rigid motion at each frequency",
      "the smaller of |H| and |H| without rigid motion at each frequency"};
  const char* const reference = references[static_cast<int>(relative_to)];
  const std::vector<Law> parameters = parameters_of(rom.system.terms);
  const std::size_t values = rom.claim.supremum->values.size();
  observer.fact(
      "error",
      text(
          "%s of %s, everywhere in the band%s%s (%s), reached %.2e at %.5g Hz%s; "
          "rounding floor %.0e",
          bound_words(sup.worst_of[0], "at most %.2e").c_str(), reference,
          rom.claim.supremum->bands.size() > 1 ? "s" : "",
          values == 0 ? ""
                      : text(" with each of %zu combination%s of the parameters' values",
                             values, values == 1 ? "" : "s")
                            .c_str(),
          label.c_str(), sup.attained_of[0], sup.at_of[0] * hz,
          values == 0 ? "" : (", " + words_of(parameters, sup.values_of[0])).c_str(),
          *std::max_element(rom.claim.curve.floor.begin(), rom.claim.curve.floor.end())));
  if (const BandClaim& claim = *rom.claim.supremum; !claim.of_all_values.empty()) {
    observer.fact("all values",
                  text("at most %.2e of H with every value of the parameters in "
                       "their box (%s; %d cells of frequency and values)",
                       claim.of_all_values[0], label.c_str(), claim.cells_between));
  } else if (claim.between) {
    observer.fact(
        "between",
        text("with other values of the parameters between these, at "
             "some frequencies: %.1e (seen, not proved%s)",
             *claim.between,
             claim.cells_between > 0 ? "; the proof would be too much work" : ""));
  }
  // Beside undamped resonances |H| has no largest value; of very many ports with a damping
  // matrix it would cost as much as the claim itself.
  if (of_elastic) {
    observer.fact("relative to",
                  text("%s ({tol_relative_to} %s)", reference, word_of(relative_to)));
  } else if (values == 0 && sup.excluded.empty() &&
             (medium.has_many_ports() || !too_many_ports(medium))) {
    const auto other =
        ErrorOverBand(cut.seen, to_band ? RelativeTo::pointwise : RelativeTo::band)
            .supremum(cut.small,
                      cut.request.order.tolerance ? cut.request.order.smallest() : 0.0,
                      sup.intervals + 200);
    observer.fact("relative to",
                  text("%s ({tol_relative_to} %s); of %s the error is at most %.1e",
                       reference, word_of(relative_to), references[to_band ? 0 : 1],
                       other.worst));
  }
  if (!of_elastic && medium.rigid > 0) tell_elastic_part(cut, rom, observer);
}

/// What rounding of the data may change, beside the claim.
void tell_rounding(const CutStory& cut, const ReducedModel& rom, Observer& observer) {
  if (cut.seen.model().rigid > 0) {
    const double change = rom.claim.supremum->rigid_rounding;
    observer.fact(
        "rigid rounding",
        text("the rigid modes count as exactly rigid: what K holds of their stiffness "
             "is at the level of its rounding (change of H if it were real: %.0e)",
             change));
    constexpr double noticeable = 1e-3;
    const OrderSpec& order = cut.request.order;
    if (change >
        std::max({noticeable, cut.sup.worst, order.tolerance ? order.smallest() : 0.0}))
      observer.warn(text(
          "rounding of K holds the rigid modes a little; they count as exactly rigid. "
          "If the stored numbers were meant, H would differ by up to %.1e at the "
          "lowest frequencies: let the band ({band_hz}) begin higher",
          change));
  }
  if (!rom.claim.curve.data_rounding.empty())
    observer.fact(
        "data rounding",
        text("K looks printed with %.0f digits; such roundings may change H by %.1e "
             "(at %.5g Hz, an estimate). The error above is of the stored K",
             -std::log10(cut.whole.printed_rounding / 5),
             rom.claim.supremum->data_rounding,
             rom.claim.supremum->data_rounding_at * hz));
}

void tell_kinds(const CutStory& cut, const ReducedModel& rom, Observer& observer) {
  const MediumModel& medium = cut.seen.model();
  if (!medium.zero_views.empty())
    observer.skip("errors of " + join(medium.zero_views, ", "),
                  "H is nothing but rounding there");
  if (!rom.claim.by_kind.empty()) {
    std::string words;
    for (std::size_t k = 0; k < rom.claim.by_kind.size(); ++k) {
      words += text("%s%s at most %.1e", words.empty() ? "" : ", ",
                    rom.claim.by_kind[k].name.c_str(), rom.claim.by_kind[k].worst);
      if (!rom.claim.kind_tolerances.empty())
        words += text(" of %g", rom.claim.kind_tolerances[k]);
    }
    std::vector<std::string> vanishing;
    for (std::size_t v = 1; v < medium.views.size(); ++v) {
      const auto& sizes = cut.seen.grid().views[v].size;
      if (*std::min_element(sizes.begin(), sizes.end()) <= medium.least_size(v))
        vanishing.push_back(medium.views[v].name);
    }
    if (!vanishing.empty())
      words += text("; %s nearly vanishes somewhere: there relative to 1e-8 of what its "
                    "ports answer to themselves",
                    join(vanishing).c_str());
    observer.fact("by kind", words + " (" + label_of(rom) + ")");
  } else if (port_views(medium.names, {true, {}, {}}).size() > 1) {
    std::vector<ComplexDense> H, H_r;
    const DenseResponse response(cut.small, medium.tau);
    for (double omega : rom.claim.curve.omega) {
      H.push_back(medium.transfer(omega));
      H_r.push_back(response.transfer(omega));
      for (auto* list : {&H, &H_r}) medium.outputs().complete(list->back(), omega);
    }
    warn_of_kinds(rom.system, H, H_r, cut.sup.worst, observer);
  }
}

void tell_fields(const CutStory& cut, const ReducedModel& rom, Observer& observer) {
  if (rom.claim.fields.empty()) return;
  if (!cut.seen.model().claims_field())
    return observer.fact(
        "field", "its error is not known: dampers, loss factors of materials, terms or "
                 "gyroscopic forces couple the modes, and its bound needs them apart");
  std::string words;
  for (const FieldClaim& claim : rom.claim.fields) {
    words += text("%s%s from %s", words.empty() ? "" : ", ",
                  claim.proved ? text("at most %.1e", claim.worst).c_str() : "not known",
                  claim.inputs.c_str());
    if (claim.proved)
      words += text(" (reached %.1e at %.5g Hz)", claim.attained, claim.at * hz);
  }
  observer.fact("field",
                words + ", of the square root of its strain energy" +
                    (rom.claim.fields.front().proved ? " (" + label_of(rom) + ")" : ""));
}

void warn_of_unmet(const CutStory& cut, const ReducedModel& rom, Observer& observer) {
  std::string why = at_a_zero(cut);
  if (why.empty()) why = cut.choice.shortfall;
  if (why.empty()) why = "the bound over the band was not brought any closer to it";
  observer.warn(text(
      "{tol} %g is not met: the error is %s (%s)%s: %s", *cut.request.order.tolerance,
      bound_words(cut.sup.worst, "at most %.1e").c_str(), label_of(rom).c_str(),
      unmet_words(*rom.claim.supremum).c_str(), why.c_str()));
}

void tell_error(const CutStory& cut, const ReducedModel& rom, Observer& observer) {
  tell_supremum(cut, rom, observer);
  tell_stability(cut, rom, observer);
  tell_rounding(cut, rom, observer);
  tell_kinds(cut, rom, observer);
  tell_fields(cut, rom, observer);
  if (!rom.claim.supremum->met) warn_of_unmet(cut, rom, observer);
}

} // namespace

void tell(const CutStory& cut, const ReducedModel& rom, Observer& observer) {
  const MediumModel& medium = cut.seen.model();
  const Candidate& candidate = cut.choice.candidates[cut.choice.best];
  observer.fact(
      "order",
      text("m = %d of n = %lld, by %s, from %s%s", cut.choice.order,
           static_cast<long long>(medium.names.n), cut.choice.chosen_by.c_str(),
           candidate.name.c_str(),
           candidate.remark.empty() ? "" : (" (" + candidate.remark + ")").c_str()));
  tell_error(cut, rom, observer);
  observer.fact("reduced modes", describe_modes(rom.modes, medium.rigid));
  if (!rom.claim.held.empty())
    observer.fact("held", held_words(rom.claim.held) + "; not part of the claim");
  observer.fact("reduced M, K",
                text("smallest over largest eigenvalue %.1e, %.1e; V'MV = I to %.0e",
                     relative_smallest_eigenvalue(rom.system.M),
                     relative_smallest_eigenvalue(rom.system.K),
                     cut.whole.loss_of_orthogonality));
  observer.print();
}

} // namespace flexgram
