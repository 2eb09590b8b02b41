#include "medium/error_between.hpp"

#include "base/parallel.hpp"
#include "linalg/decompositions.hpp"
#include "medium/cell_bound.hpp"

#include <algorithm>
#include <cmath>

namespace flexgram {
namespace {

/// How often regions are halved, and cells of a region.
constexpr int most_regions = 7, most_halvings = 14;
/// First regions along ω and along each parameter.
constexpr int along_omega = 4, along_parameters = 4;
/// Every such share of it tells how much is left; it ends early where that is far too much.
constexpr double look_every = 0.1;

/// So many times the most work may be left, as the last share tells, after `spent` times it: the next
/// regions may be easier, of which there are fewer and fewer.
double hopeless(double spent) { return 0.7 / spent; }

} // namespace

struct ErrorBetween::Search {
  double limit = 0;
  double work = 0; ///< that was done
  double done = 0; ///< share of the rank's regions
  double last_look = 0, done_then = 0;
  bool given_up = false;
  Supremum found;

  /// @return whether it goes on.
  bool take(double more) {
    work += more;
    if (work > last_look + look_every * most_work) {
      const double lately = done - done_then, spent = work - last_look;
      if ((1 - done) * spent > hopeless(work / most_work) * most_work * lately)
        given_up = true;
      last_look = work;
      done_then = done;
    }
    if (work > most_work) given_up = true;
    found.proved = found.proved && !given_up;
    return found.proved;
  }
};

ErrorBetween::ErrorBetween(const MediumModel& medium, const Dense& Q)
    : medium_(medium), couplings_(medium.couplings()), Q_(orthonormal_columns(Q)) {}

void ErrorBetween::prove(const CellBound& bound, const Cell& cell, int depth,
                         double share, Search& search) const {
  if (!search.found.proved) return;
  ++search.found.cells;
  if (!search.take(work_of_a_cell())) return;
  const CellBound::Look look = bound.look(cell);
  bool enough = !look.worst_of.empty();
  for (std::size_t v = 0; v < look.worst_of.size(); ++v)
    enough = enough && look.worst_of[v] <= search.limit * medium_.views[v].allowed;
  if (enough) {
    for (std::size_t v = 0; v < look.worst_of.size(); ++v)
      search.found.worst_of[v] = std::max(search.found.worst_of[v], look.worst_of[v]);
    search.done += share;
    return;
  }
  if (depth == most_halvings) {
    search.found.proved = false;
    return;
  }
  const auto [low, high] = cell.halves(look.longest);
  prove(bound, low, depth + 1, share / 2, search);
  prove(bound, high, depth + 1, share / 2, search);
}

void ErrorBetween::prove(const Cell& region, int depth, double share,
                         Search& search) const {
  if (!search.found.proved || !search.take(work_of_a_region())) return;
  const CellBound bound(medium_, Q_, couplings_, region);
  const Search before = search;
  if (bound.holds()) prove(bound, region, 0, share, search);
  if (bound.holds() && search.found.proved) return;
  if (depth == most_regions || search.given_up) {
    search.found.proved = false;
    return;
  }
  const int cells = search.found.cells;
  search.found = before.found;
  search.found.cells = cells;
  search.done = before.done;
  // E is that of a corner: along which variable it is farther from the rest is not known.
  const auto variable = static_cast<std::size_t>(depth) % region.variables();
  const auto [low, high] = region.halves(variable);
  prove(low, depth + 1, share / 2, search);
  prove(high, depth + 1, share / 2, search);
}

double ErrorBetween::work_of_a_cell() const {
  const double r = Q_.columns, z = Q_.rows - Q_.columns, p = couplings_.ports.columns;
  const double sides = is_symmetric(medium_.system.terms) ? 1 : 2;
  return sides * (400 * r * r * r + 100 * z * r * (r + p) + 100 * z * p * (z + p));
}
double ErrorBetween::work_of_a_region() const { return 60 * std::pow(Q_.rows, 3); }

ErrorBetween::Supremum ErrorBetween::supremum(MPI_Comm comm,
                                              const std::vector<Interval>& bands,
                                              double limit) const {
  std::vector<Interval> box;
  for (const Law& law : parameters_of(medium_.system.terms))
    box.push_back({law.number("least"), law.number("most")});
  const auto parts_of = [](const Interval& whole, int count) {
    std::vector<Interval> parts;
    for (int k = 0; k < count; ++k)
      parts.push_back(
          {k == 0 ? whole.first : parts.back().last,
           k + 1 == count ? whole.last : whole.first + whole.width() * (k + 1) / count});
    return parts;
  };
  std::vector<Cell> regions;
  for (const Interval& band : bands)
    for (const Interval& omega : parts_of(band, along_omega))
      regions.push_back({omega, {}});
  for (const Interval& values : box) {
    std::vector<Cell> finer;
    for (const Cell& region : regions)
      for (const Interval& part :
           parts_of(values, box.size() == 1 ? along_parameters : 2)) {
        finer.push_back(region);
        finer.back().values.push_back(part);
      }
    regions = std::move(finer);
  }
  Search search;
  search.limit = limit;
  search.found.proved = couplings_.provable;
  search.found.worst_of.assign(medium_.views.size(), 0.0);
  const auto rank = static_cast<std::size_t>(comm_rank(comm)),
             size = static_cast<std::size_t>(comm_size(comm));
  const double own =
      std::ceil(static_cast<double>(regions.size()) / static_cast<double>(size));
  agree(comm, [&] {
    try {
      for (std::size_t k = rank; k < regions.size(); k += size)
        prove(regions[k], 0, 1 / own, search);
    } catch (const Error&) { // of dense work: the claim with some values stands
      search.found.proved = false;
    }
  });
  Supremum all;
  for (double worst : search.found.worst_of)
    all.worst_of.push_back(max_over(comm, worst));
  all.proved = max_over(comm, search.found.proved ? 0.0 : 1.0) == 0;
  all.cells = static_cast<int>(sum_over(comm, static_cast<double>(search.found.cells)));
  return all;
}

} // namespace flexgram
