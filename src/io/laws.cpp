#include "io/laws.hpp"

#include "base/text.hpp"

namespace flexgram {

Law read_law(const Hdf5File& file, const std::string& object, const std::string& name) {
  try {
    const std::string kind = file.text_attribute(object, "law");
    LawNumbers numbers;
    for (const std::string& number : numbers_of_law(kind))
      numbers[number] = file.numbers_attribute(object, number);
    Law law(name, kind, numbers);
    if (!law.is_named())
      throw Error(
          text("law %s: such terms are /D, /S and /G (of a material: loss_factor)",
               kind.c_str()));
    return law;
  } catch (Error& error) {
    error.add_context(text("file %s: %s", file.path().c_str(), object.c_str()));
    throw;
  }
}

std::vector<Law> read_laws(const Hdf5File& file) {
  std::vector<Law> laws;
  agree(file.comm(), [&] {
    for (const Law& law : {Law(Law::Kind::viscous), Law(Law::Kind::structural),
                           Law(Law::Kind::gyroscopic)})
      if (file.exists(law.path())) laws.push_back(law);
    if (!file.exists("/terms")) return;
    for (const std::string& name : file.children("/terms"))
      laws.push_back(read_law(file, "/terms/" + name, name));
  });
  return laws;
}

void write_law(Hdf5File& file, const Law& law) {
  if (!law.is_named()) return;
  file.set_attribute(law.path(), "law", law.kind_name());
  for (const auto& [name, values] : law.kind().numbers())
    file.set_attribute(law.path(), name, values);
}

} // namespace flexgram
