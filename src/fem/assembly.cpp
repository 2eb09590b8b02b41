#include "fem/assembly.hpp"

#include "base/index.hpp"
#include "base/text.hpp"
#include "fem/discrete.hpp"
#include "fem/element_of.hpp"
#include "fem/followers.hpp"
#include "fem/loads.hpp"
#include "fem/material_terms.hpp"
#include "fem/node_matrix.hpp"
#include "fem/preload.hpp"
#include "fem/reactions.hpp"
#include "fem/revolution.hpp"
#include "fem/shell.hpp"
#include "fem/stiffening.hpp"
#include "io/body_io.hpp"
#include "model/parameters.hpp"

#include <algorithm>

namespace flexgram {
namespace {

/// Widths over thickness: bending is smaller than stretching by its square, and
/// rounding is a share of the latter.
constexpr double thin = 1e4, thinnest = 1e6;

/// Assembles the elements of one rank.
class ElementAssembler {
public:
  ElementAssembler(const BodyDescription& body, const DofMap& map,
                   const MaterialTerms& terms, const Followers& followers,
                   const Hdf5File& file, FieldLoads& fields, Reactions& reactions,
                   Preload* preload, const SpinRange* spin, Preload* spinning,
                   Revolution* revolution, AssemblyFacts& facts)
      : body_(body), map_(map), terms_(terms), followers_(followers), file_(file),
        fields_(fields), reactions_(reactions), preload_(preload), spinning_(spinning),
        spin_(spin), revolution_(revolution), facts_(facts) {}

  void run(NodeMatrix& matrix) {
    followers_.for_each([&](const PlacedElement& at) {
      try {
        add(at, matrix);
      } catch (Error& error) {
        if (!is_discrete(at.block().type)) error.add_context(name(at));
        throw;
      }
    });
    if (inverted_ > 0)
      throw Error(
          first_inverted_ +
          (inverted_ > 1
               ? text("; so are %lld more", static_cast<long long>(inverted_ - 1))
               : std::string()) +
          (inverted_ == facts_.elements
               ? " (all of them: is the mesh mirrored or its node order another one?)"
               : ""));
  }

private:
  void add(const PlacedElement& at, NodeMatrix& matrix) {
    const MeshBlock& block = at.block();
    const std::vector<Vector3>& x = at.x;
    const bool rigid = at.rigid; // only mass
    ElementMatrices element = element_matrices(body_, at, !rigid);
    if (!is_discrete(block.type)) {
      ++facts_.elements;
      facts_.rigid_elements += rigid;
    }
    facts_.mass += element.mass;
    facts_.worst_shape = std::min(facts_.worst_shape, element.shape_ratio);
    facts_.aspect = std::max(facts_.aspect, element.aspect);
    if (element.min_detJ <= 0) {
      if (++inverted_ == 1)
        first_inverted_ =
            name(at) + text(" is inverted or flat: its Jacobian determinant is "
                            "%.3g",
                            element.min_detJ);
      return;
    }
    if (element.aspect > thinnest)
      throw Error(
          text("it is some %.0e times wider than thick, more than the digits of its "
               "stiffness allow: are all coordinates in one unit?%s",
               element.aspect,
               is_shell(block.type) ? "" : " Beams and shells are made for thin parts"));
    if (fields_.any())
      fields_.add_element(at.nodes, x, dofs_per_node(block.type), element);
    const Dense T = followers_.transformation(at);
    std::vector<ElementPart> parts;
    if (!rigid) parts = terms_.of_element(at, body_.mass_rule, element.K);
    if (is_discrete(block.type)) {
      const auto expect = [&](const Dense& of_element) {
        expect_rotations(map_, at.nodes, x.size(), of_element, block.path);
      };
      expect(element.K);
      expect(element.M);
      for (const ElementPart& part : parts) expect(part.matrix);
    }
    Stressed stressed, at_one; // by the preload; by a spin of 1 rad/s
    const std::size_t of_spin = terms_.laws().size();
    if (preload_) {
      if (preload_->speed() > 0)
        parts.push_back({of_spin, preload_->coriolis(at, element)});
      stressed = stressed_by(*preload_, at, element, T, preload_->of_spin(at, element));
      if (!rigid) add_to(stressed.added, stressed.quadratic);
    }
    Convection by_spin; // its Coriolis forces, and by what it softens
    if (spin_) {
      const AccelerationField& field = spin_->field;
      by_spin = spin_->turning
                    ? Convection{coriolis(body_, at, element, field.axis),
                                 spin_softening(body_, at, element, field.axis)}
                    : convection(body_, at, element, field);
      if (revolution_ && is_solid(block.type))
        revolution_->add(at, by_spin.gyroscopic, element.mass);
      parts.push_back({of_spin, std::move(by_spin.gyroscopic)});
    }
    if (spinning_) {
      Dense less(by_spin.softening.rows, by_spin.softening.columns);
      add_to(less, by_spin.softening, -1);
      at_one = stressed_by(*spinning_, at, element, T, std::move(less));
      if (preload_ && !rigid) { // of both together, less that of each
        for (std::size_t i = 0; i < at_one.u.size(); ++i) stressed.u[i] += at_one.u[i];
        add_to(at_one.added, preload_->of_stress(at, stressed.u).quadratic);
        for (const Dense* own : {&stressed.quadratic, &at_one.quadratic})
          add_to(at_one.added, *own, -1);
      }
      if (!rigid) parts.push_back({of_spin + 2, std::move(at_one.quadratic)});
      parts.push_back({of_spin + 1, std::move(at_one.added)});
    }
    if (preload_) {
      if (!rigid) add_to(stressed.added, element.K);
      element.K = std::move(stressed.added);
    }
    if (reactions_.any() && !rigid)
      reactions_.add_element(at.nodes, x, dofs_per_node(block.type), element.K,
                             element.M);
    const auto reduce = [&](const Dense& a) {
      return a.data.empty() ? Dense() : multiply_transposed(T, multiply(a, T));
    };
    if (T.data.empty()) {
      matrix.add(at.masters, at.master_count, element.K, element.M, parts);
      return;
    }
    for (ElementPart& part : parts) part.matrix = reduce(part.matrix);
    Dense K = rigid && !preload_ ? Dense() : reduce(element.K);
    if (!stressed.turning.data.empty()) add_to(K, stressed.turning);
    if (!at_one.turning.data.empty()) add_to(parts.back().matrix, at_one.turning);
    matrix.add(at.masters, at.master_count, K, reduce(element.M), parts);
  }

