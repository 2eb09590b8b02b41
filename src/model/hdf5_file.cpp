#include "model/hdf5_file.hpp"

#include "base/text.hpp"

#include <hdf5.h>
#include <unistd.h>

#include <cerrno>
#include <cstdio>
#include <cstring>

namespace flexgram {
namespace {

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
std::string hdf5_reason() {
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
hid_t memory_type<double>() {
  return H5T_NATIVE_DOUBLE;
}
template <>
hid_t memory_type<std::int64_t>() {
  return H5T_NATIVE_INT64;
}
template <>
hid_t memory_type<std::uint64_t>() {
  return H5T_NATIVE_UINT64;
}

Id text_type() {
  Id type(H5Tcopy(H5T_C_S1), H5Tclose);
  H5Tset_size(type, H5T_VARIABLE);
  H5Tset_cset(type, H5T_CSET_UTF8);
  return type;
}

std::vector<hsize_t> dims_of(hid_t space) {
  const int rank = H5Sget_simple_extent_ndims(space);
  std::vector<hsize_t> dims(static_cast<std::size_t>(std::max(rank, 0)));
  H5Sget_simple_extent_dims(space, dims.data(), nullptr);
  return dims;
}

} // namespace

struct Hdf5File::State {
  MPI_Comm comm = MPI_COMM_NULL;
  std::string path, part;
  hid_t file = -1;
  std::string last_dataset; ///< while it is being written

