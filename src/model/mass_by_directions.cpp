#include "model/mass_by_directions.hpp"

#include "base/index.hpp"
#include "linalg/sparse.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <numeric>
#include <span>
#include <utility>

namespace flexgram {
namespace {

/// Roundings of one mass that an assembly wrote in three places.
constexpr double rounding = 4 * std::numeric_limits<double>::epsilon();
/// Of the rows: if the rest has more, nothing is gained.
constexpr double most_rest = 0.7;

/// This rank's numbers among those of all, `count` of them here. Collective.
RowRange numbered(MPI_Comm comm, std::size_t count) {
  const auto mine = static_cast<PetscInt>(count);
  PetscInt end = 0;
  MPI_Scan(&mine, &end, 1, MPIU_INT, MPI_SUM, comm);
  return {end - mine, end};
}

PetscInt total_of(MPI_Comm comm, RowRange range) {
  return static_cast<PetscInt>(sum_over(comm, static_cast<std::int64_t>(range.size())));
}

/// Rows of this rank that are the three displacements of a node, or its three rotations.
std::array<std::vector<PetscInt>, 3> triples_of(const SecondOrderModel& model) {
  std::map<std::int64_t, std::array<PetscInt, 3>> found; // in the order of the nodes
  for (std::size_t i = 0; i < model.node.size(); ++i) {
    const std::int64_t of_node = 2 * model.node[i] + model.component[i] / 3;
    const auto at = found.try_emplace(of_node, std::array<PetscInt, 3>{-1, -1, -1}).first;
    at->second[as_size(model.component[i] % 3)] = static_cast<PetscInt>(i);
  }
  std::array<std::vector<PetscInt>, 3> rows;
  for (const auto& [key, three] : found)
    if (std::ranges::min(three) >= 0)
      for (std::size_t c = 0; c < 3; ++c) rows[c].push_back(three[c]);
  return rows;
}

/// Calls visit(column, value) for the entries of a row that are not zero.
template <class Visit>
void for_each_in_row(Mat a, PetscInt row, Visit&& visit) {
  PetscInt count = 0;
  const PetscInt* columns = nullptr;
  const PetscScalar* values = nullptr;
  FG_CALL(MatGetRow(a, row, &count, &columns, &values));
  for (PetscInt k = 0; k < count; ++k)
    if (values[k] != 0) visit(columns[k], values[k]);
  FG_CALL(MatRestoreRow(a, row, &count, &columns, &values));
}

/// Entries of M_s in a row, and a place to look them up.
class SameRow {
public:
  explicit SameRow(PetscInt triples) : value_(as_size(triples), 0.0) {}
  void add(PetscInt triple, double mass) {
    value_[as_size(triple)] = mass;
    triples_.push_back(triple);
  }
  double operator[](PetscInt triple) const { return value_[as_size(triple)]; }
  const std::vector<PetscInt>& triples() const { return triples_; }
  void clear() {
    for (const PetscInt triple : triples_) value_[as_size(triple)] = 0;
    triples_.clear();
  }

private:
  std::vector<double> value_;
  std::vector<PetscInt> triples_;
};

void close_row(LocalRows& rows) {
  rows.start.push_back(static_cast<PetscInt>(rows.column.size()));
}

} // namespace

MassByDirections::MassByDirections(const SecondOrderModel& model)
    : rows_(triples_of(model)) {
  const MPI_Comm comm = model.comm;
  const std::size_t mine = rows_[0].size(), local = as_size(model.rows.size());
  triples_ = numbered(comm, mine);
  const PetscInt count = total_of(comm, triples_);
  std::vector<PetscInt> own(local, -1); // 3 triple + direction of each row; −1: of none
  for (std::size_t t = 0; t < mine; ++t)
    for (int c = 0; c < 3; ++c)
      own[as_size(rows_[as_size(c)][t])] =
          3 * (triples_.begin + static_cast<PetscInt>(t)) + c;
  const std::vector<PetscInt> place = gathered(comm, std::span<const PetscInt>(own));

  std::vector<PetscInt> row_at(as_size(3 * count)); // the inverse
  for (std::size_t j = 0; j < place.size(); ++j)
    if (place[j] >= 0) row_at[as_size(place[j])] = static_cast<PetscInt>(j);

  // Of each row what M_s does not hold; those of a triple one after the other.
  LocalRows same;
  std::vector<std::vector<std::pair<PetscInt, double>>> rest(local);
  SameRow of_first(count);
  for (std::size_t t = 0; t < mine; ++t) {
    of_first.clear();
    const auto row = [&](int c) { return rows_[as_size(c)][t]; };
    for_each_in_row(model.M, model.rows.begin + row(0), [&](PetscInt j, double mass) {
      const PetscInt at = place[as_size(j)];
      if (at >= 0 && at % 3 == 0)
        of_first.add(at / 3, mass);
      else
        rest[as_size(row(0))].emplace_back(j, mass);
    });
    std::vector<PetscInt> order = of_first.triples();
    std::ranges::sort(order);
    for (const PetscInt q : order) {
      same.column.push_back(q);
      same.value.push_back(of_first[q]);
    }
    close_row(same);
    for (const int c : {1, 2}) {
      auto& left = rest[as_size(row(c))];
      std::vector<PetscInt> met;
      for_each_in_row(model.M, model.rows.begin + row(c), [&](PetscInt j, double mass) {
        const PetscInt at = place[as_size(j)];
        const double known = at >= 0 && at % 3 == c ? of_first[at / 3] : 0.0;
        if (known != 0) met.push_back(at / 3);
        if (std::abs(mass - known) > rounding * std::abs(mass))
          left.emplace_back(j, mass - known);
      });
      if (met.size() == order.size()) continue;
      std::ranges::sort(met);
      for (const PetscInt q : order) // M_s has entries that this direction has not
        if (!std::ranges::binary_search(met, q))
          left.emplace_back(row_at[as_size(3 * q + c)], -of_first[q]);
    }
  }
  for (std::size_t i = 0; i < local; ++i)
    if (own[i] < 0)
      for_each_in_row(model.M, model.rows.begin + static_cast<PetscInt>(i),
                      [&](PetscInt j, double mass) { rest[i].emplace_back(j, mass); });

  for (std::size_t i = 0; i < local; ++i)
    if (!rest[i].empty()) rest_rows_.push_back(static_cast<PetscInt>(i));
  rest_range_ = numbered(comm, rest_rows_.size());
  const PetscInt left = total_of(comm, rest_range_);
  if (left > most_rest * model.n) {
    rest_ = model.M.share();
    rest_range_ = model.rows;
    rest_rows_.resize(local);
    std::iota(rest_rows_.begin(), rest_rows_.end(), 0);
    return;
  }
  same_ = make_sparse(comm, triples_, count, same);
  if (left == 0) return;
  std::vector<PetscInt> number(local, -1);
  for (std::size_t k = 0; k < rest_rows_.size(); ++k)
    number[as_size(rest_rows_[k])] = rest_range_.begin + static_cast<PetscInt>(k);
  const std::vector<PetscInt> column = gathered(comm, std::span<const PetscInt>(number));
  LocalRows entries;
  for (const PetscInt i : rest_rows_) {
    auto& row = rest[as_size(i)];
    std::ranges::sort(row);
    for (const auto& [j, mass] : row)
      if (column[as_size(j)] >= 0) { // else rounding: M is symmetric but for that
        entries.column.push_back(column[as_size(j)]);
        entries.value.push_back(mass);
      }
    close_row(entries);
  }
  rest_ = make_sparse(comm, rest_range_, left, entries);
}

Block MassByDirections::taken(const Block& v, const std::vector<PetscInt>& rows,
                              RowRange range) const {
  Block part(v.comm(), range, total_of(v.comm(), range), v.columns());
  const Block::Access from(v);
  Block::Access to(part);
  for (PetscInt j = 0; j < v.columns(); ++j)
    for (std::size_t i = 0; i < rows.size(); ++i)
      to.column(j)[i] = from.column(j)[rows[i]];
  return part;
}

} // namespace flexgram
