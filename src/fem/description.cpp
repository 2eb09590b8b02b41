#include "fem/description.hpp"

#include "base/text.hpp"
#include "fem/description_file.hpp"
#include "fem/discrete.hpp"
#include "fem/shape_functions.hpp"
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

bool Spring::has_varying_damping() const {
  return std::any_of(terms.begin(), terms.end(), [](const MaterialTerm& term) {
    return term.part == MaterialTerm::Part::damper;
  });
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
  const std::string axes = path + "/axes";
  if (!file.exists(axes)) return block;
  if (has_line_section(block.type))
    throw Error(text("file %s: %s: only solids and shells have material axes",
                     file.path().c_str(), axes.c_str()));
  const auto given = file.shape(axes);
  const std::size_t points = stiffness_points(block.type).size();
  block.axes = given.size() == 3 ? as_size(given[1]) : 1;
  if ((given.size() != 2 && given.size() != 3) || given[0] != shape[0] ||
      given.back() != 6 || (block.axes != 1 && block.axes != points) ||
      (is_shell(block.type) && block.axes != 1))
    throw Error(
        text("file %s: %s must be elements × 6, or of solids elements × %zu points "
             "× 6",
             file.path().c_str(), axes.c_str(), points));
  return block;
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
      const std::map<std::string, MassRule> rules = {{"full", MassRule::full},
                                                     {"reduced", MassRule::reduced},
                                                     {"lumped", MassRule::lumped}};
      if (rules.count(rule) == 0)
        throw Error(text("file %s: mass_integration %s must be full, reduced or lumped",
                         file.path().c_str(), rule.c_str()));
      body.mass_rule = rules.at(rule);
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
    read_loads(file, body);
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
    read_outputs(file, body);
  });
  return body;
}

} // namespace flexgram
