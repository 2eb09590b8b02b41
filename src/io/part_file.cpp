#include "io/part_file.hpp"

#include "base/error.hpp"
#include "base/text.hpp"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <chrono>
#include <cstring>
#include <filesystem>

namespace flexgram {
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

} // namespace

std::string target_of(const std::string& path) {
  struct stat found {};
  const std::string target = resolved(path).string();
  if (::stat(target.c_str(), &found) == 0 && !S_ISREG(found.st_mode))
    throw Error(text("cannot write %s: it is %s, not a file", path.c_str(),
                     S_ISDIR(found.st_mode) ? "a folder" : "a device or pipe"));
  return target;
}

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

} // namespace flexgram
