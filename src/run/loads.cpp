#include "run/loads.hpp"

#include "base/index.hpp"
#include "base/text.hpp"
#include "model/load_patterns.hpp"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <map>
#include <numbers>
#include <sstream>

namespace flexgram {
namespace {

std::vector<std::string> cells_of(const std::string& line) {
  std::vector<std::string> cells;
  std::istringstream stream(line);
  for (std::string cell; std::getline(stream, cell, ',');) {
    const auto first = cell.find_first_not_of(" \t\r\""),
               last = cell.find_last_not_of(" \t\r\"");
    cells.push_back(first == std::string::npos ? ""
                                               : cell.substr(first, last - first + 1));
  }
  return cells;
}

/// A table: the first line names the loads, each other line a port and its share of each
/// load; ports that are not named carry nothing. Each load comes back with unit norm.
LoadSpan read_loads(const std::string& path, const std::vector<std::string>& ports) {
  std::ifstream file(path);
  if (!file || std::filesystem::is_directory(path))
    throw Error("-mor_loads " + path + ": cannot be read");
  std::map<std::string, int> row_of;
  for (std::size_t i = 0; i < ports.size(); ++i) row_of[ports[i]] = static_cast<int>(i);
  LoadSpan loads;
  std::vector<bool> seen(ports.size(), false);
  int number = 0;
  for (std::string line; std::getline(file, line);) {
    ++number;
    const std::vector<std::string> cells = cells_of(line);
    if (cells.empty() || (cells.size() == 1 && cells[0].empty())) continue;
    if (cells[0][0] == '#') continue;
    const auto refuse = [&](const std::string& why) {
      throw Error(text("-mor_loads %s, line %d: %s", path.c_str(), number, why.c_str()));
    };
    if (loads.names.empty()) {
      loads.names.assign(cells.begin() + 1, cells.end());
      if (loads.names.empty() || row_of.count(cells[0]))
        refuse("expected a word for the ports and the names of the loads");
      for (std::size_t i = 0; i < loads.names.size(); ++i)
        if (loads.names[i].empty() ||
            std::find(loads.names.begin(), loads.names.begin() + static_cast<long>(i),
                      loads.names[i]) != loads.names.begin() + static_cast<long>(i))
          refuse("load '" + loads.names[i] +
                 "' has no name or one that is there already");
      loads.patterns =
          Dense(static_cast<int>(ports.size()), static_cast<int>(loads.names.size()));
      continue;
    }
    const auto port = row_of.find(cells[0]);
    if (port == row_of.end()) refuse("the body has no input '" + cells[0] + "'");
    if (seen[as_size(port->second)]) refuse("'" + cells[0] + "' is there twice");
    seen[as_size(port->second)] = true;
    if (cells.size() != loads.names.size() + 1)
      refuse(text("%zu numbers, expected %zu", cells.size() - 1, loads.names.size()));
    for (std::size_t j = 0; j < loads.names.size(); ++j) {
      const std::string& cell = cells[j + 1];
      char* end = nullptr;
      const double value = std::strtod(cell.c_str(), &end); // a sign, and what underflows
      if (cell.empty() || end != cell.c_str() + cell.size() || !std::isfinite(value))
        refuse("'" + cell + "' is no number");
      loads.patterns(port->second, static_cast<int>(j)) = value;
    }
  }
  if (loads.names.empty()) throw Error("-mor_loads " + path + ": is empty");
  // Of unit size: none counts less than another for the unit that it is written in.
  for (int j = 0; j < loads.patterns.columns; ++j) {
    double* column = loads.patterns.column(j);
    double largest = 0, square = 0;
    for (int i = 0; i < loads.patterns.rows; ++i)
      largest = std::max(largest, std::abs(column[i]));
    if (largest == 0)
      throw Error("-mor_loads " + path + ": load '" + loads.names[as_size(j)] +
                  "' is zero");
    for (int i = 0; i < loads.patterns.rows; ++i)
      square += std::pow(column[i] / largest, 2);
    for (int i = 0; i < loads.patterns.rows; ++i)
      column[i] = column[i] / largest / std::sqrt(square);
  }
  return loads;
}

} // namespace

std::optional<LoadSpan> loads_of(const Body& body, const Settings& s,
                                 Observer& observer) {
  if (s.loads.empty() && s.load_patterns == 0) return std::nullopt;
  if (s.frame == FrameKind::tangent)
    throw Error("{frame} tangent follows an interface, and {loads} and {load_patterns} "
                "reduce for loads instead of interfaces");
  if (s.order.kinds().each)
    observer.skip("errors by kind", "loads are of no kind: the error is of all of H");
  const int p = static_cast<int>(body.model.B.columns());
  if (!s.loads.empty()) {
    LoadSpan loads;
    agree(body.model.comm, [&] { loads = read_loads(s.loads, body.model.inputs); });
    observer.fact("loads", text("%d of %s at %d inputs: %s", loads.patterns.columns,
                                s.loads.c_str(), p, join(loads.names, ", ").c_str()));
    return loads;
  }
  if (s.load_patterns >= p) {
    observer.skip("load patterns", text("there are %d inputs", p));
    return std::nullopt;
  }
  double last = 0;
  for (const Interval& band : s.bands()) last = std::max(last, band.last);
  if (last == 0) last = 2 * std::numbers::pi; // statics: at 1 Hz
  LeadingPatterns leading =
      leading_patterns(body.model, s.load_patterns, last * last, s.solver, observer);
  LoadSpan loads{std::move(leading.patterns), {}};
  for (int j = 0; j < loads.patterns.columns; ++j)
    loads.names.push_back(text("pattern%d", j + 1));
  observer.fact("loads",
                text("the leading %d patterns of %d inputs: %.3g %% of their "
                     "compliance, the next has %.1e of the first",
                     loads.patterns.columns, p, 100 * leading.held, leading.next));
  return loads;
}

} // namespace flexgram
