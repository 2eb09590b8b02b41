/// Files that appear whole or not at all: where a write goes before it is renamed.

#pragma once

#include <string>

namespace flexgram {

/// What writing to `path` means: symlinks followed.
/// @throws Error if it is a folder, a device or a pipe: only files are replaced.
std::string target_of(const std::string& path);

/// An empty file "target.part-…" that nobody else has; what killed runs left beside it more
/// than a day ago goes.
/// @throws Error if the folder cannot be written to.
std::string create_beside(const std::string& target);

} // namespace flexgram