  [[noreturn]] void fail(const std::string& what) const {
    throw Error(text("file %s: %s", path.c_str(), what.c_str()));
  }
  Id dataset(const std::string& name) const {
    Id id(H5Dopen2(file, name.c_str(), H5P_DEFAULT), H5Dclose);
    if (!id.valid()) fail(text("dataset %s is missing", name.c_str()));
    return id;
  }
  Id object(const std::string& name) const {
    Id id(H5Oopen(file, name.c_str(), H5P_DEFAULT), H5Oclose);
    if (!id.valid()) fail(text("%s is missing", name.c_str()));
    return id;
  }
  Id attribute(hid_t object_id, const std::string& object_name,
               const std::string& name) const {
    Id id(H5Aopen(object_id, name.c_str(), H5P_DEFAULT), H5Aclose);
    if (!id.valid())
      fail(text("attribute %s of %s is missing", name.c_str(), object_name.c_str()));
    return id;
  }
  Id create_dataset(const std::string& name, hid_t type,
                    const std::vector<hsize_t>& dims) {
    const Id space(dims.empty() ? H5Screate(H5S_SCALAR)
                                : H5Screate_simple(static_cast<int>(dims.size()),
                                                   dims.data(), nullptr),
                   H5Sclose);
    const Id links(H5Pcreate(H5P_LINK_CREATE), H5Pclose);
    H5Pset_create_intermediate_group(links, 1);
    const Id creation(H5Pcreate(H5P_DATASET_CREATE), H5Pclose);
    H5Pset_fill_time(creation, H5D_FILL_TIME_NEVER);
    Id id(H5Dcreate2(file, name.c_str(), type, space, links, creation, H5P_DEFAULT),
          H5Dclose);
    if (!id.valid())
      fail(text("cannot create %s: %s", name.c_str(), hdf5_reason().c_str()));
    return id;
  }
  void set_attribute(const std::string& object_name, const std::string& name, hid_t type,
                     const void* value, std::size_t count, bool scalar) {
    const Id owner = object(object_name);
    const hsize_t dim = count;
    const Id space(scalar ? H5Screate(H5S_SCALAR) : H5Screate_simple(1, &dim, nullptr),
                   H5Sclose);
    const Id id(H5Acreate2(owner, name.c_str(), type, space, H5P_DEFAULT, H5P_DEFAULT),
                H5Aclose);
    if (!id.valid() || H5Awrite(id, type, value) < 0)
      fail(text("cannot write attribute %s of %s: %s", name.c_str(), object_name.c_str(),
                hdf5_reason().c_str()));
  }
  /// Runs a rank's part of a write; if it returns false anywhere, all ranks throw.
  template <class Write>
  void write(const std::string& name, Write&& work) {
    last_dataset = name;
    agree(comm, [&] {
      if (!work())
        fail(text("cannot write %s: %s (is the disk full?)", name.c_str(),
                  hdf5_reason().c_str()));
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

Hdf5File::Hdf5File(std::unique_ptr<State> state) : state_(std::move(state)) {}
Hdf5File::Hdf5File(Hdf5File&&) noexcept = default;
Hdf5File::~Hdf5File() {
  if (state_) state_->discard();
}

Hdf5File Hdf5File::open(MPI_Comm comm, const std::string& path) {
  H5Eset_auto2(H5E_DEFAULT, nullptr, nullptr); // errors come as exceptions
  auto state = std::make_unique<State>();
  state->comm = comm;
  state->path = path;
  agree(comm, [&] {
    if (std::FILE* probe = std::fopen(path.c_str(), "rb"))
      std::fclose(probe);
    else
      throw Error(text("cannot read %s: %s", path.c_str(), std::strerror(errno)));
    if (H5Fis_hdf5(path.c_str()) <= 0)
      throw Error(text("%s is not an HDF5 file (a body file is HDF5: python3 -m flexgram "
                       "import makes one, and so does MATLAB's save -v7.3)",
                       path.c_str()));
  });
  const Id access(H5Pcreate(H5P_FILE_ACCESS), H5Pclose);
  H5Pset_fapl_mpio(access, comm, MPI_INFO_NULL);
  state->file = H5Fopen(path.c_str(), H5F_ACC_RDONLY, access);
  agree(comm, [&] {
    if (state->file < 0)
      throw Error(text("cannot open %s: %s", path.c_str(), hdf5_reason().c_str()));
  });
  return Hdf5File(std::move(state));
}

Hdf5File Hdf5File::create(MPI_Comm comm, const std::string& path) {
  H5Eset_auto2(H5E_DEFAULT, nullptr, nullptr); // errors come as exceptions
  auto state = std::make_unique<State>();
  state->comm = comm;
  state->path = path;
  const std::string part = path + ".part";
  agree(comm, [&] { // MPI-IO's own message for a missing folder is not helpful
    if (comm_rank(comm) != 0) return;
    if (std::FILE* probe = std::fopen(part.c_str(), "wb"))
      std::fclose(probe);
    else
      throw Error(text("cannot write %s: %s", path.c_str(), std::strerror(errno)));
  });
  state->part = part;
  const Id access(H5Pcreate(H5P_FILE_ACCESS), H5Pclose);
  H5Pset_fapl_mpio(access, comm, MPI_INFO_NULL);
  H5Pset_libver_bounds(access, H5F_LIBVER_V18, H5F_LIBVER_V110);
  state->file = H5Fcreate(part.c_str(), H5F_ACC_TRUNC, H5P_DEFAULT, access);
  Hdf5File file(std::move(state));
  agree(comm, [&] {
    if (file.state_->file < 0)
      throw Error(text("cannot create %s: %s", path.c_str(), hdf5_reason().c_str()));
  });
  return file;
}

void Hdf5File::commit() {
  State& s = *state_;
  const bool flushed = H5Fflush(s.file, H5F_SCOPE_GLOBAL) >= 0;
  const bool closed = H5Fclose(s.file) >= 0;
  s.file = -1;
  try {
    agree(s.comm, [&] {
      if (!flushed || !closed)
        throw Error(text("cannot write %s: %s (is the disk full?)", s.path.c_str(),
                         hdf5_reason().c_str()));
    });
    agree(s.comm, [&] {
      if (comm_rank(s.comm) == 0 && std::rename(s.part.c_str(), s.path.c_str()) != 0)
        throw Error(text("cannot write %s: %s", s.path.c_str(), std::strerror(errno)));
    });
  } catch (...) {
    s.discard();
    throw;
  }
  s.part.clear();
}

const std::string& Hdf5File::path() const { return state_->path; }
MPI_Comm Hdf5File::comm() const { return state_->comm; }

bool Hdf5File::exists(const std::string& object) const {
  if (object == "/") return true;
  // H5Lexists wants every parent to exist.
  for (std::size_t slash = object.find('/', 1); slash != std::string::npos;
       slash = object.find('/', slash + 1))
    if (H5Lexists(state_->file, object.substr(0, slash).c_str(), H5P_DEFAULT) <= 0)
      return false;
  return H5Lexists(state_->file, object.c_str(), H5P_DEFAULT) > 0;
}

bool Hdf5File::is_group(const std::string& object) const {
  return H5Iget_type(state_->object(object)) == H5I_GROUP;
}

std::vector<std::string> Hdf5File::children(const std::string& group) const {
  std::vector<std::string> names;
  const Id id = state_->object(group);
  hsize_t index = 0;
  H5Literate(
      id, H5_INDEX_NAME, H5_ITER_INC, &index,
      [](hid_t, const char* name, const H5L_info_t*, void* out) -> herr_t {
        static_cast<std::vector<std::string>*>(out)->emplace_back(name);
        return 0;
      },
      &names);
  return names;
}

std::vector<std::int64_t> Hdf5File::shape(const std::string& dataset) const {
  const Id id = state_->dataset(dataset);
  const auto dims = dims_of(Id(H5Dget_space(id), H5Sclose));
  return {dims.begin(), dims.end()};
}

bool Hdf5File::has_attribute(const std::string& object, const std::string& name) const {
  return H5Aexists(state_->object(object), name.c_str()) > 0;
}

std::vector<std::string> Hdf5File::texts_attribute(const std::string& object,
                                                   const std::string& name) const {
  const Id owner = state_->object(object);
  const Id id = state_->attribute(owner, object, name);
  const Id type(H5Aget_type(id), H5Tclose), space(H5Aget_space(id), H5Sclose);
  const auto count = static_cast<std::size_t>(H5Sget_simple_extent_npoints(space));
  std::vector<std::string> result;
  if (H5Tget_class(type) != H5T_STRING)
    state_->fail(text("attribute %s of %s must be text", name.c_str(), object.c_str()));
  if (H5Tis_variable_str(type) > 0) {
    std::vector<char*> values(count, nullptr);
    const Id memory(H5Tcopy(H5T_C_S1), H5Tclose);
    H5Tset_size(memory, H5T_VARIABLE);
    H5Tset_cset(memory, H5Tget_cset(type));
    if (H5Aread(id, memory, values.data()) < 0)
      state_->fail(text("cannot read attribute %s of %s: %s", name.c_str(),
                        object.c_str(), hdf5_reason().c_str()));
    for (char* value : values) result.emplace_back(value ? value : "");
    H5Dvlen_reclaim(memory, space, H5P_DEFAULT, values.data());
  } else {
    const std::size_t size = H5Tget_size(type);
    std::vector<char> values(size * count);
    if (H5Aread(id, type, values.data()) < 0)
      state_->fail(text("cannot read attribute %s of %s", name.c_str(), object.c_str()));
    for (std::size_t i = 0; i < count; ++i)
      result.emplace_back(values.data() + i * size,
                          strnlen(values.data() + i * size, size));
  }
  return result;
}

std::string Hdf5File::text_attribute(const std::string& object,
                                     const std::string& name) const {
  const auto values = texts_attribute(object, name);
  return values.empty() ? "" : values.front();
}

std::vector<double> Hdf5File::numbers_attribute(const std::string& object,
                                                const std::string& name) const {
  const Id owner = state_->object(object);
  const Id id = state_->attribute(owner, object, name);
  const Id space(H5Aget_space(id), H5Sclose);
  std::vector<double> values(
      static_cast<std::size_t>(H5Sget_simple_extent_npoints(space)));
  if (H5Aread(id, H5T_NATIVE_DOUBLE, values.data()) < 0)
    state_->fail(
        text("attribute %s of %s must be a number", name.c_str(), object.c_str()));
  return values;
}

double Hdf5File::number_attribute(const std::string& object,
                                  const std::string& name) const {
  const auto values = numbers_attribute(object, name);
  if (values.size() != 1)
    state_->fail(text("attribute %s of %s must be one number, it has %zu", name.c_str(),
                      object.c_str(), values.size()));
  return values.front();
}

template <class T>
std::vector<T> Hdf5File::read(const std::string& dataset, std::int64_t first,
                              std::int64_t count, int dim) const {
  const Id id = state_->dataset(dataset);
  const Id space(H5Dget_space(id), H5Sclose), type(H5Dget_type(id), H5Tclose);
  const H5T_class_t kind = H5Tget_class(type);
  if (kind != H5T_INTEGER && kind != H5T_FLOAT)
    state_->fail(text("dataset %s must hold numbers", dataset.c_str()));
  auto dims = dims_of(space);
  std::vector<hsize_t> start(dims.size(), 0);
  if (!dims.empty()) {
    start[static_cast<std::size_t>(dim)] = static_cast<hsize_t>(first);
    dims[static_cast<std::size_t>(dim)] = static_cast<hsize_t>(count);
  }
  std::size_t total = 1;
  for (auto length : dims) total *= length;
  std::vector<T> values(total);
  if (total == 0) return values;
  Id memory(H5Screate_simple(std::max<int>(static_cast<int>(dims.size()), 1),
                             dims.empty() ? std::vector<hsize_t>{1}.data() : dims.data(),
                             nullptr),
            H5Sclose);
  if (!dims.empty())
    H5Sselect_hyperslab(space, H5S_SELECT_SET, start.data(), nullptr, dims.data(),
                        nullptr);
  if (H5Dread(id, memory_type<T>(), memory, space, H5P_DEFAULT, values.data()) < 0)
    state_->fail(text("cannot read %s: %s", dataset.c_str(), hdf5_reason().c_str()));
  return values;
}

template <class T>
std::vector<T> Hdf5File::read_all(const std::string& dataset) const {
  const auto dims = shape(dataset);
  return read<T>(dataset, 0, dims.empty() ? 1 : dims.front());
}

void Hdf5File::create_group(const std::string& group) {
  if (exists(group)) return;
  const Id links(H5Pcreate(H5P_LINK_CREATE), H5Pclose);
  H5Pset_create_intermediate_group(links, 1);
  const Id id(H5Gcreate2(state_->file, group.c_str(), links, H5P_DEFAULT, H5P_DEFAULT),
              H5Gclose);
  if (!id.valid())
    state_->fail(text("cannot create %s: %s", group.c_str(), hdf5_reason().c_str()));
}

template <class T>
void Hdf5File::write(const std::string& dataset, const std::vector<std::int64_t>& shape,
                     const std::vector<T>& values) {
  const Id id = state_->create_dataset(dataset, memory_type<T>(),
                                       std::vector<hsize_t>(shape.begin(), shape.end()));
  state_->write(dataset, [&] {
    return comm_rank(state_->comm) != 0 || values.empty() ||
           H5Dwrite(id, memory_type<T>(), H5S_ALL, H5S_ALL, H5P_DEFAULT, values.data()) >=
               0;
  });
}

namespace {

herr_t write_slab(hid_t id, hid_t type, const std::vector<hsize_t>& start,
                  const std::vector<hsize_t>& count, const void* values) {
  const Id space(H5Dget_space(id), H5Sclose);
  const Id memory(H5Screate_simple(static_cast<int>(count.size()), count.data(), nullptr),
                  H5Sclose);
  if (count.front() > 0)
    H5Sselect_hyperslab(space, H5S_SELECT_SET, start.data(), nullptr, count.data(),
                        nullptr);
  else {
    H5Sselect_none(space);
    H5Sselect_none(memory);
  }
  return H5Dwrite(id, type, memory, space, H5P_DEFAULT, values);
}

} // namespace

void Hdf5File::write_rows(const std::string& dataset, std::int64_t n,
                          std::int64_t columns, RowRange rows,
                          const std::vector<double>& row_major) {
  const Id id =
      state_->create_dataset(dataset, H5T_NATIVE_DOUBLE,
                             {static_cast<hsize_t>(n), static_cast<hsize_t>(columns)});
  state_->write(dataset, [&] {
    return write_slab(id, H5T_NATIVE_DOUBLE, {static_cast<hsize_t>(rows.begin), 0},
                      {static_cast<hsize_t>(rows.size()), static_cast<hsize_t>(columns)},
                      row_major.data()) >= 0;
  });
}

template <class T>
void Hdf5File::write_part(const std::string& dataset, std::int64_t n, std::int64_t first,
                          const std::vector<T>& values) {
  const Id id =
      state_->create_dataset(dataset, memory_type<T>(), {static_cast<hsize_t>(n)});
  state_->write(dataset, [&] {
    return write_slab(id, memory_type<T>(), {static_cast<hsize_t>(first)},
                      {values.size()}, values.data()) >= 0;
  });
}

void Hdf5File::set_attribute(const std::string& object, const std::string& name,
                             double value) {
  state_->set_attribute(object, name, H5T_NATIVE_DOUBLE, &value, 1, true);
}

void Hdf5File::set_attribute(const std::string& object, const std::string& name,
                             const std::string& value) {
  const char* pointer = value.c_str();
  state_->set_attribute(object, name, text_type(), &pointer, 1, true);
}

void Hdf5File::set_attribute(const std::string& object, const std::string& name,
                             const std::vector<std::string>& values) {
  std::vector<const char*> pointers;
  for (const auto& value : values) pointers.push_back(value.c_str());
  state_->set_attribute(object, name, text_type(), pointers.data(), pointers.size(),
                        false);
}

void Hdf5File::set_attribute(const std::string& object, const std::string& name,
                             const std::vector<double>& values) {
  state_->set_attribute(object, name, H5T_NATIVE_DOUBLE, values.data(), values.size(),
                        false);
}

void Hdf5File::set_count_attribute(const std::string& object, const std::string& name,
                                   std::uint64_t value) {
  state_->set_attribute(object, name, H5T_NATIVE_UINT64, &value, 1, true);
}

template std::vector<double> Hdf5File::read(const std::string&, std::int64_t,
                                            std::int64_t, int) const;
template std::vector<std::int64_t> Hdf5File::read(const std::string&, std::int64_t,
                                                  std::int64_t, int) const;
template std::vector<double> Hdf5File::read_all(const std::string&) const;
template std::vector<std::int64_t> Hdf5File::read_all(const std::string&) const;
template void Hdf5File::write(const std::string&, const std::vector<std::int64_t>&,
                              const std::vector<double>&);
template void Hdf5File::write(const std::string&, const std::vector<std::int64_t>&,
                              const std::vector<std::uint64_t>&);
template void Hdf5File::write_part(const std::string&, std::int64_t, std::int64_t,
                                   const std::vector<double>&);
template void Hdf5File::write_part(const std::string&, std::int64_t, std::int64_t,
                                   const std::vector<std::uint64_t>&);
template void Hdf5File::write_part(const std::string&, std::int64_t, std::int64_t,
                                   const std::vector<std::int64_t>&);

} // namespace flexgram
