#include "linalg/ordering.hpp"

#include "base/event.hpp"
#include "base/index.hpp"
#include "base/text.hpp"

#include <metis.h>

#include <algorithm>
#include <numeric>
#include <unordered_map>

namespace flexgram {
namespace {

/// Numbers 0 … count − 1 in the order of first appearance.
int renumber(std::vector<std::int64_t>& labels) {
  std::unordered_map<std::int64_t, std::int64_t> number;
  for (auto& label : labels)
    label = number.emplace(label, static_cast<std::int64_t>(number.size())).first->second;
  return static_cast<int>(number.size());
}

struct Graph {
  std::vector<idx_t> start, neighbour;
};

/// Symmetric adjacency from keys (a << 32 | b), a ≠ b, sorted and unique.
Graph adjacency(int nodes, const std::vector<std::uint64_t>& edges) {
  Graph graph;
  graph.start.assign(as_size(nodes) + 1, 0);
  const auto ends = [](std::uint64_t key) {
    return std::pair{as_size(key >> 32), as_size(key & 0xffffffffU)};
  };
  for (auto key : edges) {
    const auto [a, b] = ends(key);
    ++graph.start[a + 1];
    ++graph.start[b + 1];
  }
  std::partial_sum(graph.start.begin(), graph.start.end(), graph.start.begin());
  graph.neighbour.resize(2 * edges.size());
  std::vector<idx_t> next(graph.start.begin(), graph.start.end() - 1);
  for (auto key : edges) {
    const auto [a, b] = ends(key);
    graph.neighbour[as_size(next[a]++)] = static_cast<idx_t>(b);
    graph.neighbour[as_size(next[b]++)] = static_cast<idx_t>(a);
  }
  return graph;
}

/// Share of the entries of full blocks from which nodes are blocks for the analysis: what
/// it takes for entries that are not there costs less than what it saves.
constexpr double nearly_full = 0.8;

void sort_unique(std::vector<std::uint64_t>& keys) {
  std::sort(keys.begin(), keys.end());
  keys.erase(std::unique(keys.begin(), keys.end()), keys.end());
}

} // namespace

std::vector<std::int64_t> indistinguishable_rows(const std::vector<Mat>& matrices) {
  PetscInt begin = 0, end = 0;
  FG_CALL(MatGetOwnershipRange(matrices.front(), &begin, &end));
  std::vector<std::int64_t> labels;
  std::vector<PetscInt> columns;
  for (PetscInt row = begin; row < end; ++row) {
    columns.assign(1, row); // a row belongs to its own pattern even without a diagonal
    for (Mat matrix : matrices) {
      if (!matrix) continue;
      PetscInt count = 0;
      const PetscInt* list = nullptr;
      FG_CALL(MatGetRow(matrix, row, &count, &list, nullptr));
      columns.insert(columns.end(), list, list + count);
      FG_CALL(MatRestoreRow(matrix, row, &count, &list, nullptr));
    }
    std::sort(columns.begin(), columns.end());
    columns.erase(std::unique(columns.begin(), columns.end()), columns.end());
    std::uint64_t hash = columns.size();
    for (PetscInt column : columns) {
      hash ^= static_cast<std::uint64_t>(column) + std::uint64_t{0x9e3779b97f4a7c15} +
              (hash << 12) + (hash >> 4);
      hash *= std::uint64_t{0xff51afd7ed558ccd};
    }
    labels.push_back(static_cast<std::int64_t>(hash));
  }
  return labels;
}

PivotOrder nested_dissection(MPI_Comm comm, const Pattern& lower,
                             std::span<const std::int64_t> node_of_row) {
  static Event event("NestedDissection");
  const auto timed = event.timed();
  std::vector<std::int64_t> node = gathered(comm, node_of_row);
  const int nodes = renumber(node);

  std::vector<std::uint64_t> edges;
  std::uint64_t last = 0;
  for (std::size_t k = 0; k < lower.row.size(); ++k) {
    auto a = static_cast<std::uint64_t>(node[as_size(lower.row[k] - 1)]);
    auto b = static_cast<std::uint64_t>(node[as_size(lower.column[k] - 1)]);
    if (a == b) continue;
    const std::uint64_t key = std::min(a, b) << 32 | std::max(a, b);
    if (key != last) edges.push_back(last = key);
  }
  sort_unique(edges);

  const int rank = comm_rank(comm), count = static_cast<int>(edges.size());
  std::vector<int> counts(as_size(comm_size(comm))), starts(counts.size() + 1);
  MPI_Gather(&count, 1, MPI_INT, counts.data(), 1, MPI_INT, 0, comm);
  std::partial_sum(counts.begin(), counts.end(), starts.begin() + 1);
  std::vector<std::uint64_t> all(rank == 0 ? as_size(starts.back()) : 0);
  MPI_Gatherv(edges.data(), count, MPI_UINT64_T, all.data(), counts.data(), starts.data(),
              MPI_UINT64_T, 0, comm);

  const std::int64_t entries =
      sum_over(comm, static_cast<std::int64_t>(lower.row.size()));
  PivotOrder result;
  agree(comm, [&] {
    if (rank != 0) return;
    if (comm_size(comm) > 1) sort_unique(all);
    Graph graph = adjacency(nodes, all);
    std::vector<idx_t> weight(as_size(nodes), 0);
    for (auto number : node) ++weight[as_size(number)];
    std::vector<idx_t> order(weight.size()), place(weight.size());
    idx_t vertices = nodes;
    idx_t options[METIS_NOPTIONS];
    METIS_SetDefaultOptions(options);
    options[METIS_OPTION_NUMBERING] = 0;
    if (METIS_NodeND(&vertices, graph.start.data(), graph.neighbour.data(), weight.data(),
                     options, order.data(), place.data()) != METIS_OK)
      throw Error(text("METIS_NodeND failed on a graph of %d nodes", nodes));
    // First position of each node = dofs of all nodes before it.
    std::vector<int> first(weight.size());
    int next = 0;
    for (idx_t step = 0; step < vertices; ++step) {
      const auto number = as_size(order[as_size(step)]);
      result.block_start.push_back(next);
      first[number] = next + 1;
      next += static_cast<int>(weight[number]);
    }
    result.block_start.push_back(next);
    result.position.resize(node.size());
    for (std::size_t row = 0; row < node.size(); ++row)
      result.position[row] = first[as_size(node[row])]++;
    double of_full_blocks = 0;
    for (const idx_t w : weight) of_full_blocks += 0.5 * w * (w + 1);
    for (const std::uint64_t key : all)
      of_full_blocks += static_cast<double>(weight[key >> 32]) * weight[key & 0xffffffff];
    if (static_cast<double>(entries) < nearly_full * of_full_blocks)
      result.block_start.clear();
  });
  return result;
}

} // namespace flexgram
