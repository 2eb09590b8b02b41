#pragma once

#include "base/index.hpp"
#include "base/text.hpp"
#include "io/hdf5_file.hpp"

#include <hdf5.h>
#include <unistd.h>

#include <cstdio>

/// What hdf5_file.cpp, hdf5_read.cpp and hdf5_write.cpp share; nobody else includes it.
namespace flexgram {
namespace detail {

/// Closes an HDF5 identifier at the end of its scope.
class Id {
public:
  Id(hid_t id, herr_t (*close)(hid_t)) : id_(id), close_(close) {}
  Id(Id&& other) noexcept : id_(std::exchange(other.id_, -1)), close_(other.close_) {}
  ~Id() {
    if (id_ >= 0) close_(id_);
  }
  operator hid_t() const { return id_; }
  bool valid() const { return id_ >= 0; }

private:
  hid_t id_;
  herr_t (*close_)(hid_t);
};

/// The innermost description on HDF5's error stack, which names the cause.
inline std::string hdf5_reason() {
  std::string reason;
  H5Ewalk2(
      H5E_DEFAULT, H5E_WALK_UPWARD,
      [](unsigned, const H5E_error2_t* error, void* out) -> herr_t {
        auto& text_out = *static_cast<std::string*>(out);
        if (text_out.empty() && error->desc) text_out = error->desc;
        return 0;
      },
      &reason);
  return reason.empty() ? "HDF5 gave no reason" : reason;
}

template <class T>
hid_t memory_type();
template <>
inline hid_t memory_type<double>() {
  return H5T_NATIVE_DOUBLE;
}
template <>
inline hid_t memory_type<std::int64_t>() {
  return H5T_NATIVE_INT64;
}
template <>
inline hid_t memory_type<std::uint64_t>() {
  return H5T_NATIVE_UINT64;
}

inline Id text_type() {
  Id type(H5Tcopy(H5T_C_S1), H5Tclose);
  H5Tset_size(type, H5T_VARIABLE);
  H5Tset_cset(type, H5T_CSET_UTF8);
  return type;
}

inline std::vector<hsize_t> dims_of(hid_t space) {
  const int rank = H5Sget_simple_extent_ndims(space);
  std::vector<hsize_t> dims(as_size(std::max(rank, 0)));
  H5Sget_simple_extent_dims(space, dims.data(), nullptr);
  return dims;
}

} // namespace detail

struct Hdf5File::State {
  MPI_Comm comm = MPI_COMM_NULL;
  std::string path, target, part; ///< as named; what that means; being written
  hid_t file = -1;
  std::string last_dataset; ///< while it is being written

  [[noreturn]] void fail(const std::string& what) const {
    throw Error(text("file %s: %s", path.c_str(), what.c_str()));
  }
  detail::Id dataset(const std::string& name) const {
    detail::Id id(H5Dopen2(file, name.c_str(), H5P_DEFAULT), H5Dclose);
    if (!id.valid()) fail(text("dataset %s is missing", name.c_str()));
    return id;
  }
  detail::Id object(const std::string& name) const {
    detail::Id id(H5Oopen(file, name.c_str(), H5P_DEFAULT), H5Oclose);
    if (!id.valid()) fail(text("%s is missing", name.c_str()));
    return id;
  }
  detail::Id attribute(hid_t object_id, const std::string& object_name,
                       const std::string& name) const {
    detail::Id id(H5Aopen(object_id, name.c_str(), H5P_DEFAULT), H5Aclose);
    if (!id.valid())
      fail(text("attribute %s of %s is missing", name.c_str(), object_name.c_str()));
    return id;
  }
  detail::Id create_dataset(const std::string& name, hid_t type,
                            const std::vector<hsize_t>& dims) {
    const detail::Id space(dims.empty() ? H5Screate(H5S_SCALAR)
                                        : H5Screate_simple(static_cast<int>(dims.size()),
                                                           dims.data(), nullptr),
                           H5Sclose);
    const detail::Id links(H5Pcreate(H5P_LINK_CREATE), H5Pclose);
    H5Pset_create_intermediate_group(links, 1);
    const detail::Id creation(H5Pcreate(H5P_DATASET_CREATE), H5Pclose);
    H5Pset_fill_time(creation, H5D_FILL_TIME_NEVER);
    detail::Id id(
        H5Dcreate2(file, name.c_str(), type, space, links, creation, H5P_DEFAULT),
        H5Dclose);
    if (!id.valid())
      fail(text("cannot create %s: %s", name.c_str(), detail::hdf5_reason().c_str()));
    return id;
  }
  void set_attribute(const std::string& object_name, const std::string& name, hid_t type,
                     const void* value, std::size_t count, bool scalar) {
    const detail::Id owner = object(object_name);
    const hsize_t dim = count;
    const detail::Id space(
        scalar ? H5Screate(H5S_SCALAR) : H5Screate_simple(1, &dim, nullptr), H5Sclose);
    const detail::Id id(
        H5Acreate2(owner, name.c_str(), type, space, H5P_DEFAULT, H5P_DEFAULT), H5Aclose);
    if (!id.valid() || H5Awrite(id, type, value) < 0)
      fail(text("cannot write attribute %s of %s: %s", name.c_str(), object_name.c_str(),
                detail::hdf5_reason().c_str()));
  }
  /// Runs a rank's part of a write; if it returns false anywhere, all ranks throw.
  template <class Write>
  void write(const std::string& name, Write&& work) {
    last_dataset = name;
    agree(comm, [&] {
      if (!work())
        fail(text("cannot write %s: %s (is the disk full?)", name.c_str(),
                  detail::hdf5_reason().c_str()));
    });
    last_dataset.clear();
  }
  /// Closes without keeping the file. On a full disk HDF5 could not close it, and would
  /// crash on it when MPI ends: so what was written last goes first, and its blocks are
  /// given back.
  void discard() noexcept {
    if (!last_dataset.empty()) {
      H5Ldelete(file, last_dataset.c_str(), H5P_DEFAULT);
      if (comm_rank(comm) == 0 && truncate(part.c_str(), 0) != 0)
        std::perror(part.c_str());
      MPI_Barrier(comm);
    }
    if (file >= 0) H5Fclose(file);
    file = -1;
    if (!part.empty() && comm_rank(comm) == 0) std::remove(part.c_str());
    part.clear();
  }
};

} // namespace flexgram
