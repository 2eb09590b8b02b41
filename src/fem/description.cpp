#include "fem/description.hpp"

#include "base/text.hpp"
#include "fem/description_file.hpp"
#include "fem/discrete.hpp"
#include "fem/shell.hpp"
#include "io/laws.hpp"

#include <algorithm>
#include <cmath>

namespace flexgram {

std::vector<std::string> ordered_children(const Hdf5File& file,
                                          const std::string& group) {
  if (!file.exists(group)) return {};
  auto names = file.children(group);
  const auto key = [&](const std::string& name) {
    const std::string object = group + "/" + name;
    return file.has_attribute(object, "order") ? file.number_attribute(object, "order")
                                               : 0.0;
  };
  std::stable_sort(names.begin(), names.end(),
                   [&](const auto& a, const auto& b) { return key(a) < key(b); });
  return names;
}

namespace {

bool has_line_section(ElementType type) {
  return type == ElementType::beam2 || type == ElementType::rod2;
}

MeshBlock read_block(const Hdf5File& file, const std::string& path) {
  MeshBlock block;
  block.path = path;
  std::string type = file.text_attribute(path, "type");
  if (file.has_attribute(path, "formulation"))
    type += "/" + file.text_attribute(path, "formulation");
  block.type = element_type(type);
  block.material = file.text_attribute(path, "material");
  if (has_line_section(block.type) || is_shell(block.type))
    block.section = file.text_attribute(path, "section");
  const auto shape = file.shape(path + "/connectivity");
  if (shape.size() != 2 || shape[1] != node_count(block.type))
    throw Error(text("file %s: %s/connectivity must be elements × %d for %s",
                     file.path().c_str(), path.c_str(), node_count(block.type),
                     element_name(block.type)));
  block.elements = shape[0];
  return block;
}

std::vector<std::int64_t> read_nodes(const Hdf5File& file, const std::string& object,
                                     std::int64_t points) {
  auto nodes = file.read_all<std::int64_t>(object + "/nodes");
  if (nodes.empty())
    throw Error(text("file %s: %s has no nodes", file.path().c_str(), object.c_str()));
  for (auto node : nodes)
    if (node < 0 || node >= points)
      throw Error(text("file %s: %s/nodes holds %lld, the mesh has %lld points",
                       file.path().c_str(), object.c_str(), static_cast<long long>(node),
                       static_cast<long long>(points)));
  auto sorted = nodes;
  std::sort(sorted.begin(), sorted.end());
  if (std::adjacent_find(sorted.begin(), sorted.end()) != sorted.end())
    throw Error(text("file %s: %s/nodes holds a node twice", file.path().c_str(),
                     object.c_str()));
  return nodes;
}

Interface read_interface(const Hdf5File& file, const std::string& name,
                         std::int64_t points) {
  const std::string object = "/interfaces/" + name;
  Interface interface;
  interface.name = name;
  const std::string coupling = file.text_attribute(object, "coupling");
  const std::vector<std::string> known = {"rigid", "distributing", "node"};
  const auto found = std::find(known.begin(), known.end(), coupling);
  if (found == known.end())
    throw Error(text("file %s: interface %s: coupling %s must be one of %s",
                     file.path().c_str(), name.c_str(), coupling.c_str(),
                     join(known).c_str()));
  interface.coupling = static_cast<Coupling>(found - known.begin());
  interface.nodes = read_nodes(file, object, points);
  interface.position = fixed<double, 3>(file, object, "position");
  for (double x : interface.position)
    if (!std::isfinite(x))
      throw Error(text("file %s: interface %s: position must be finite",
                       file.path().c_str(), name.c_str()));
  if (file.exists(object + "/weights")) {
    interface.weights = file.read_all<double>(object + "/weights");
    if (interface.weights.size() != interface.nodes.size() ||
        std::any_of(interface.weights.begin(), interface.weights.end(),
                    [](double w) { return !(w >= 0 && std::isfinite(w)); }))
      throw Error(
          text("file %s: interface %s: weights must be one number, zero or more, a "
               "node",
               file.path().c_str(), name.c_str()));
  }
  if (interface.coupling == Coupling::node && interface.nodes.size() != 1)
    throw Error(text("file %s: interface %s: coupling node takes one node, it has %zu",
                     file.path().c_str(), name.c_str(), interface.nodes.size()));
  return interface;
}

/// Names of inputs, and their values.
/// @pre materials and loads are known.
void read_preload(const Hdf5File& file, BodyDescription& body) {
  const auto inputs = file.texts_attribute("/preload", "inputs");
  const auto values = file.numbers_attribute("/preload", "values");
  if (inputs.size() != values.size())
    throw Error(text("file %s: /preload: inputs and values must be as many",
                     file.path().c_str()));
  for (std::size_t k = 0; k < inputs.size(); ++k) {
    if (!std::isfinite(values[k]))
      throw Error(text("file %s: preload: %s must be finite", file.path().c_str(),
                       inputs[k].c_str()));
    if (file.exists("/loads/" + inputs[k].substr(0, inputs[k].rfind('.')) +
                    "/temperature"))
      throw Error(
          text("file %s: preload: %s: stress of heat is not known as a preload yet",
               file.path().c_str(), inputs[k].c_str()));
    body.preload.emplace_back(inputs[k], values[k]);
  }
}

void refuse_varying_stress(const Hdf5File& file, const BodyDescription& body) {
  for (const auto& [name, material] : body.materials)
    for (const MaterialTerm& term : material.terms)
      if (term.law.is_parameter())
        throw Error(text(
            "file %s: material %s: its stress under a preload, or a spin, depends on "
            "%s: give the material one number, or leave the preload out",
            file.path().c_str(), name.c_str(), term.law.name().c_str()));
}

AccelerationField read_field(const Hdf5File& file, const std::string& object,
                             const std::string& name, const std::string& type) {
  using Type = AccelerationField::Type;
  AccelerationField field{name, Type::uniform, {}, {}};
  if (type == "acceleration") return field;
  field.type = type == "spin" ? Type::spin : Type::angular;
  field.point = fixed<double, 3>(file, object, "point");
  if (field.type == Type::spin) field.axis = fixed<double, 3>(file, object, "axis");
  double length = 0;
  for (std::size_t i = 0; i < 3; ++i) {
    length += field.axis[i] * field.axis[i];
    if (!std::isfinite(field.point[i]) || !std::isfinite(field.axis[i]))
      throw Error(text("file %s: load %s: point and axis must be finite",
                       file.path().c_str(), name.c_str()));
  }
  if (field.type == Type::spin && !(std::abs(length - 1) < 1e-9))
    throw Error(text("file %s: load %s: axis must be of unit length", file.path().c_str(),
                     name.c_str()));
  return field;
}

/// @pre the field has a name that no load has.
SpinRange read_spin(const Hdf5File& file) {
  const auto number = [&](const char* name) {
    return file.number_attribute("/spin", name);
  };
  const std::string frame = file.text_attribute("/spin", "frame");
  if (frame != "turning" && frame != "rest")
    throw Error(text("file %s: /spin: frame %s must be turning or rest",
                     file.path().c_str(), frame.c_str()));
  SpinRange spin{read_field(file, "/spin", "the body's spin", "spin"), number("least"),
                 number("most"), number("value"), frame == "turning"};
  try {
    expect_speeds(
        "spin",
        {{"least", {spin.least}}, {"most", {spin.most}}, {"value", {spin.value}}});
  } catch (Error& error) {
    error.add_context(text("file %s: /spin", file.path().c_str()));
    throw;
  }
  return spin;
}

/// /outputs/NAME/feedthrough, columns × inputs, with the names of these.
Feedthrough read_feedthrough(const Hdf5File& file, const std::string& object,
                             const NodalVectors& vectors) {
  const std::string place = object + "/feedthrough";
  const auto inputs = file.texts_attribute(place, "inputs");
  if (file.shape(place) !=
      std::vector<std::int64_t>{static_cast<std::int64_t>(vectors.columns.size()),
                                static_cast<std::int64_t>(inputs.size())})
    throw Error(
        text("file %s: %s must be columns × inputs", file.path().c_str(), place.c_str()));
  Feedthrough through;
  through.values = file.read_all<double>(place);
  for (double x : through.values)
    if (!std::isfinite(x))
      throw Error(text("file %s: %s holds %g", file.path().c_str(), place.c_str(), x));
  for (const auto& column : vectors.columns)
    for (const auto& input : inputs) {
      through.outputs.push_back(vectors.name + "." + column);
      through.inputs.push_back(input);
    }
  return through;
}

NodalVectors read_vectors(const Hdf5File& file, const std::string& group,
                          const std::string& name, std::int64_t points) {
  const std::string object = group + "/" + name;
  NodalVectors vectors{name, file.texts_attribute(object, "columns"),
                       read_nodes(file, object, points)};
  const auto shape = file.shape(object + "/values");
  if (shape.size() != 3 || shape[0] != static_cast<std::int64_t>(vectors.nodes.size()) ||
      shape[1] != static_cast<std::int64_t>(vectors.columns.size()) ||
      (shape[2] != 3 && shape[2] != 6) || shape[1] == 0)
    throw Error(
        text("file %s: %s/values must be nodes × columns × 3, or × 6 with moments",
             file.path().c_str(), object.c_str()));
  vectors.components = as_size(shape[2]);
  vectors.values = file.read_all<double>(object + "/values");
  for (double x : vectors.values)
    if (!std::isfinite(x))
      throw Error(
          text("file %s: %s/values holds %g", file.path().c_str(), object.c_str(), x));
  if (file.exists(object + "/feedthrough"))
    vectors.feedthrough = read_feedthrough(file, object, vectors);
  return vectors;
}

Reaction read_reaction(const Hdf5File& file, const std::string& name,
                       std::int64_t points) {
  const std::string object = "/outputs/" + name;
  Reaction reaction{name,
                    read_nodes(file, object, points),
                    fixed<double, 3>(file, object, "point"),
                    {}};
  std::sort(reaction.nodes.begin(), reaction.nodes.end());
  for (double x : reaction.point)
    if (!std::isfinite(x))
      throw Error(text("file %s: output %s: point must be finite", file.path().c_str(),
                       name.c_str()));
  for (double axis : file.numbers_attribute(object, "axes")) {
    if (axis != std::floor(axis) || axis < 0 || axis > 5)
      throw Error(text("file %s: output %s: axis %g must be 0 to 5", file.path().c_str(),
                       name.c_str(), axis));
    reaction.axes.push_back(static_cast<int>(axis));
  }
  return reaction;
}

/// A block's materials and section are there, and fit it.
void check_block(const Hdf5File& file, const BodyDescription& body,
                 const MeshBlock& block) {
  const std::string place = text("file %s: %s", file.path().c_str(), block.path.c_str());
  const bool is_beam = has_line_section(block.type), shell = is_shell(block.type);
  if (is_beam ? !body.sections.count(block.section)
              : shell && !body.shells.count(block.section))
    throw Error(text("%s: section %s of %s is not in /sections", place.c_str(),
                     block.section.c_str(), is_beam ? "a beam" : "a shell"));
  if (block.type == ElementType::beam2 && !(body.sections.at(block.section).J > 0))
    throw Error(
        text("%s: section %s is one of rods", place.c_str(), block.section.c_str()));
  const std::vector<std::string> materials = materials_of(body, block);
  for (const std::string& name : materials) {
    const auto found = body.materials.find(name);
    if (found == body.materials.end())
      throw Error(
          text("%s: material %s is not in /materials", place.c_str(), name.c_str()));
    const Material& material = found->second;
    if (is_beam && !material.isotropic)
      throw Error(text("%s: beams need an isotropic material", place.c_str()));
    if (materials.size() > 1 && !material.terms.empty())
      throw Error(
          text("%s: material %s of a layer: layers of several materials take loss "
               "factors, no material that relaxes, is a table or is known between "
               "two numbers: mesh such layers with solids",
               place.c_str(), name.c_str()));
    // Their stiffness is no sum of parts by shear and bulk modulus.
    const bool mixes = is_beam || shell || block.type == ElementType::hex8;
    for (const MaterialTerm& term : material.terms)
      if (mixes && term.part != MaterialTerm::Part::whole)
        throw Error(text(
            "%s: a material whose shear and bulk moduli relax differently needs "
            "tetrahedra, hexahedra of 20 nodes or wedges, not %s: give all moduli the "
            "same relaxation, or mesh anew",
            place.c_str(), element_name(block.type)));
  }
}

} // namespace

std::vector<SectionLayer> layers_of(const BodyDescription& body, const MeshBlock& block) {
  const ShellSection& section = body.shells.at(block.section);
  if (!section.layers.empty()) return section.layers;
  if (section.apart.empty()) return {{block.material, section.thickness, 0}};
  std::vector<SectionLayer> layers = {
      {block.material, section.thickness, 0, ShellRole::stretching}};
  for (const SectionLayer& layer : section.apart) {
    layers.push_back(layer);
    if (layer.material.empty()) layers.back().material = block.material;
  }
  return layers;
}

std::vector<std::string> materials_of(const BodyDescription& body,
                                      const MeshBlock& block) {
  if (block.type == ElementType::node1) return {};
  if (!is_shell(block.type)) return {block.material};
  std::vector<std::string> names;
  for (const SectionLayer& layer : layers_of(body, block))
    if (std::find(names.begin(), names.end(), layer.material) == names.end())
      names.push_back(layer.material);
  return names;
}

BodyDescription read_description(const Hdf5File& file) {
  BodyDescription body;
  agree(file.comm(), [&] {
    const auto shape = file.shape("/mesh/points");
    if (shape.size() != 2 || shape[1] != 3)
      throw Error(text("file %s: /mesh/points must be points × 3", file.path().c_str()));
    body.points = shape[0];
    if (file.has_attribute("/mesh", "mass_integration")) {
      const std::string rule = file.text_attribute("/mesh", "mass_integration");
      if (rule != "full" && rule != "reduced")
        throw Error(text("file %s: mass_integration %s must be full or reduced",
                         file.path().c_str(), rule.c_str()));
      body.mass_rule = rule == "full" ? MassRule::full : MassRule::reduced;
    }
    for (const auto& name : ordered_children(file, "/materials"))
      body.materials[name] = read_material(file, name, body.warnings);
    for (const auto& name : ordered_children(file, "/sections"))
      if (file.has_attribute("/sections/" + name, "thickness"))
        body.shells[name] = read_shell(file, name);
      else
        body.sections[name] = read_section(file, name);
    for (const auto& name : ordered_children(file, "/mesh/blocks"))
      body.blocks.push_back(read_block(file, "/mesh/blocks/" + name));
    if (body.blocks.empty())
      throw Error(text("file %s: /mesh/blocks holds no elements", file.path().c_str()));
    for (const auto& block : body.blocks) check_block(file, body, block);
    if (const std::string alone = "/mesh/alone"; file.exists(alone)) {
      const auto nodes = file.shape(alone + "/connectivity");
      if (nodes.size() != 2 || nodes[1] != 1)
        throw Error(text("file %s: %s/connectivity must be nodes × 1",
                         file.path().c_str(), alone.c_str()));
      body.blocks.push_back({alone, ElementType::node1, {}, {}, nodes[0]});
    }
    for (const auto& name : ordered_children(file, "/interfaces"))
      body.interfaces.push_back(read_interface(file, name, body.points));
    if (body.interfaces.empty())
      throw Error(
          text("file %s: /interfaces is empty: a body without ports has nothing to "
               "reduce",
               file.path().c_str()));
    read_discrete(file, body);
    for (const auto& name : ordered_children(file, "/loads")) {
      const std::string type = file.text_attribute("/loads/" + name, "type");
      const std::vector<std::string> known = {"acceleration", "angular_acceleration",
                                              "spin", "forces"};
      if (std::find(known.begin(), known.end(), type) == known.end())
        throw Error(text("file %s: load %s: type %s must be one of %s",
                         file.path().c_str(), name.c_str(), type.c_str(),
                         join(known).c_str()));
      if (type == "forces")
        body.loads.push_back(read_vectors(file, "/loads", name, body.points));
      else
        body.fields.push_back(read_field(file, "/loads/" + name, name, type));
    }
    if (file.exists("/preload")) read_preload(file, body);
    if (file.exists("/spin")) body.spin = read_spin(file);
    if (!body.preload.empty() || (body.spin && body.spin->turning))
      refuse_varying_stress(file, body);
    if (!body.preload.empty() || body.spin) expect_inertias_of_bodies(file, body);
    for (const auto& name : ordered_children(file, "/supports")) {
      const std::string object = "/supports/" + name;
      Support support{name, read_nodes(file, object, body.points), {}};
      for (double c : file.numbers_attribute(object, "components")) {
        if (c != std::floor(c) || c < 0 || c > 5)
          throw Error(text("file %s: %s: component %g must be 0 to 5",
                           file.path().c_str(), object.c_str(), c));
        support.components.push_back(static_cast<int>(c));
      }
      body.supports.push_back(std::move(support));
    }
    body.constraints = read_constraints(file, body.points);
    for (const auto& name : ordered_children(file, "/outputs")) {
      if (file.has_attribute("/outputs/" + name, "axes"))
        body.reactions.push_back(read_reaction(file, name, body.points));
      else
        body.outputs.push_back(read_vectors(file, "/outputs", name, body.points));
    }
  });
  return body;
}

} // namespace flexgram
