/// The laws of terms in body files and reduced files: D and S by their names, others as attributes
/// of /terms/NAME, which holds the matrix: `law` (prony, table, parameter*prony) and its numbers.

#pragma once

#include "io/hdf5_file.hpp"
#include "model/law.hpp"

namespace flexgram {

/// Of all terms of the file. Collective. @throws Error naming the term.
std::vector<Law> read_laws(const Hdf5File& file);

/// The law that an object's attributes give. Rank-local. @throws Error naming the object.
Law read_law(const Hdf5File& file, const std::string& object, const std::string& name);

/// The attributes of a law with a name; nothing of D and S. Collective.
/// @pre the term's matrix is written.
void write_law(Hdf5File& file, const Law& law);

} // namespace flexgram
