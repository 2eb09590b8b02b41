/// What a user may not ask for: each option refused by its name, before any work.

#include "base/text.hpp"
#include "basis/method.hpp"
#include "model/port_views.hpp"
#include "run/settings.hpp"

#include <cstdlib>

namespace flexgram {
namespace {

std::string words_of(const std::vector<double>& numbers) {
  std::string words;
  for (double x : numbers) words += text("%s%g", words.empty() ? "" : ",", x);
  return words;
}

} // namespace

void Settings::check_solver() const {
  const MumpsOptions& mumps = solver.mumps;
  const auto number = [](const auto& controls, const char* name, int last) {
    for (auto [n, value] : controls)
      require_option(n >= 1 && n <= last, text("-mor_mumps_%s_%d", name, n).c_str(),
                     text("%g", value), text("numbered 1 to %d", last).c_str());
  };
  number(mumps.icntl, "icntl", 60);
  number(mumps.cntl, "cntl", 15);
  for (int owned : {5, 18, 19, 20, 21})
    require_option(!mumps.icntl.count(owned), text("-mor_mumps_icntl_%d", owned).c_str(),
                   "", "left alone: flexgram sets how matrices and solutions are passed");
  require_option(mumps.workspace_percent >= 0, "-mor_mumps_workspace",
                 std::to_string(mumps.workspace_percent), "0 or more");
  require_option(mumps.workspace_limit >= mumps.workspace_percent,
                 "-mor_mumps_workspace_limit", std::to_string(mumps.workspace_limit),
                 "at least -mor_mumps_workspace");
  require_option(mumps.memory_limit_mb >= 0, "-mor_memory_limit_mb",
                 text("%g", mumps.memory_limit_mb), "0 or more");
  require_option(solver.refinements >= 0, "-mor_refinements",
                 std::to_string(solver.refinements), "0 or more");
  require_option(solver.backward_error > 0, "-mor_backward_error",
                 text("%g", solver.backward_error), "above 0");
  require_option(load_patterns >= 0, "-mor_load_patterns", std::to_string(load_patterns),
                 "0 (each port by itself) or more");
  if (takes_samples() && relative_to == RelativeTo::elastic)
    throw Error(
        "{method} pod knows no elastic part of H: {tol_relative_to} elastic is of the "
        "others");
  if (load_patterns > 0 && !loads.empty())
    throw Error("{loads} and {load_patterns} exclude each other");
  require_option(groups >= 0, "-mor_groups", std::to_string(groups),
                 "0 (automatic) or more");
}

void Settings::check_band() const {
  const std::string words = words_of(band_hz);
  require_option(band_hz.size() == 1 || (band_hz.size() > 1 && band_hz.size() % 2 == 0),
                 "-mor_band_hz", words,
                 "first,last, or one frequency, or several bands in pairs");
  require_option(band_hz.front() >= 0, "-mor_band_hz", words, "zero or more");
  for (std::size_t i = 1; i < band_hz.size(); ++i)
    require_option(band_hz[i - 1] <= band_hz[i], "-mor_band_hz", words,
                   "first,last with first <= last");
  if (takes_samples())
    require_option(band_hz.size() <= 2, "-mor_band_hz",
                   text("with %zu bands", band_hz.size() / 2),
                   "one band with -mor_method pod");
  if (takes_samples() && logarithmic && band_hz.front() <= 0)
    throw Error("-mor_spacing log: the band must start above zero");
}

void Settings::check_lists() const {
  bool good = weight.size() % 2 == 0 && weight.size() != 2;
  for (std::size_t i = 0; good && i < weight.size(); i += 2)
    good = weight[i] >= 0 && weight[i + 1] >= 0 && (i == 0 || weight[i] > weight[i - 2]);
  require_option(good, "-mor_weight", words_of(weight),
                 "f1,w1,f2,w2,... with rising f and w >= 0");
  for (double f : shifts_hz)
    require_option(f >= 0, "-mor_shifts_hz", text("%g", f), "zero or more");
  require_option(error_hz.empty() || (error_hz.size() == 3 && error_hz[0] >= 0 &&
                                      error_hz[0] <= error_hz[1] && error_hz[2] >= 1),
                 "-mor_error_hz", std::to_string(error_hz.size()) + " numbers",
                 "first,last,count with first <= last");
}

void Settings::check_order() {
  if (order_word == "auto" || order_word == "rule") {
    order.order = 0;
  } else {
    const bool digits = order_word.size() < 9 &&
                        order_word.find_first_not_of("0123456789") == std::string::npos;
    order.order = digits ? std::stoi(order_word) : 0;
    require_option(order.order > 0, "-mor_order", order_word,
                   "a whole number from 1 on, rule or auto");
  }
  if (order.tolerance && order_word != "auto")
    throw Error("give {tol} or {order}, not both: a tolerance chooses the order");
}

/// Tolerances of kinds.
void Settings::check_kinds() {
  for (const std::string& word : split(tolerances_of_kinds, ',')) {
    const auto equals = word.find('=');
    const std::string kind = word.substr(0, equals);
    require_option(
        equals != std::string::npos && (is_known_kind(kind) || names_ports(kind)),
        "-mor_tol_kind", word,
        "KIND=TOLERANCE, KIND such as stress or displacement from force, or outputs "
        "by name such as foot.ry or foot.*");
    char* end = nullptr;
    const double value = std::strtod(word.c_str() + equals + 1, &end);
    require_option(*end == 0 && value > 0 && value < 1, "-mor_tol_kind", word,
                   "a tolerance above 0 and below 1");
    for (const auto& [known, other] : order.of_kinds)
      require_option(known != kind, "-mor_tol_kind", tolerances_of_kinds,
                     "of each kind once");
    order.of_kinds.emplace_back(kind, value);
  }
  if (order.of_kinds.empty()) return;
  bool chooses = order.tolerance.has_value(); // else a default that not all methods have
  if (!chooses && order_word == "auto" && !takes_samples()) {
    chooses = true;
    for (const auto& name : methods()) chooses = chooses && !flexgram::method(name).rule;
  }
  require_option(chooses, "-mor_tol_kind", tolerances_of_kinds,
                 "given beside -mor_tol: no tolerance chooses the order here");
  require_option(order.each_kind, "-mor_tol_kind", tolerances_of_kinds,
                 "given with -mor_tol_of each_kind");
  require_option(loads.empty() && load_patterns == 0, "-mor_tol_kind",
                 tolerances_of_kinds,
                 "given without -mor_loads and -mor_load_patterns: loads are of no kind");
}

void Settings::check() {
  check_band();
  require_option(samples >= 1, "-mor_samples", std::to_string(samples), "1 or more");
  if (order.tolerance)
    require_option(*order.tolerance > 0 && *order.tolerance < 1, "-mor_tol",
                   text("%g", *order.tolerance), "above 0 and below 1");
  check_order();
  require_option(validate >= 0, "-mor_validate", std::to_string(validate), "0 or more");
  require_option(moments >= 1, "-mor_moments", std::to_string(moments), "1 or more");
  require_option(cutoff >= 1.05, "-mor_cutoff", text("%g", cutoff), "1.05 or more");
  require_option(medium_order >= 0, "-mor_medium_order", std::to_string(medium_order),
                 "0 (automatic) or more");
  require_option(medium_target >= 0 && medium_target < 1, "-mor_medium_tol",
                 text("%g", medium_target), "0 (automatic) or below 1");
  require_option(parameter_values >= 0 && parameter_values <= 100,
                 "-mor_parameter_values", std::to_string(parameter_values), "0 to 100");
  require_option(!field_error || !takes_samples(), "-mor_field_error", "yes",
                 "no with -mor_method pod, whose errors are estimated");
  check_lists();
  check_solver();
  check_kinds();
}

} // namespace flexgram
