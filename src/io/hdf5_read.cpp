#include "base/index.hpp"
#include "io/guarded_read.hpp"
#include "io/hdf5_detail.hpp"

#include <cmath>
#include <cstring>

namespace flexgram {

using detail::dims_of;
using detail::hdf5_reason;
using detail::Id;
using detail::memory_type;

namespace {

/// Everything that is declared is stored: else a few bytes could ask for all memory, or
/// zeros stand where a killed writer left nothing.
bool is_stored(hid_t dataset, hid_t type, hsize_t count) {
  const Id creation(H5Dget_create_plist(dataset), H5Pclose);
  const Id space(H5Dget_space(dataset), H5Sclose);
  const H5D_layout_t layout = H5Pget_layout(creation);
  if (layout == H5D_VIRTUAL || H5Pget_external_count(creation) > 0) return false;
  if (layout != H5D_CHUNKED)
    return H5Dget_storage_size(dataset) / H5Tget_size(type) >= count;
  const auto dims = dims_of(space);
  std::vector<hsize_t> chunk(dims.size());
  if (dims.empty() ||
      H5Pget_chunk(creation, static_cast<int>(chunk.size()), chunk.data()) < 0)
    return false;
  hsize_t needed = 1, there = 0;
  for (std::size_t i = 0; i < dims.size(); ++i)
    needed *= (dims[i] + chunk[i] - 1) / chunk[i];
  return H5Dget_num_chunks(dataset, space, &there) >= 0 && there >= needed;
}

} // namespace

bool Hdf5File::has_attribute(const std::string& object, const std::string& name) const {
  const Id owner = state_->object(object);
  const std::string damaged =
      text("the attributes of %s cannot be read: they are damaged", object.c_str());
  htri_t there = -1;
  guarded(comm(), "file " + path() + ": " + damaged, [&] {
    there = H5Aexists(owner, name.c_str());
    return there >= 0;
  });
  if (there < 0) state_->fail(damaged);
  return there > 0;
}

std::vector<std::string> Hdf5File::texts_attribute(const std::string& object,
                                                   const std::string& name) const {
  const Id owner = state_->object(object);
  const Id id = state_->attribute(owner, object, name);
  const Id type(H5Aget_type(id), H5Tclose), space(H5Aget_space(id), H5Sclose);
  const auto count = as_size(H5Sget_simple_extent_npoints(space));
  std::vector<std::string> result;
  if (H5Tget_class(type) != H5T_STRING)
    state_->fail(text("attribute %s of %s must be text", name.c_str(), object.c_str()));
  if (H5Tis_variable_str(type) > 0) {
    std::vector<char*> values(count, nullptr);
    const Id memory(H5Tcopy(H5T_C_S1), H5Tclose);
    H5Tset_size(memory, H5T_VARIABLE);
    H5Tset_cset(memory, H5Tget_cset(type));
    const std::string damaged = text("cannot read attribute %s of %s: it is damaged",
                                     name.c_str(), object.c_str());
    if (!guarded(comm(), "file " + path() + ": " + damaged, [&] {
          if (H5Aread(id, memory, values.data()) < 0) return false;
          for (char* value : values) result.emplace_back(value ? value : "");
          return H5Dvlen_reclaim(memory, space, H5P_DEFAULT, values.data()) >= 0;
        }))
      state_->fail(damaged);
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
  std::vector<double> values(as_size(H5Sget_simple_extent_npoints(space)));
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
  hsize_t declared = 1;
  for (auto length : dims) declared *= length;
  if (!is_stored(id, type, declared))
    state_->fail(text("dataset %s declares %llu numbers, which are not all in this file",
                      dataset.c_str(), static_cast<unsigned long long>(declared)));
  std::vector<hsize_t> start(dims.size(), 0);
  if (!dims.empty()) {
    start[as_size(dim)] = static_cast<hsize_t>(first);
    dims[as_size(dim)] = static_cast<hsize_t>(count);
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
  const auto read_as = [&](hid_t memory_kind, void* into) {
    if (H5Dread(id, memory_kind, memory, space, H5P_DEFAULT, into) < 0)
      state_->fail(text("cannot read %s: %s", dataset.c_str(), hdf5_reason().c_str()));
  };
  if (std::is_same_v<T, double> || kind == H5T_INTEGER) {
    read_as(memory_type<T>(), values.data());
    return values;
  }
  std::vector<double> numbers(total); // HDF5 would cut the fractions off
  read_as(H5T_NATIVE_DOUBLE, numbers.data());
  for (std::size_t i = 0; i < total; ++i) {
    if (!(std::abs(numbers[i]) < 9e15) || numbers[i] != std::floor(numbers[i]))
      state_->fail(text("dataset %s holds %.17g, expected whole numbers", dataset.c_str(),
                        numbers[i]));
    values[i] = static_cast<T>(numbers[i]);
  }
  return values;
}

template <class T>
std::vector<T> Hdf5File::read_all(const std::string& dataset) const {
  const auto dims = shape(dataset);
  return read<T>(dataset, 0, dims.empty() ? 1 : dims.front());
}

template std::vector<double> Hdf5File::read(const std::string&, std::int64_t,
                                            std::int64_t, int) const;
template std::vector<std::int64_t> Hdf5File::read(const std::string&, std::int64_t,
                                                  std::int64_t, int) const;
template std::vector<double> Hdf5File::read_all(const std::string&) const;
template std::vector<std::int64_t> Hdf5File::read_all(const std::string&) const;

} // namespace flexgram