  /// What loads that stay add to an element's stiffness.
  struct Stressed {
    Dense added; ///< at its dofs; linear in the loads
    Dense
        turning; ///< of references, by the forces at their slaves: over the masters' dofs
    Dense quadratic = {}; ///< as `added`
    std::vector<double> u = {};
  };
  /// @param by_motion  what a spin among them adds without stress.
  Stressed stressed_by(Preload& loads, const PlacedElement& at,
                       const ElementMatrices& element, const Dense& T,
                       Dense by_motion) const {
    Dense forces = loads.weight(at, element);
    for (double& f : forces.data) f = -f;
    Stressed result{std::move(by_motion), {}};
    if (!at.rigid) {
      Dense u = followers_.displacement(
          at, T, [&](std::int64_t node, int c) { return loads.at(node, c); });
      add_to(forces, multiply(element.K, u));
      result.u = std::move(u.data);
      StressStiffness by_stress = loads.of_stress(at, result.u);
      if (!by_stress.free.data.empty()) add_to(forces, by_stress.free, -1);
      add_to(result.added, by_stress.linear);
      result.quadratic = std::move(by_stress.quadratic);
    }
    result.turning = followers_.turning(at, forces);
    return result;
  }

  std::string name(const PlacedElement& at) const {
    const MeshBlock& block = at.block();
    const std::string ids = block.path + "/ids";
    const std::int64_t number = at.elements.number[at.number];
    const long long id =
        file_.exists(ids)
            ? static_cast<long long>(file_.read<std::int64_t>(ids, number, 1).front())
            : static_cast<long long>(number);
    const bool layered = block.material.empty();
    return text("file %s: element %lld (%s, %s %s)", file_.path().c_str(), id,
                element_name(block.type), layered ? "section" : "material",
                (layered ? block.section : block.material).c_str());
  }

