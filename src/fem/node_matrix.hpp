#pragma once

#include "base/handle.hpp"
#include "fem/dof_map.hpp"
#include "linalg/dense.hpp"

namespace flexgram {

/// What a further matrix takes of an element, of the size of its K.
struct ElementPart {
  std::size_t number; ///< of the matrix
  Dense matrix;
};

/// K, M and parts of K of this rank's elements on one node-by-node pattern, summed here before
/// anything is sent: each element is added once, rows that belong to other ranks travel
/// at the end through PETSc's COO assembly.
class NodeMatrix {
public:
  /// @param[in] element_nodes  for each element its master nodes (global numbers, no
  ///                           repeats), element e has nodes start[e] … start[e+1] − 1.
  /// @param parts              so many further matrices too.
  NodeMatrix(const DofMap& map, const std::vector<std::size_t>& start,
             const std::vector<std::int64_t>& element_nodes, std::size_t parts);

  /// Adds dense matrices over the dofs of `nodes` (dofs[node] rows a node, in order);
  /// dofs without an equation are dropped. K and M may be empty.
  void add(const std::int64_t* nodes, std::size_t count, const Dense& K, const Dense& M,
           const std::vector<ElementPart>& parts);

  /// Collective on comm; frees this rank's copy. @return the parts.
  std::vector<Matrix> assemble(MPI_Comm comm, Matrix& K, Matrix& M);

private:
  std::size_t local(std::int64_t node) const;

  const DofMap& map_;
  std::vector<std::int64_t> nodes_; ///< masters here, ascending
  std::vector<std::size_t> start_;  ///< neighbours of node a: start_[a] … start_[a+1]
  std::vector<int> neighbour_;      ///< local numbers, ascending
  std::vector<int> column_start_;   ///< first column of the neighbour in a's rows
  std::vector<int> row_length_;     ///< columns in each row of node a
  std::vector<std::size_t> value_start_; ///< first value of node a
  std::vector<double> k_, m_;
  std::vector<std::vector<double>> parts_;
};

} // namespace flexgram
