#pragma once

#include "base/parallel.hpp"

#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <vector>

namespace flexgram {

std::string hdf5_version();

/// An HDF5 file opened by all ranks of a communicator. The only place that knows HDF5.
/// Reads are independent: each rank takes its own slab. Every failure throws an Error
/// that names the file and the object; throws may be rank-local, so callers wrap reads in
/// agree().
class Hdf5File {
public:
  /// @throws Error on all ranks if the file is missing, unreadable or no HDF5.
  /// Collective.
  static Hdf5File open(MPI_Comm comm, const std::string& path);

  /// Writes go to a file of this writer's own beside it, "path.part-…"; commit() renames
  /// it, so the file appears whole or not at all. Symlinks are followed.
  static Hdf5File create(MPI_Comm comm, const std::string& path);
  /// Closes and renames; collective. @throws Error if anything did not reach the disk.
  void commit();

  Hdf5File(Hdf5File&&) noexcept;
  ~Hdf5File();

  const std::string& path() const;
  MPI_Comm comm() const;

  // ---- reading
  bool exists(const std::string& object) const;
  bool is_group(const std::string& object) const;
  std::vector<std::string> children(const std::string& group) const;
  std::vector<std::int64_t> shape(const std::string& dataset) const;

  bool has_attribute(const std::string& object, const std::string& name) const;
  std::string text_attribute(const std::string& object, const std::string& name) const;
  std::vector<std::string> texts_attribute(const std::string& object,
                                           const std::string& name) const;
  double number_attribute(const std::string& object, const std::string& name) const;
  std::vector<double> numbers_attribute(const std::string& object,
                                        const std::string& name) const;

  /// A slab: rows first … first + count of dimension `dim`, all of the others; row-major.
  template <class T>
  std::vector<T> read(const std::string& dataset, std::int64_t first, std::int64_t count,
                      int dim = 0) const;
  template <class T>
  std::vector<T> read_all(const std::string& dataset) const;

  // ---- writing, collective; small data are given on every rank and written by rank 0
  void create_group(const std::string& group);
  template <class T>
  void write(const std::string& dataset, const std::vector<std::int64_t>& shape,
             const std::vector<T>& values);
  /// Each rank writes its rows of an n × columns dataset, some megabytes at a time.
  /// @param fill  called with some of its rows and where they go, row-major.
  void write_rows(const std::string& dataset, std::int64_t n, std::int64_t columns,
                  RowRange rows, const std::function<void(RowRange, double*)>& fill);
  /// Each rank writes its part of a one-dimensional dataset.
  template <class T>
  void write_part(const std::string& dataset, std::int64_t n, std::int64_t first,
                  const std::vector<T>& values);
  void set_attribute(const std::string& object, const std::string& name, double value);
  void set_attribute(const std::string& object, const std::string& name,
                     const std::string& value);
  void set_attribute(const std::string& object, const std::string& name,
                     const std::vector<std::string>& values);
  void set_attribute(const std::string& object, const std::string& name,
                     const std::vector<double>& values);
  /// An unsigned 64-bit attribute, as MATLAB_sparse wants it.
  void set_count_attribute(const std::string& object, const std::string& name,
                           std::uint64_t value);

private:
  struct State;
  explicit Hdf5File(std::unique_ptr<State> state);
  std::unique_ptr<State> state_;
};

} // namespace flexgram
