/// Materials and sections of a description's file.

#include "fem/description_file.hpp"
#include "fem/shell.hpp"
#include "io/laws.hpp"

#include <algorithm>
#include <cmath>

namespace flexgram {
namespace {

/// The speed of a bar wave tells inconsistent units: E in MPa with m and kg gives 5 m/s.
/// Stiff dummies and soft foams exist, so it is a warning.
void check_units(const std::string& name, double E, double density,
                 std::vector<std::string>& warnings) {
  if (density == 0) return;
  const double speed = std::sqrt(E / density);
  if (speed < 20 || speed > 50000)
    warnings.push_back(text(
        "material %s: the speed of sound sqrt(E/rho) = %.3g m/s is unlike any material; "
        "do E = %g Pa and rho = %g kg/m³ belong together? The import converts from the "
        "mesh's units (--units, `units:` in YAML)",
        name.c_str(), speed, E, density));
}

/// Strain of a warming by 1 K in the material's axes; nothing: not known.
std::optional<std::array<double, 6>> read_expansion(const Hdf5File& file,
                                                    const std::string& object) {
  if (!file.has_attribute(object, "expansion")) return std::nullopt;
  auto along = file.numbers_attribute(object, "expansion");
  if (along.size() == 1) along.resize(3, along.front());
  if (along.size() != 3)
    throw Error(text("file %s: attribute expansion of %s must have 1 or 3 numbers, it "
                     "has %zu",
                     file.path().c_str(), object.c_str(), along.size()));
  return std::array<double, 6>{along[0], along[1], along[2], 0, 0, 0};
}

} // namespace

std::vector<MaterialTerm> read_terms(const Hdf5File& file, const std::string& object,
                                     const std::string& material) {
  using Part = MaterialTerm::Part;
  std::vector<MaterialTerm> terms;
  for (const auto& [name, part] : {std::pair("whole", Part::whole),
                                   {"shear", Part::shear},
                                   {"bulk", Part::bulk},
                                   {"parameter", Part::whole},
                                   {"loss_factor", Part::whole},
                                   {"damper", Part::damper}}) {
    const std::string group = object + "/" + name;
    if (!file.exists(group)) continue;
    const std::string of =
        std::string(name) == "whole" ? material : material + "." + name;
    terms.push_back({part, read_law(file, group,
                                    file.has_attribute(group, "name")
                                        ? file.text_attribute(group, "name")
                                        : of)});
  }
  return terms;
}

Material read_material(const Hdf5File& file, const std::string& name,
                       std::vector<std::string>& warnings) {
  const std::string object = "/materials/" + name;
  const auto number = [&](const char* key) { return file.number_attribute(object, key); };
  const double density = number("rho");
  if (!(density >= 0) || !std::isfinite(density))
    throw Error(text("material %s: rho = %g must be finite and not negative",
                     name.c_str(), density));
  Material material;
  if (file.has_attribute(object, "loss_factor")) material.loss = number("loss_factor");
  if (!(material.loss >= 0) || !std::isfinite(material.loss))
    throw Error(text("material %s: loss_factor = %g must be finite and not negative",
                     name.c_str(), material.loss));
  material.terms = read_terms(file, object, name);
  for (const MaterialTerm& term : material.terms)
    if (term.part == MaterialTerm::Part::damper)
      throw Error(text("file %s: material %s: damper is a part of springs",
                       file.path().c_str(), name.c_str()));
  std::array<double, 9> axes = {1, 0, 0, 0, 1, 0, 0, 0, 1}; // in its own
  const auto own = axes;
  try {
    if (file.has_attribute(object, "E")) {
      const double E = number("E"), nu = number("nu");
      material.in_own_axes = isotropic(E, nu, density);
      material.beam = {E, E / (2 * (1 + nu)), density};
      check_units(name, E, density, warnings);
    } else {
      material.isotropic = false;
      for (const MaterialTerm& term : material.terms)
        if (term.part != MaterialTerm::Part::whole)
          throw Error("shear and bulk are parts of isotropic materials");
      axes = fixed<double, 9>(file, object, "axes");
      if (file.has_attribute(object, "stiffness")) {
        const auto stiffness = fixed<double, 36>(file, object, "stiffness");
        anisotropic(stiffness, axes, density); // axes are checked
        material.in_own_axes = anisotropic(stiffness, own, density);
        check_units(name, std::max({stiffness[0], stiffness[7], stiffness[14]}), density,
                    warnings);
      } else {
        const auto constants = fixed<double, 9>(file, object, "engineering_constants");
        orthotropic(constants, axes, density);
        material.in_own_axes = orthotropic(constants, own, density);
        check_units(name, *std::max_element(constants.begin(), constants.begin() + 3),
                    density, warnings);
      }
    }
    material.axis_1 = {axes[0], axes[1], axes[2]};
    material.in_own_axes.expansion = read_expansion(file, object);
    material.solid =
        material.isotropic ? material.in_own_axes : turned(material.in_own_axes, axes);
  } catch (Error& error) {
    error.add_context("file " + file.path() + ": material " + name);
    throw;
  }
  return material;
}

BeamSection read_section(const Hdf5File& file, const std::string& name) {
  const std::string object = "/sections/" + name;
  BeamSection section;
  const std::pair<const char*, double*> fields[] = {
      {"A", &section.A}, {"I_y", &section.I_y}, {"I_z", &section.I_z},
      {"J", &section.J}, {"k_y", &section.k_y}, {"k_z", &section.k_z}};
  const bool is_rod = !file.has_attribute(object, "I_y");
  for (auto [key, value] : fields) {
    if (is_rod && value != &section.A) continue;
    *value = file.number_attribute(object, key);
    const bool may_vanish =
        *key == 'I' || *key == 'J'; // where supports hold what it moves
    if (!(*value > 0) && !(may_vanish && *value == 0))
      throw Error(text("file %s: section %s: %s = %g must be %s", file.path().c_str(),
                       name.c_str(), key, *value,
                       may_vanish ? "zero or more" : "positive"));
  }
  if (!is_rod) section.y_axis = fixed<double, 3>(file, object, "y_axis");
  if (file.has_attribute(object, "torsional_inertia"))
    section.torsional_inertia = file.number_attribute(object, "torsional_inertia");
  if (file.has_attribute(object, "rotary_inertia"))
    section.rotary_inertia = file.number_attribute(object, "rotary_inertia");
  return section;
}

ShellSection read_shell(const Hdf5File& file, const std::string& name) {
  const std::string object = "/sections/" + name;
  ShellSection section;
  section.thickness = file.number_attribute(object, "thickness");
  section.offset = file.number_attribute(object, "offset");
  if (!(section.thickness > 0) || !std::isfinite(section.thickness) ||
      !std::isfinite(section.offset))
    throw Error(text("file %s: section %s: thickness = %g must be positive, and offset = "
                     "%g finite",
                     file.path().c_str(), name.c_str(), section.thickness,
                     section.offset));
  if (file.has_attribute(object, "axis_1"))
    section.axis_1 = fixed<double, 3>(file, object, "axis_1");
  const auto read_apart = [&](const char* part, ShellRole role) {
    const std::string factor = text("%s_factor", part),
                      material = text("%s_material", part);
    if (!file.has_attribute(object, factor)) return;
    SectionLayer layer{"", section.thickness, 0, role,
                       file.number_attribute(object, factor)};
    if (!(layer.factor > 0) || !std::isfinite(layer.factor))
      throw Error(text("file %s: %s: %s = %g must be positive", file.path().c_str(),
                       object.c_str(), factor.c_str(), layer.factor));
    if (file.has_attribute(object, material))
      layer.material = file.text_attribute(object, material);
    if (role == ShellRole::bending)
      layer.sides =
          file.has_attribute(object, "sides")
              ? fixed<double, 2>(file, object, "sides")
              : std::array<double, 2>{-0.5 * section.thickness, 0.5 * section.thickness};
    section.apart.push_back(layer);
  };
  read_apart("bending", ShellRole::bending);
  read_apart("shear", ShellRole::shear);
  if (section.apart.size() == 1)
    throw Error(
        text("file %s: section %s: bending and shear are given both or not at all",
             file.path().c_str(), name.c_str()));
  if (!file.has_attribute(object, "layer_materials")) return section;
  if (!section.apart.empty())
    throw Error(text("file %s: section %s: layers have their own bending and shear",
                     file.path().c_str(), name.c_str()));
  const auto materials = file.texts_attribute(object, "layer_materials");
  const auto thicknesses = file.numbers_attribute(object, "layer_thicknesses"),
             angles = file.numbers_attribute(object, "layer_angles");
  if (materials.empty() || thicknesses.size() != materials.size() ||
      angles.size() != materials.size())
    throw Error(
        text("file %s: section %s: layers need as many materials, thicknesses and "
             "angles",
             file.path().c_str(), name.c_str()));
  for (std::size_t k = 0; k < materials.size(); ++k)
    section.layers.push_back({materials[k], thicknesses[k], angles[k]});
  return section;
}

} // namespace flexgram
