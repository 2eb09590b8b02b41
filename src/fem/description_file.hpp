/// Attributes and groups of a description's file. Used by the readers of its parts.

#pragma once

#include "base/error.hpp"
#include "base/text.hpp"
#include "fem/description.hpp"
#include "io/hdf5_file.hpp"

#include <algorithm>
#include <array>

namespace flexgram {

/// N numbers of an attribute. @throws Error if it has others.
template <class T, std::size_t N>
std::array<T, N> fixed(const Hdf5File& file, const std::string& object,
                       const std::string& name) {
  const auto values = file.numbers_attribute(object, name);
  if (values.size() != N)
    throw Error(text("file %s: attribute %s of %s must have %zu numbers, it has %zu",
                     file.path().c_str(), name.c_str(), object.c_str(), N,
                     values.size()));
  std::array<T, N> result{};
  std::copy(values.begin(), values.end(), result.begin());
  return result;
}

/// Children of a group in the order of their attribute `order`, if they have one.
std::vector<std::string> ordered_children(const Hdf5File& file, const std::string& group);

/// The nodes of a group, from 0. @throws Error if there are none, or one that the mesh has not.
std::vector<std::int64_t> read_nodes(const Hdf5File& file, const std::string& object,
                                     std::int64_t points);

/// /loads, /preload and /spin. @pre materials are known.
void read_loads(const Hdf5File& file, BodyDescription& body);
/// /outputs.
void read_outputs(const Hdf5File& file, BodyDescription& body);

/// Of /materials and /sections. @throws Error naming file, object and number.
Material read_material(const Hdf5File& file, const std::string& name,
                       std::vector<std::string>& warnings);
/// Laws of a material or a spring: its groups whole, shear and bulk. @param name  of it.
std::vector<MaterialTerm> read_terms(const Hdf5File& file, const std::string& object,
                                     const std::string& name);
BeamSection read_section(const Hdf5File& file, const std::string& name);
ShellSection read_shell(const Hdf5File& file, const std::string& name);

} // namespace flexgram
