#include "io/hdf5_detail.hpp"
#include "io/part_file.hpp"

#include <sys/stat.h>

#include <cerrno>
#include <cstdio>
#include <cstring>

namespace flexgram {

using detail::dims_of;
using detail::hdf5_reason;
using detail::Id;

Hdf5File::Hdf5File(std::unique_ptr<State> state) : state_(std::move(state)) {}
Hdf5File::Hdf5File(Hdf5File&&) noexcept = default;
Hdf5File::~Hdf5File() {
  if (state_) state_->discard();
}

std::string hdf5_version() {
  unsigned major = 0, minor = 0, release = 0;
  H5get_libversion(&major, &minor, &release);
  return text("%u.%u.%u", major, minor, release);
}

Hdf5File Hdf5File::open(MPI_Comm comm, const std::string& path) {
  H5Eset_auto2(H5E_DEFAULT, nullptr, nullptr); // errors come as exceptions
  auto state = std::make_unique<State>();
  state->comm = comm;
  state->path = path;
  agree(comm, [&] {
    struct stat found {};
    if (::stat(path.c_str(), &found) == 0 && !S_ISREG(found.st_mode)) // a pipe would wait
      throw Error(text("cannot read %s: it is %s, not a file", path.c_str(),
                       S_ISDIR(found.st_mode) ? "a folder" : "a device or pipe"));
    if (std::FILE* probe = std::fopen(path.c_str(), "rb"))
      std::fclose(probe);
    else
      throw Error(text("cannot read %s: %s", path.c_str(), std::strerror(errno)));
    if (H5Fis_hdf5(path.c_str()) <= 0)
      throw Error(text("%s is not an HDF5 file (a body file is HDF5: flexgram "
                       "import makes one, and so does MATLAB's save -v7.3)",
                       path.c_str()));
  });
  const Id access(H5Pcreate(H5P_FILE_ACCESS), H5Pclose);
  if (comm_size(comm) > 1)
    H5Pset_fapl_mpio(access, comm, MPI_INFO_NULL);
  else // one rank reads by itself; locks are not known everywhere, nor to MPI-IO
    H5Pset_file_locking(access, false, true);
  state->file = H5Fopen(path.c_str(), H5F_ACC_RDONLY, access);
  agree(comm, [&] {
    if (state->file < 0)
      throw Error(text("cannot open %s: it is damaged or not complete (HDF5: %s)",
                       path.c_str(), hdf5_reason().c_str()));
  });
  return Hdf5File(std::move(state));
}

Hdf5File Hdf5File::create(MPI_Comm comm, const std::string& path) {
  H5Eset_auto2(H5E_DEFAULT, nullptr, nullptr); // errors come as exceptions
  auto state = std::make_unique<State>();
  state->comm = comm;
  state->path = path;
  std::string part;
  agree(comm, [&] { // MPI-IO's own message for a missing folder is not helpful
    if (comm_rank(comm) != 0) return;
    state->target = target_of(path);
    part = create_beside(state->target);
  });
  share_text(comm, part);
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
      if (comm_rank(s.comm) == 0 && std::rename(s.part.c_str(), s.target.c_str()) != 0)
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
  for (std::size_t slash = object.find('/', 1);; slash = object.find('/', slash + 1)) {
    const std::string part = object.substr(0, slash);
    const htri_t there = H5Lexists(state_->file, part.c_str(), H5P_DEFAULT);
    if (there < 0) state_->fail(text("%s cannot be read: it is damaged", part.c_str()));
    if (there == 0) return false;
    H5L_info_t link;
    if (H5Lget_info(state_->file, part.c_str(), &link, H5P_DEFAULT) < 0 ||
        link.type == H5L_TYPE_EXTERNAL)
      state_->fail(text("%s is a link to another file", part.c_str()));
    if (slash == std::string::npos) return true;
    // A dataset, or a link to nothing, holds no more.
    if (H5Oexists_by_name(state_->file, part.c_str(), H5P_DEFAULT) <= 0 ||
        !is_group(part))
      return false;
  }
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

} // namespace flexgram
