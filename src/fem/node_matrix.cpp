#include "fem/node_matrix.hpp"

#include "base/index.hpp"
#include "linalg/sparse.hpp"

#include <algorithm>
#include <numeric>

namespace flexgram {

NodeMatrix::NodeMatrix(const DofMap& map, const std::vector<std::size_t>& start,
                       const std::vector<std::int64_t>& element_nodes, std::size_t parts)
    : map_(map), nodes_(element_nodes) {
  std::sort(nodes_.begin(), nodes_.end());
  nodes_.erase(std::unique(nodes_.begin(), nodes_.end()), nodes_.end());
  std::vector<int> number(element_nodes.size());
  for (std::size_t k = 0; k < number.size(); ++k)
    number[k] = static_cast<int>(local(element_nodes[k]));

  // Bucket all neighbours by node, then make each bucket unique.
  std::vector<std::size_t> bucket(nodes_.size() + 1, 0);
  for (std::size_t e = 0; e + 1 < start.size(); ++e)
    for (std::size_t k = start[e]; k < start[e + 1]; ++k)
      bucket[as_size(number[k]) + 1] += start[e + 1] - start[e];
  std::partial_sum(bucket.begin(), bucket.end(), bucket.begin());
  std::vector<int> all(bucket.back());
  std::vector<std::size_t> next(bucket.begin(), bucket.end() - 1);
  for (std::size_t e = 0; e + 1 < start.size(); ++e)
    for (std::size_t k = start[e]; k < start[e + 1]; ++k)
      for (std::size_t l = start[e]; l < start[e + 1]; ++l)
        all[next[as_size(number[k])]++] = number[l];

  start_.push_back(0);
  value_start_.push_back(0);
  for (std::size_t a = 0; a < nodes_.size(); ++a) {
    const auto first = all.begin() + static_cast<long>(bucket[a]);
    auto last = all.begin() + static_cast<long>(bucket[a + 1]);
    std::sort(first, last);
    last = std::unique(first, last);
    int columns = 0;
    for (auto b = first; b != last; ++b) {
      neighbour_.push_back(*b);
      column_start_.push_back(columns);
      columns += map_.equations(nodes_[as_size(*b)]);
    }
    start_.push_back(neighbour_.size());
    row_length_.push_back(columns);
    value_start_.push_back(value_start_.back() +
                           as_size(columns) * as_size(map_.equations(nodes_[a])));
  }
  k_.assign(value_start_.back(), 0.0);
  m_.assign(value_start_.back(), 0.0);
  parts_.assign(parts, std::vector<double>(value_start_.back(), 0.0));
}

std::size_t NodeMatrix::local(std::int64_t node) const {
  return as_size(std::lower_bound(nodes_.begin(), nodes_.end(), node) - nodes_.begin());
}

void NodeMatrix::add(const std::int64_t* nodes, std::size_t count, const Dense& K,
                     const Dense& M, const std::vector<ElementPart>& parts) {
  struct Member {
    std::size_t local;
    int first_dof, dofs;
    int place[6]; ///< position of each component among the node's equations, or −1
  };
  std::vector<Member> members(count);
  int dof = 0;
  for (std::size_t a = 0; a < count; ++a) {
    Member& member = members[a];
    member.local = local(nodes[a]);
    member.first_dof = dof;
    member.dofs = map_.dofs[as_size(nodes[a])];
    const PetscInt first = map_.first[as_size(nodes[a])];
    for (int c = 0; c < member.dofs; ++c) {
      const PetscInt equation = map_.equation(nodes[a], c);
      member.place[c] = equation < 0 ? -1 : static_cast<int>(equation - first);
    }
    dof += member.dofs;
  }
  for (const Member& row : members) {
    const auto begin = neighbour_.begin() + static_cast<long>(start_[row.local]);
    const auto end = neighbour_.begin() + static_cast<long>(start_[row.local + 1]);
    for (const Member& column : members) {
      const auto found = std::lower_bound(begin, end, static_cast<int>(column.local));
      const int first_column = column_start_[as_size(found - neighbour_.begin())];
      for (int r = 0; r < row.dofs; ++r) {
        if (row.place[r] < 0) continue;
        const std::size_t offset =
            value_start_[row.local] +
            as_size(row.place[r] * row_length_[row.local] + first_column);
        for (int c = 0; c < column.dofs; ++c) {
          if (column.place[c] < 0) continue;
          const auto slot = offset + as_size(column.place[c]);
          if (!K.data.empty()) k_[slot] += K(row.first_dof + r, column.first_dof + c);
          for (const ElementPart& part : parts)
            parts_[part.number][slot] +=
                part.matrix(row.first_dof + r, column.first_dof + c);
          if (!M.data.empty()) m_[slot] += M(row.first_dof + r, column.first_dof + c);
        }
      }
    }
  }
}

std::vector<Matrix> NodeMatrix::assemble(MPI_Comm comm, Matrix& K, Matrix& M) {
  std::vector<Matrix> parts;
  LocalRows
      local; // columns ascend: nodes and their equations are numbered in the same order
  std::vector<PetscInt> row;
  local.column.reserve(k_.size());
  for (std::size_t a = 0; a < nodes_.size(); ++a)
    for (int r = 0; r < map_.equations(nodes_[a]); ++r) {
      for (std::size_t k = start_[a]; k < start_[a + 1]; ++k) {
        const std::int64_t b = nodes_[as_size(neighbour_[k])];
        for (int c = 0; c < map_.equations(b); ++c)
          local.column.push_back(map_.first[as_size(b)] + c);
      }
      local.start.push_back(static_cast<PetscInt>(local.column.size()));
      row.push_back(map_.first[as_size(nodes_[a])] + r);
    }
  if (comm_size(comm) == 1) { // the rows are whole and in order
    local.value = std::move(k_);
    K = make_sparse(comm, map_.rows, map_.n, local);
    for (auto& part : parts_) {
      local.value = std::move(part);
      parts.push_back(make_sparse(comm, map_.rows, map_.n, nonzeros(local)));
    }
    local.value = std::move(m_);
    M = make_sparse(comm, map_.rows, map_.n, nonzeros(local));
    return parts;
  }
  std::vector<PetscInt> rows;
  rows.reserve(local.column.size());
  for (std::size_t i = 0; i < row.size(); ++i)
    rows.insert(rows.end(), as_size(local.start[i + 1] - local.start[i]), row[i]);
  Matrix
      sum; // holds PETSc's maps of the entries, larger than the matrix: freed at the end
  FG_CALL(MatCreate(comm, sum.out()));
  FG_CALL(MatSetSizes(sum, map_.rows.size(), map_.rows.size(), map_.n, map_.n));
  FG_CALL(MatSetType(sum, MATAIJ));
  FG_CALL(MatSetPreallocationCOO(sum, static_cast<PetscCount>(rows.size()), rows.data(),
                                 local.column.data()));
  rows = local.column = {};
  FG_CALL(MatSetValuesCOO(sum, m_.data(), INSERT_VALUES));
  M = make_sparse(comm, map_.rows, map_.n, nonzeros(local_rows(sum)));
  for (auto& part : parts_) {
    FG_CALL(MatSetValuesCOO(sum, part.data(), INSERT_VALUES));
    parts.push_back(make_sparse(comm, map_.rows, map_.n, nonzeros(local_rows(sum))));
    part = {};
  }
  FG_CALL(MatSetValuesCOO(sum, k_.data(), INSERT_VALUES));
  FG_CALL(MatDuplicate(sum, MAT_COPY_VALUES, K.out()));
  k_ = m_ = {};
  FG_CALL(MatSetOption(K, MAT_SYMMETRIC, PETSC_TRUE));
  return parts;
}

} // namespace flexgram
