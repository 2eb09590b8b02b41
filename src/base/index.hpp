/// Indices: PETSc, LAPACK and MUMPS count with signs, containers without.

#pragma once

#include <concepts>
#include <cstddef>
#include <type_traits>

namespace flexgram {

/// A count or an index that is not negative, or an enumerator that numbers a table's entry,
/// for a container.
template <class T>
requires std::integral<T> || std::is_enum_v<T>
constexpr std::size_t as_size(T count) { return static_cast<std::size_t>(count); }

} // namespace flexgram
