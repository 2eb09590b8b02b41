#include "base/index.hpp"
#include "io/hdf5_detail.hpp"

namespace flexgram {

using detail::hdf5_reason;
using detail::Id;
using detail::memory_type;
using detail::text_type;

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
                          const std::function<void(RowRange, double*)>& fill) {
  const Id id =
      state_->create_dataset(dataset, H5T_NATIVE_DOUBLE,
                             {static_cast<hsize_t>(n), static_cast<hsize_t>(columns)});
  const auto width = as_size(columns);
  std::vector<double> values;
  state_->write(dataset, [&] {
    for (const RowRange& part : batches_of(rows, columns)) {
      const auto count = as_size(part.size());
      values.resize(count * width);
      fill(part, values.data());
      if (write_slab(id, H5T_NATIVE_DOUBLE, {static_cast<hsize_t>(part.begin), 0},
                     {count, width}, values.data()) < 0)
        return false;
    }
    return true;
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
  std::string text = value; // rank 0's: what HDF5 stores must not differ between ranks
  share_text(state_->comm, text);
  const char* pointer = text.c_str();
  state_->set_attribute(object, name, text_type(), &pointer, 1, true);
}

void Hdf5File::set_attribute(const std::string& object, const std::string& name,
                             const std::vector<std::string>& values) {
  std::string all; // rank 0's
  for (const auto& value : values) all += value + '\0';
  share_text(state_->comm, all);
  std::vector<const char*> pointers;
  for (std::size_t at = 0; at < all.size(); at = all.find('\0', at) + 1)
    pointers.push_back(all.data() + at);
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
