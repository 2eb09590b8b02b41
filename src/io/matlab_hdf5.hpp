/// Matrices in HDF5 as MATLAB's save -v7.3 lays them out: dense ones by columns (which HDF5
/// shows transposed), sparse ones as a group of data, ir and jc. Called by body_reader.

#pragma once

#include "io/hdf5_file.hpp"
#include "linalg/sparse.hpp"

namespace flexgram {

/// @throws Error naming the file.
[[noreturn]] void fail(const Hdf5File& file, const std::string& what);

/// Whether MATLAB wrote the dataset, whose extents are reversed then.
bool by_columns(const Hdf5File& file, const std::string& dataset);

/// A vector may be stored as n, n×1 or 1×n (MATLAB).
std::int64_t vector_length(const Hdf5File& file, const std::string& dataset);

template <class T>
std::vector<T> read_vector(const Hdf5File& file, const std::string& dataset,
                           std::int64_t first, std::int64_t count) {
  const auto shape = file.shape(dataset);
  const int dim = shape.size() == 2 && shape[0] == 1 ? 1 : 0;
  return file.read<T>(dataset, first, count, dim);
}

/// Columns of the sparse matrix in `group`, from jc.
std::int64_t sparse_columns(const Hdf5File& file, const std::string& group);
/// Its rows, from the attribute MATLAB_sparse, or what they are otherwise.
std::int64_t sparse_rows(const Hdf5File& file, const std::string& group,
                         std::int64_t otherwise);

/// Columns first … first + count of a sparse matrix by columns; every index is in the
/// matrix, every entry finite.
struct SparseColumns {
  std::vector<std::int64_t> start, row;
  std::vector<double> value;
};
SparseColumns read_columns(const Hdf5File& file, const std::string& group,
                           std::int64_t first, std::int64_t count, std::int64_t rows);

/// Rows of a symmetric matrix are its columns; entries come sorted, duplicates are an
/// error.
LocalRows to_rows(const Hdf5File& file, const std::string& group,
                  const SparseColumns& columns);

} // namespace flexgram
