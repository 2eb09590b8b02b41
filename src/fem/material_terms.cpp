#include "fem/material_terms.hpp"

#include "base/error.hpp"
#include "base/index.hpp"
#include "base/text.hpp"
#include "fem/discrete.hpp"
#include "fem/element_of.hpp"
#include "fem/shell.hpp"

#include <set>

namespace flexgram {
namespace {

/// The part of an isotropic stiffness by its shear modulus, or by its bulk modulus.
SolidMaterial part_of(const SolidMaterial& material, MaterialTerm::Part part) {
  const double mu = material.stiffness[7 * 3], lambda = material.stiffness[1],
               bulk = lambda + 2 * mu / 3;
  const bool is_shear = part == MaterialTerm::Part::shear;
  SolidMaterial of{{}, material.density};
  for (std::size_t i = 0; i < 3; ++i) {
    for (std::size_t j = 0; j < 3; ++j)
      of.stiffness[6 * i + j] = is_shear ? -2 * mu / 3 : bulk;
    if (!is_shear) continue;
    of.stiffness[7 * i] += 2 * mu;
    of.stiffness[7 * (i + 3)] = mu;
  }
  return of;
}

} // namespace

MaterialTerms::MaterialTerms(const BodyDescription& body) : body_(body) {
  std::set<std::string> used;
  std::set<double> losses;
  for (const MeshBlock& block : body.blocks)
    for (const std::string& name : materials_of(body, block))
      if (used.insert(name).second) losses.insert(body.materials.at(name).loss);
  bool damps = false;
  for (const auto& [name, spring] : body.springs) {
    if (frobenius_norm(spring.stiffness) > 0) losses.insert(spring.loss);
    damps =
        damps || (frobenius_norm(spring.damping) > 0 && !spring.has_varying_damping());
  }
  // Of stiffness by stress nothing is lost.
  const bool stressed = !body.preload.empty() || (body.spin && body.spin->turning),
             apart = losses.size() > 1 || (stressed && *losses.begin() > 0);
  if (!apart) common_loss_ = *losses.begin();
  if (apart) laws_.emplace_back(Law::Kind::structural);
  for (const auto& [name, spring] : body.springs) {
    std::vector<Share>& shares = of_spring_[name];
    if (apart && spring.loss > 0) shares.push_back({0, spring.loss, {}});
    if (frobenius_norm(spring.damping) > 0 && !spring.has_varying_damping())
      shares.push_back({laws_.size(), 0, {}, spring.damping});
  }
  if (damps) laws_.emplace_back(Law::Kind::viscous);
  const auto add = [&](const Law& law, double loss) {
    for (const Law& other : laws_)
      if (other.name() == law.name())
        throw Error(text("two parts of materials or springs would be named %s: rename "
                         "one",
                         law.name().c_str()));
    laws_.push_back(law.is_parameter() && apart ? law.with("loss", loss) : law);
    return laws_.size() - 1;
  };
  for (const auto& [name, spring] : body.springs)
    for (const MaterialTerm& term : spring.terms) {
      const bool damps_here = term.part == MaterialTerm::Part::damper;
      of_spring_[name].push_back(
          {add(term.law, spring.loss), 1.0, {}, damps_here ? spring.damping : Dense()});
    }
  for (const std::string& name : used) {
    const Material& material = body.materials.at(name);
    std::vector<Share>& shares = of_material_[name];
    if (apart && material.loss > 0) shares.push_back({0, material.loss, {}});
    for (const MaterialTerm& term : material.terms) {
      const bool whole = term.part == MaterialTerm::Part::whole;
      shares.push_back({add(term.law, material.loss), whole ? 1.0 : 0.0,
                        whole ? SolidMaterial() : part_of(material.solid, term.part)});
    }
  }
}

std::vector<ElementPart> MaterialTerms::of_element(const PlacedElement& at,
                                                   MassRule mass_rule,
                                                   const Dense& K) const {
  const MeshBlock& block = at.block();
  const std::vector<Vector3>& x = at.x;
  std::vector<ElementPart> parts;
  if (block.type == ElementType::mass1 || block.type == ElementType::node1) return parts;
  std::vector<std::string> materials;
  if (is_shell(block.type)) materials = materials_of(body_, block);
  if (materials.size() > 1 || (block.material.empty() && !materials.empty())) {
    for (const std::string& name : materials)
      for (const Share& share : of_material_.at(name)) {
        parts.push_back({share.number, stiffness_of_material(body_, at, name)});
        for (double& value : parts.back().matrix.data) value *= share.weight;
      }
    return parts;
  }
  for (const Share& share :
       (is_spring(block.type) ? of_spring_ : of_material_).at(block.material)) {
    if (share.dashpot.rows > 0) {
      parts.push_back({share.number, spring_matrix(share.dashpot, x)});
      continue;
    }
    if (share.weight == 0) {
      parts.push_back(
          {share.number, solid_matrices(block.type, x, {share.material}, mass_rule).K});
      continue;
    }
    parts.push_back({share.number, K});
    for (double& value : parts.back().matrix.data) value *= share.weight;
  }
  return parts;
}

} // namespace flexgram
