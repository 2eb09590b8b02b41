#include "io/matlab_hdf5.hpp"

#include "base/index.hpp"
#include "base/text.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>

namespace flexgram {
namespace {

long long ll(std::int64_t value) { return static_cast<long long>(value); }

} // namespace

void fail(const Hdf5File& file, const std::string& what) {
  throw Error(text("file %s: %s", file.path().c_str(), what.c_str()));
}

bool by_columns(const Hdf5File& file, const std::string& dataset) {
  return file.has_attribute(dataset, "MATLAB_class");
}

std::int64_t vector_length(const Hdf5File& file, const std::string& dataset) {
  const auto shape = file.shape(dataset);
  std::int64_t length = 1, wide = 0;
  for (auto extent : shape) {
    length *= extent;
    wide += extent != 1;
  }
  if (wide > 1) fail(file, text("dataset %s must be a vector", dataset.c_str()));
  return length;
}

std::int64_t sparse_columns(const Hdf5File& file, const std::string& group) {
  if (!file.exists(group)) fail(file, text("dataset %s is missing", group.c_str()));
  if (!file.is_group(group) || !file.exists(group + "/jc"))
    fail(file, text("%s must be a sparse matrix: a group with data, ir, jc as MATLAB's "
                    "save -v7.3 writes it",
                    group.c_str()));
  return vector_length(file, group + "/jc") - 1;
}

std::int64_t sparse_rows(const Hdf5File& file, const std::string& group,
                         std::int64_t otherwise) {
  if (!file.has_attribute(group, "MATLAB_sparse")) return otherwise;
  const double rows = file.number_attribute(group, "MATLAB_sparse");
  if (!(rows >= 0 && rows < 9e15) || rows != std::floor(rows))
    fail(file, text("%s: MATLAB_sparse = %g is no number of rows", group.c_str(), rows));
  return static_cast<std::int64_t>(rows);
}

SparseColumns read_columns(const Hdf5File& file, const std::string& group,
                           std::int64_t first, std::int64_t count, std::int64_t rows) {
  SparseColumns columns;
  columns.start = read_vector<std::int64_t>(file, group + "/jc", first, count + 1);
  const std::int64_t offset = columns.start.front();
  if (first == 0 && offset != 0)
    fail(file, text("%s/jc starts with %lld, expected 0", group.c_str(), ll(offset)));
  std::int64_t entries = 0;
  if (file.exists(group + "/data")) { // MATLAB leaves data and ir out of an empty matrix
    if (!file.exists(group + "/ir")) fail(file, text("%s/ir is missing", group.c_str()));
    entries = vector_length(file, group + "/data");
    if (vector_length(file, group + "/ir") != entries)
      fail(file, text("%s: ir and data must have the same length", group.c_str()));
  }
  for (std::size_t j = 0; j + 1 < columns.start.size(); ++j)
    if (columns.start[j] > columns.start[j + 1] || columns.start[j] < 0)
      fail(file, text("%s/jc must not decrease (column %lld)", group.c_str(),
                      ll(first + static_cast<std::int64_t>(j))));
  // The last part sees the last column: what is behind it belongs to none.
  const bool ends = first + count == vector_length(file, group + "/jc") - 1;
  if (columns.start.back() > entries || (ends && columns.start.back() < entries))
    fail(file, text("%s/jc points to entry %lld of %lld", group.c_str(),
                    ll(columns.start.back()), ll(entries)));
  for (auto& position : columns.start) position -= offset;
  const std::int64_t here = columns.start.back();
  if (here > 0) {
    columns.row = read_vector<std::int64_t>(file, group + "/ir", offset, here);
    columns.value = read_vector<double>(file, group + "/data", offset, here);
  }
  for (std::size_t j = 0; j + 1 < columns.start.size(); ++j)
    for (std::int64_t k = columns.start[j]; k < columns.start[j + 1]; ++k) {
      const auto i = as_size(k);
      if (columns.row[i] < 0 || columns.row[i] >= rows)
        fail(file, text("%s/ir holds row %lld, the matrix has %lld rows (0-based)",
                        group.c_str(), ll(columns.row[i]), ll(rows)));
      if (!std::isfinite(columns.value[i]))
        fail(file, text("%s(%lld, %lld) = %g: every entry must be finite", group.c_str(),
                        ll(columns.row[i]), ll(first + static_cast<std::int64_t>(j)),
                        columns.value[i]));
    }
  return columns;
}

LocalRows to_rows(const Hdf5File& file, const std::string& group,
                  const SparseColumns& columns) {
  LocalRows local;
  std::vector<std::size_t> order;
  for (std::size_t j = 0; j + 1 < columns.start.size(); ++j) {
    order.resize(as_size(columns.start[j + 1] - columns.start[j]));
    std::iota(order.begin(), order.end(), as_size(columns.start[j]));
    if (!std::is_sorted(order.begin(), order.end(),
                        [&](auto a, auto b) { return columns.row[a] < columns.row[b]; }))
      std::sort(order.begin(), order.end(),
                [&](auto a, auto b) { return columns.row[a] < columns.row[b]; });
    for (std::size_t k = 0; k < order.size(); ++k) {
      if (k > 0 && columns.row[order[k]] == columns.row[order[k - 1]])
        fail(file, text("%s holds entry (%lld, %zu of this part) twice", group.c_str(),
                        ll(columns.row[order[k]]), j));
      local.column.push_back(static_cast<PetscInt>(columns.row[order[k]]));
      local.value.push_back(columns.value[order[k]]);
    }
    local.start.push_back(static_cast<PetscInt>(local.column.size()));
  }
  return local;
}

} // namespace flexgram
