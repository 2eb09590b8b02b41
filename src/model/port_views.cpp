#include "model/port_views.hpp"

#include "base/index.hpp"
#include "base/text.hpp"

#include <algorithm>
#include <numeric>

namespace flexgram {
namespace {

struct Kind {
  const char *letters, *input, *output; ///< null: there is none
};
constexpr Kind kinds[] = {
    {"f", "force", "displacement"},     {"m", "moment", "rotation"},
    {"a", "acceleration", nullptr},     {"alpha", "angular acceleration", nullptr},
    {"spin", "spin", "inertia"},        {"p", "pressure", nullptr},
    {"t", "traction", nullptr},         {"u", nullptr, "displacement"},
    {"s", nullptr, "stress"},           {"load", "load", nullptr},
    {"T", "temperature", nullptr},      {"r", nullptr, "reaction"},
    {"rm", nullptr, "reaction moment"}, {"e", nullptr, "strain"},
    {"e0", nullptr, "strain"},          {"e45", nullptr, "strain"},
    {"e90", nullptr, "strain"},         {"Tn", "temperature gradient", nullptr},
};

const Kind* find_kind(const std::string& letters) {
  for (const Kind& kind : kinds)
    if (letters == kind.letters) return &kind;
  return nullptr;
}

/// Numbers of the ports of each kind, in the order in which they come.
std::vector<std::pair<std::string, std::vector<int>>>
ports_by(const char* Kind::*role, const std::vector<std::string>& names) {
  std::vector<std::pair<std::string, std::vector<int>>> found;
  for (std::size_t i = 0; i < names.size(); ++i) {
    const Kind* kind = find_kind(kind_of_port(names[i]));
    if (!kind || !(kind->*role)) continue;
    auto same = std::find_if(found.begin(), found.end(), [&](const auto& other) {
      return other.first == kind->*role;
    });
    if (same == found.end()) same = found.insert(found.end(), {kind->*role, {}});
    same->second.push_back(static_cast<int>(i));
  }
  return found;
}

std::string names_of(const std::vector<PortView>& views) {
  std::vector<std::string> names;
  for (std::size_t v = 1; v < views.size(); ++v) names.push_back(views[v].name);
  return join(names);
}

/// What each view may err.
void allow(std::vector<PortView>& views, const KindSpec& spec) {
  std::vector<bool> met(spec.kinds.size(), false);
  for (PortView& view : views) {
    view.allowed = spec.others;
    const std::string output = view.name.substr(0, view.name.find(" from "));
    for (const std::string& word : {output, view.name}) // the whole name counts
      for (std::size_t k = 0; k < spec.kinds.size(); ++k)
        if (spec.kinds[k] == word) {
          view.allowed = spec.allowed[k];
          met[k] = true;
        }
  }
  for (std::size_t k = 0; k < met.size(); ++k)
    if (!met[k])
      throw Error(
          text("{tol_kind}: no ports make %s; there are %s", spec.kinds[k].c_str(),
               views.size() > 1 ? names_of(views).c_str()
                                : "none: the ports' names tell no kinds (x.fx … x.mz)"));
  for (const PortView& view : views)
    views.front().allowed = std::max(views.front().allowed, view.allowed);
}

std::vector<int> all_of(std::size_t count) {
  std::vector<int> all(count);
  std::iota(all.begin(), all.end(), 0);
  return all;
}

} // namespace

OutputForm claimed_outputs(const SecondOrderModel& names) {
  OutputForm form = names.output_form();
  for (std::size_t i = 0; i < names.outputs.size(); ++i)
    if (kind_of_port(names.outputs[i]) == "s") form.leave_out_direct(static_cast<int>(i));
  return form;
}

std::string kind_of_port(const std::string& name) {
  const auto dot = name.rfind('.');
  if (dot == std::string::npos) return "";
  const std::string last = name.substr(dot + 1),
                    letters = last.substr(0, last.find_last_not_of("xyz") + 1);
  if (letters.empty()) return "";
  const std::size_t directions = last.size() - letters.size();
  const bool plain = letters == "p" || letters == "load" || letters == "T" ||
                     letters == "Tn" || letters.front() == 'e'; // strains by their angle
  const bool fits = plain               ? directions == 0
                    : letters == "u"    ? directions <= 1
                    : letters == "spin" ? directions == 0 || directions == 2
                    : letters == "s"    ? directions == 2
                                        : directions == 1;
  return find_kind(letters) && fits ? letters : "";
}

std::vector<std::pair<std::string, std::vector<int>>>
interfaces_of(const std::vector<std::string>& names) {
  std::vector<std::pair<std::string, std::vector<int>>> found;
  for (std::size_t i = 0; i < names.size(); ++i) {
    const std::string kind = kind_of_port(names[i]);
    if (kind != "f" && kind != "m") continue;
    const std::string name = names[i].substr(0, names[i].rfind('.'));
    auto same = std::find_if(found.begin(), found.end(),
                             [&](const auto& other) { return other.first == name; });
    if (same == found.end()) same = found.insert(found.end(), {name, {}});
    same->second.push_back(static_cast<int>(i));
  }
  return found;
}

ComplexDense PortView::of(const ComplexDense& H) const {
  ComplexDense part(static_cast<int>(rows.size()), static_cast<int>(columns.size()));
  for (int j = 0; j < part.columns; ++j)
    for (int i = 0; i < part.rows; ++i)
      part(i, j) = H(rows[as_size(i)], columns[as_size(j)]);
  return part;
}

bool is_known_kind(const std::string& word) {
  const auto from = word.find(" from ");
  const std::string output = word.substr(0, from),
                    input = from == std::string::npos ? "" : word.substr(from + 6);
  const auto named = [](const char* Kind::*role, const std::string& name) {
    return std::any_of(std::begin(kinds), std::end(kinds), [&](const Kind& kind) {
      return kind.*role && name == kind.*role;
    });
  };
  return named(&Kind::output, output) &&
         (from == std::string::npos || named(&Kind::input, input));
}

bool names_ports(const std::string& word) {
  const std::string output = word.substr(0, word.find(" from "));
  const auto dot = output.rfind('.');
  return dot != std::string::npos && dot > 0 && dot + 1 < output.size();
}

namespace {

/// Outputs by a name, or by the part of it before ".*".
std::vector<int> outputs_named(const std::vector<std::string>& outputs,
                               const std::string& word) {
  const bool all = word.size() > 2 && word.compare(word.size() - 2, 2, ".*") == 0;
  const std::string stem = all ? word.substr(0, word.size() - 1) : word;
  std::vector<int> rows;
  for (std::size_t i = 0; i < outputs.size(); ++i)
    if (all ? outputs[i].rfind(stem, 0) == 0 : outputs[i] == stem)
      rows.push_back(static_cast<int>(i));
  return rows;
}

} // namespace

std::vector<PortView> port_views(const SecondOrderModel& names, const KindSpec& spec) {
  std::vector<PortView> views{
      {"all ports", all_of(names.outputs.size()), all_of(names.inputs.size())}};
  if (!spec.each) return views;
  const auto rows_of = ports_by(&Kind::output, names.outputs),
             columns_of = ports_by(&Kind::input, names.inputs);
  const auto are = [](const auto& kinds, const char* one, const char* other) {
    return kinds.size() == 2 &&
           std::all_of(kinds.begin(), kinds.end(), [&](const auto& kind) {
             return kind.first == one || kind.first == other;
           });
  };
  // Displacements from moments are as rotations from forces: beside those of their own
  // kind alone nothing is hidden.
  const bool square =
      are(rows_of, "displacement", "rotation") && are(columns_of, "force", "moment");
  for (const auto& [output, rows] : rows_of)
    for (const auto& [input, columns] : columns_of) {
      const bool crossed = (output == "displacement" && input == "moment") ||
                           (output == "rotation" && input == "force");
      if (!square || !crossed)
        views.push_back(
            {text("%s from %s", output.c_str(), input.c_str()), rows, columns});
    }
  for (const std::string& word : spec.kinds) { // a port may be a kind of its own
    if (is_known_kind(word) || !names_ports(word)) continue;
    const auto from = word.find(" from ");
    const std::string output = word.substr(0, from),
                      asked = from == std::string::npos ? "" : word.substr(from + 6);
    const std::vector<int> rows = outputs_named(names.outputs, output);
    if (rows.empty())
      throw Error(text("{tol_kind}: there is no output %s, did you mean %s?",
                       output.c_str(), nearest(output, names.outputs).c_str()));
    for (const auto& [input, columns] : columns_of)
      if (asked.empty() || asked == input)
        views.push_back(
            {text("%s from %s", output.c_str(), input.c_str()), rows, columns});
  }
  allow(views, spec);
  if (views.size() == 2 && views[1].rows == views[0].rows &&
      views[1].columns == views[0].columns) { // one kind: nothing is hidden
    views.front().allowed = views.back().allowed;
    views.pop_back();
  }
  return views;
}

} // namespace flexgram
