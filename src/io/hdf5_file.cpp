#include "base/index.hpp"
#include "io/hdf5_detail.hpp"

#include <fcntl.h>
#include <sys/stat.h>
#include <sys/time.h>
#include <unistd.h>

#include <cerrno>
#include <chrono>
#include <cmath>
#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <filesystem>

namespace flexgram {

using detail::dims_of;
using detail::hdf5_reason;
using detail::Id;
using detail::memory_type;

Hdf5File::Hdf5File(std::unique_ptr<State> state) : state_(std::move(state)) {}
Hdf5File::Hdf5File(Hdf5File&&) noexcept = default;
Hdf5File::~Hdf5File() {
  if (state_) state_->discard();
}

namespace {

/// What a path means: symlinks followed, though the file need not be there.
std::filesystem::path resolved(const std::string& path) {
  namespace fs = std::filesystem;
  fs::path target = path;
  for (int links = 0; links < 40 && fs::is_symlink(target); ++links) {
    const fs::path next = fs::read_symlink(target);
    target = next.is_absolute() ? next : target.parent_path() / next;
  }
  return target;
}

char last_words[1024];
bool speaks = false;

/// The process's memory is damaged: nothing but to say why and to end.
void give_up(int) {
  if (speaks) {
    [[maybe_unused]] const auto written =
        ::write(STDERR_FILENO, last_words, std::strlen(last_words));
  } else {
    ::sleep(20); // or mpirun would end the rank that speaks
  }
  ::_exit(1);
}

/// Runs a read of HDF5 that trusts what a damaged file says (texts of variable length lie
/// in a heap without checksums), may write anywhere and may loop for ever. If it does not
/// come back within ten seconds of work, neither does the program.
template <class Read>
bool guarded(MPI_Comm comm, const std::string& what, Read&& read) {
  speaks = comm_rank(comm) == 0;
  std::snprintf(last_words, sizeof last_words, "flexgram: %s\n", what.c_str());
  struct sigaction guard = {};
  guard.sa_handler = give_up;
  sigemptyset(&guard.sa_mask);
  constexpr int signals[] = {SIGSEGV, SIGBUS, SIGABRT, SIGVTALRM};
  struct sigaction before[std::size(signals)] = {};
  for (std::size_t i = 0; i < std::size(signals); ++i)
    sigaction(signals[i], &guard, &before[i]);
  itimerval limit = {{0, 0}, {10, 0}};
  setitimer(ITIMER_VIRTUAL, &limit, nullptr);
  const bool good = read();
  limit.it_value.tv_sec = 0;
  setitimer(ITIMER_VIRTUAL, &limit, nullptr);
  for (std::size_t i = 0; i < std::size(signals); ++i)
    sigaction(signals[i], &before[i], nullptr);
  return good;
}

/// What killed runs left beside `target` more than a day ago.
void remove_old_parts(const std::filesystem::path& target) {
  namespace fs = std::filesystem;
  const std::string start = target.filename().string() + ".part-";
  const auto old = fs::file_time_type::clock::now() - std::chrono::hours(24);
  std::error_code ignored;
  const fs::path folder = target.has_parent_path() ? target.parent_path() : ".";
  for (const auto& entry : fs::directory_iterator(folder, ignored)) {
    const std::string name = entry.path().filename().string();
    if (name.rfind(start, 0) == 0 &&
        name.find_first_not_of("0123456789-", start.size()) == std::string::npos &&
        entry.last_write_time(ignored) < old)
      fs::remove(entry.path(), ignored);
  }
}

/// An empty file beside `target` that nobody else has.
std::string create_beside(const std::string& target) {
  remove_old_parts(target);
  for (int attempt = 0;; ++attempt) {
    const std::string part = text("%s.part-%d-%d", target.c_str(), getpid(), attempt);
    const int file = ::open(part.c_str(), O_CREAT | O_EXCL | O_WRONLY, 0666);
    if (file >= 0) {
      ::close(file);
      return part;
    }
    if (errno != EEXIST || attempt > 1000)
      throw Error(text("cannot write %s: %s", target.c_str(), std::strerror(errno)));
  }
}

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

std::string hdf5_version() {
  unsigned major = 0, minor = 0, release = 0;
  H5get_libversion(&major, &minor, &release);
  return text("%u.%u.%u", major, minor, release);
}

std::string target_of(const std::string& path) {
  struct stat found {};
  const std::string target = resolved(path).string();
  if (::stat(target.c_str(), &found) == 0 && !S_ISREG(found.st_mode))
    throw Error(text("cannot write %s: it is %s, not a file", path.c_str(),
                     S_ISDIR(found.st_mode) ? "a folder" : "a device or pipe"));
  return target;
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