  const BodyDescription& body_;
  const DofMap& map_;
  const MaterialTerms& terms_;
  const Followers& followers_;
  const Hdf5File& file_;
  FieldLoads& fields_;
  Reactions& reactions_;
  Preload *preload_, *spinning_; ///< null: there is none; of the spin at 1 rad/s
  const SpinRange* spin_;        ///< whose matrices are wanted; null: none
  Revolution* revolution_;       ///< of solids in the frame at rest, else null
  AssemblyFacts& facts_;
  std::int64_t inverted_ = 0;
  std::string first_inverted_;
};

/// Nodes whose coordinates a rank needs beyond those of its elements.
std::vector<std::int64_t> further_nodes(const BodyDescription& body,
                                        const Partition& partition, int rank) {
  std::vector<std::int64_t> nodes = discrete_nodes(body);
  for (const auto& interface : body.interfaces)
    nodes.insert(nodes.end(), interface.nodes.begin(), interface.nodes.end());
  for (std::size_t node = 0; node < partition.node_owner.size(); ++node)
    if (partition.node_owner[node] == rank)
      nodes.push_back(static_cast<std::int64_t>(node));
  for (const Share& share : body.constraints.shares) nodes.push_back(share.node);
  return nodes;
}

void fill_dof_lists(const DofMap& map, const LocalMesh& mesh, int rank,
                    SecondOrderModel& model) {
  for (std::size_t i = 0; i < map.dofs.size(); ++i) {
    if (map.owner[i] != rank || map.first[i] < 0) continue;
    const auto node = static_cast<std::int64_t>(i);
    const Vector3& x = node < map.points
                           ? mesh.coordinates[mesh.place(node)]
                           : map.reference_position[i - as_size(map.points)];
    for (int c = 0; c < map.dofs[i]; ++c) {
      if (map.equation(node, c) < 0) continue;
      model.node.push_back(node);
      model.component.push_back(c);
      model.position.insert(model.position.end(), x.begin(), x.end());
    }
  }
}

/// Further ports behind those that are there.
void append(Ports more, Block& ports, std::vector<std::string>& names) {
  ports = concatenate(ports, more.B);
  for (auto& name : more.names) {
    if (std::find(names.begin(), names.end(), name) != names.end())
      throw Error(text("two ports are named %s: interfaces, loads and outputs need names "
                       "of their own",
                       name.c_str()));
    names.push_back(std::move(name));
  }
}

/// The terms of a spin. @param parts  at 1 rad/s: Coriolis forces, what stress and M_c add to the
/// stiffness, and what moved geometry does; the first alone where nothing stretches
void add_spin(SecondOrderModel& model, const SpinRange& spin, bool stretches,
              Matrix* parts, const SolverOptions& solver, Observer& observer) {
  const LawNumbers speeds{
      {"least", {spin.least}}, {"most", {spin.most}}, {"value", {spin.value}}};
  model.terms.push_back({Law("coriolis", "coriolis", speeds), std::move(parts[0])});
  if (!stretches) return;
  Matrix &S = parts[1], &moved = parts[2];
  PetscReal size = 0;
  FG_CALL(MatNorm(moved, NORM_FROBENIUS, &size));
  Matrix by_stress, by_motion; // what is added between no spin and the most
  const double square = spin.most * spin.most, least = spin.least * spin.least;
  FG_CALL(MatDuplicate(S, MAT_COPY_VALUES, by_stress.out()));
  FG_CALL(MatScale(by_stress, square));
  FG_CALL(MatDuplicate(moved, MAT_COPY_VALUES, by_motion.out()));
  FG_CALL(MatScale(by_motion, square * square));
  int negative = 0;
  if (const auto share =
          fails_at(model.K, by_stress, by_motion, model.node, solver, negative))
    observer.fact("critical speed",
                  text("about %.3g rad/s: there a load that %s meets a "
                       "resonance at 0 Hz; above it Coriolis forces alone hold the body",
                       spin.most * std::sqrt(*share),
                       spin.turning ? "turns with the body" : "stands still"));
  if (spin.least > 0) {
    FG_CALL(MatAXPY(model.K, least, S, DIFFERENT_NONZERO_PATTERN));
    FG_CALL(MatAXPY(model.K, least * least, moved, DIFFERENT_NONZERO_PATTERN));
  }
  const auto of_power = [&](double power) {
    LawNumbers numbers = speeds;
    numbers["power"] = {power};
    return numbers;
  };
  const std::string seen = spin.turning ? "" : "_at_rest"; // campbell looks at it
  model.terms.push_back({Law("spin" + seen, "spin", of_power(2)), std::move(S)});
  if (size > 0)
    model.terms.push_back(
        {Law("spin_moved" + seen, "spin", of_power(4)), std::move(moved)});
}

} // namespace

SecondOrderModel assemble_body(const Hdf5File& file, const SolverOptions& solver,
                               bool stiffening, AssemblyFacts& facts,
                               Observer& observer) {
  const MPI_Comm comm = file.comm();
  const int rank = comm_rank(comm);
  const BodyDescription all = read_description(file);
  BodyDescription body = without_preload_loads(all);
  for (const auto& warning : body.warnings) observer.warn(warning);
  SecondOrderModel model;
  model.name = file.path();
  model.comm = comm;
  model.damping = read_damping(file);

  Partition partition;
  DofMap map;
  LocalMesh mesh;
  {
    Stage stage(observer, "partition");
    partition = partition_mesh(file, body);
    map = number_equations(file, all, partition);
    mesh = read_local_mesh(file, body, partition, further_nodes(body, partition, rank));
    agree(comm, [&] { add_discrete(body, map, rank, mesh); });
  }
  Stage stage(observer, "assemble");
  if (const std::size_t dependent = body.constraints.dof.size(); dependent > 0)
    observer.fact(
        "constraints",
        text("%zu dependent dofs follow others, by equations and ties", dependent));
  model.turns_by_nodes =
      body.constraints.are_means() &&
      std::none_of(body.masses.begin(), body.masses.end(), [](const auto& entry) {
        return is_beside(entry.second) || entry.second.matrix;
      });
  model.n = map.n;
  model.rows = map.rows;
  std::optional<Followers> followers(std::in_place, map, mesh);
  const auto coordinates = [&](std::int64_t node) {
    return mesh.coordinates[mesh.place(node)];
  };
  const MaterialTerms terms(body);
  model.damping.eta += terms.common_loss();
  const bool has_solids =
      std::any_of(all.blocks.begin(), all.blocks.end(),
                  [](const MeshBlock& block) { return is_solid(block.type); });
  const bool stretches = all.spin && (all.spin->turning || has_solids);
  std::optional<Preload> preload, spinning;
  std::optional<Revolution> revolution; // of solids in the frame at rest
  const auto elements = [&](FieldLoads& fields, Reactions& reactions) {
    facts = {};
    if (stretches && !all.spin->turning) revolution.emplace(all.spin->field, body.points);
    // The static solve comes before what its stress stiffens.
    const SpinRange* spin = body.spin && (spinning || !stretches) ? &*body.spin : nullptr;
    const std::size_t of_spin = spinning                                    ? 3
                                : spin || (preload && preload->speed() > 0) ? 1
                                                                            : 0;
    NodeMatrix matrix(map, followers->start(), followers->nodes(),
                      terms.laws().size() + of_spin);
    agree(comm, [&] {
      ElementAssembler(body, map, terms, *followers, file, fields, reactions,
                       preload ? &*preload : nullptr, spin,
                       spinning ? &*spinning : nullptr,
                       revolution ? &*revolution : nullptr, facts)
          .run(matrix);
    });
    return matrix.assemble(comm, model.K, model.M);
  };
  fill_dof_lists(map, mesh, rank, model);
  BodyDescription loaded = all; // with all loads, its preload's and its spin's too
  loaded.reactions.clear();
  if (stretches) loaded.fields.push_back(all.spin->field);
  Matrix unloaded; // K
  if (!all.preload.empty() || stretches) {
    Reactions none(comm, loaded, map, mesh);
    FieldLoads fields(comm, loaded, map, mesh, {});
    elements(fields, none);
    Ports inputs = interface_ports(comm, loaded, map, coordinates, {});
    append(fields.take(), inputs.B, inputs.names);
    append(nodal_ports(comm, loaded.loads, map, mesh, partition), inputs.B, inputs.names);
    const auto solved = [&](const LoadValues& loads) {
      return Preload(loaded, loads, map, model.K, inputs, model.node, mesh, solver);
    };
    if (!all.preload.empty()) preload.emplace(solved(all.preload));
    if (stretches)
      spinning.emplace(solved({{input_names(loaded.fields.back()).front(), 1.0}}));
    const bool spins = preload && preload->speed() > 0;
    const bool turns = all.spin && all.spin->turning;
    if (turns || spins)
      for (const std::string& name : springs_of_a_turning_ground(
               all, turns ? all.spin->field.axis : preload->axis()))
        observer.warn(text(
            "spring %s: seen in the frame that turns, it ends at something that turns "
            "with the body, as supports do; for a bearing at rest take the frame at rest",
            name.c_str()));
    if (spins && all.spin)
      throw Error("preload: a spin beside the spin of the body: it turns at one speed");
    unloaded = std::move(model.K);
    model.M = Matrix();
  }
  Reactions reactions(comm, body, map, mesh);
  const HeldForces held = reactions.held_forces();
  FieldLoads fields(comm, body, map, mesh, held);
  std::vector<Matrix> parts = elements(fields, reactions);
  followers.reset();
  if (preload) {
    preload->tell(comm, observer);
    preload->expect_stable(unloaded, model.K, model.node, solver);
    unloaded = Matrix();
  }
  for (std::size_t k = 0; k < terms.laws().size(); ++k)
    model.terms.push_back({terms.laws()[k], std::move(parts[k])});
  model.damp_parameters();
  const std::size_t first_of_spin = terms.laws().size();
  if (parts.size() > first_of_spin)
    FG_CALL(MatSetOption(parts[first_of_spin], MAT_SYMMETRIC, PETSC_FALSE));
  if (preload && preload->speed() > 0) {
    model.coriolis = 2 * preload->speed();
    model.terms.push_back({Law::Kind::gyroscopic, std::move(parts[first_of_spin])});
  }
  if (all.spin) {
    if (!revolution) model.coriolis = 2 * all.spin->most;
    if (revolution) revolution->expect(comm, observer);
    if (spinning)
      spinning->tell(comm, *all.spin, observer);
    else
      observer.fact("spin", text("%g to %g rad/s, seen in the frame at rest: gyroscopic "
                                 "moments of beams on its axis",
                                 all.spin->least, all.spin->most));
    const auto is_dashpot = [](const auto& term) { return term.law.is_viscous(); };
    if (!all.spin->turning &&
        (model.damping.beta > 0 || model.damping.eta > 0 ||
         !std::all_of(model.terms.begin(), model.terms.end(), is_dashpot)))
      observer.warn(
          "spin: in the frame at rest losses of materials count as if the shaft "
          "did not turn; what they do to its stability is left out");
    add_spin(model, *all.spin, stretches, parts.data() + first_of_spin, solver, observer);
  }
  if (model.coriolis > 0 && reactions.any())
    throw Error(
        "reactions of a body that spins are not known yet: the Coriolis "
        "forces of what the supports hold would be missing; leave the outputs of type "
        "reaction out");
  if (!terms.laws().empty() && reactions.any())
    throw Error(
        "reactions of a body whose materials have loss factors of their own, or are "
        "viscoelastic, or known between two numbers, are not known yet: leave the "
        "outputs of type reaction out, or "
        "give the materials one loss factor (under a preload: `damping: eta`)");
  facts.elements = sum_over(comm, facts.elements);
  facts.rigid_elements = sum_over(comm, facts.rigid_elements);
  facts.mass = sum_over(comm, facts.mass);
  facts.worst_shape = -max_over(comm, -facts.worst_shape);
  facts.aspect = max_over(comm, facts.aspect);
  if (facts.aspect > thin)
    observer.warn(text("mesh quality: the thinnest element is some %.0e times wider than "
                       "thick: rounding of its stiffness outweighs what bends it",
                       facts.aspect));
  if (facts.worst_shape < 0.01)
    observer.warn(
        text("mesh quality: in the worst element the Jacobian determinant varies by "
             "a factor of %.0f",
             1 / facts.worst_shape));

  Ports ports = interface_ports(comm, body, map, coordinates, held);
  for (const auto& remark : ports.remarks) observer.fact("interfaces", remark);
  model.B = std::move(ports.B);
  model.C = model.B.share();
  model.inputs = model.outputs = std::move(ports.names);
  model.outputs_are_inputs = body.fields.empty() && body.loads.empty() &&
                             body.outputs.empty() && body.reactions.empty();
  append(fields.take(), model.B, model.inputs);
  append(nodal_ports(comm, body.loads, map, mesh, partition, held), model.B,
         model.inputs);
  append(nodal_ports(comm, body.outputs, map, mesh, partition), model.C, model.outputs);
  for (const auto& output : body.outputs) model.feedthrough.append(output.feedthrough);
  Ports forces =
      reactions.take(model.K, model.M, model.B, model.inputs, model.feedthrough);
  for (const std::string& name : forces.names) {
    model.output_damping.outputs.push_back(name);
    model.output_damping.beta.push_back(model.damping.beta);
    model.output_damping.eta.push_back(model.damping.eta);
  }
  if (reactions.any())
    observer.fact(
        "reactions",
        model.damping.beta > 0 || model.damping.eta > 0
            ? "(1 + iωβ + iη) C q + F u: the damped stiffness, and a share of the "
              "loads at once (/feedthrough)"
            : "C q + F u with a share F of the loads at once (/feedthrough)");
  append(std::move(forces), model.C, model.outputs);
  if (stiffening) {
    if (all.spin || !all.preload.empty())
      throw Error(
          "{stiffening} is of a body at rest: leave its spin and its preload out");
    if (!parameters_of(model.terms).empty())
      throw Error("{stiffening} is of one stiffness: give materials that are known "
                  "between two numbers one value");
    model.stiffening = std::make_shared<MeshStiffening>(
        std::move(body), std::move(map), std::move(mesh), model, solver, observer);
  }
  return model;
}

} // namespace flexgram
