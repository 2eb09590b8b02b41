#include "fem/preload.hpp"

#include "base/index.hpp"
#include "base/text.hpp"
#include "fem/discrete.hpp"
#include "fem/element_of.hpp"
#include "linalg/decompositions.hpp"

#include <algorithm>
#include <cmath>
#include <span>

namespace flexgram {
namespace {

/// Σ value · column of the inputs.
Block total_load(const LoadValues& loads, const Ports& inputs) {
  Dense shares(static_cast<int>(inputs.names.size()), 1);
  for (const auto& [name, value] : loads) {
    const auto found = std::find(inputs.names.begin(), inputs.names.end(), name);
    if (found == inputs.names.end())
      throw Error(text("preload: the body has no input %s, did you mean %s?",
                       name.c_str(), nearest(name, inputs.names).c_str()));
    shares(static_cast<int>(found - inputs.names.begin()), 0) += value;
  }
  return combine(inputs.B, shares);
}

/// Shortenings that give bolts their forces.
/// @param stiffness  work of each bolt's stress with the shortening of each [N m], symmetric.
/// @param work       that of the forces [N m].
/// @throws Error naming bolts in one line of force: these have one force.
std::vector<double> shortenings(const std::vector<std::string>& names, Dense stiffness,
                                const std::vector<double>& work) {
  const int count = stiffness.rows;
  std::vector<double> scale;
  for (int i = 0; i < count; ++i) scale.push_back(1 / std::sqrt(stiffness(i, i)));
  for (int j = 0; j < count; ++j)
    for (int i = 0; i < count; ++i)
      stiffness(i, j) *= scale[as_size(i)] * scale[as_size(j)];
  symmetrise(stiffness);
  const auto [values, vectors] = symmetric_eigen(std::move(stiffness));
  if (!(values.front() > 1e-6)) {
    std::vector<std::string> involved;
    for (int i = 0; i < count; ++i)
      if (std::abs(vectors(i, 0)) > 0.1) involved.push_back(names[as_size(i)]);
    throw Error(text("preload: %s pull on each other: make one bolt of them, with one "
                     "force",
                     join(involved).c_str()));
  }
  std::vector<double> strains(as_size(count));
  for (int k = 0; k < count; ++k) {
    double share = 0;
    for (int i = 0; i < count; ++i)
      share += vectors(i, k) * scale[as_size(i)] * work[as_size(i)];
    for (int i = 0; i < count; ++i)
      strains[as_size(i)] +=
          scale[as_size(i)] * vectors(i, k) * share / values[as_size(k)];
  }
  return strains;
}

} // namespace

Preload::Preload(const BodyDescription& body, LoadValues loads, const DofMap& map, Mat K,
                 const Ports& inputs, const std::vector<std::int64_t>& node,
                 const LocalMesh& mesh, const SolverOptions& options)
    : body_(body), loads_(std::move(loads)), map_(map) {
  for (const auto& [name, value] : loads_) {
    bool strains = false; // forces of elements at each other, which these count
    for (const Pretension& bolt : body.pretensions) {
      if (bolt.input != name) continue;
      strains = true;
      bolts_.push_back({&bolt, value, 0});
    }
    for (const NodeTemperatures& warm : body.temperatures) {
      if (warm.input != name) continue;
      strains = true;
      temperature_.resize(as_size(body.points));
      for (std::size_t k = 0; k < warm.nodes.size(); ++k)
        temperature_[as_size(warm.nodes[k])] += value * warm.values[k];
      if (!warm.gradients.empty()) gradient_.resize(as_size(body.points));
      for (std::size_t k = 0; k < warm.gradients.size(); ++k)
        gradient_[as_size(warm.nodes[k])] += value * warm.gradients[k];
    }
    for (const AccelerationField& field : body.fields) {
      const auto names = input_names(field);
      const auto found = std::find(names.begin(), names.end(), name);
      if (found == names.end() || value == 0) continue;
      if (field.type == AccelerationField::Type::angular)
        throw Error(
            text("preload: %s: an angular acceleration does not last; take a spin",
                 name.c_str()));
      const Field one{&field, static_cast<int>(found - names.begin()), value};
      if (one.is_spin() && value < 0)
        throw Error(text("preload: %s = %g is the square of a speed, and negative",
                         name.c_str(), value));
      if (one.is_spin() && spins())
        throw Error(text("preload: %s is a second spin: a body turns about one axis",
                         name.c_str()));
      fields_.push_back(one);
    }
    for (const NodalVectors& vectors : body.loads) {
      const auto names = input_names(vectors);
      if (strains || std::find(names.begin(), names.end(), name) == names.end()) continue;
      for (std::int64_t loaded : vectors.nodes)
        if (map.reference[as_size(loaded)] >= 0)
          throw Error(
              text("preload: %s acts on nodes of a rigid interface: give the load to "
                   "the interface, or to other nodes",
                   name.c_str()));
    }
  }
  const char* free =
      "the body moves freely, or a part of it: a preload or a spin needs supports "
      "(--support of a mesh, `supports` in YAML, *BOUNDARY or SPC in a deck)";
  try {
    ShiftedSolver solver(K, nullptr, {}, node, counting(options));
    solver.count_pivots(true);
    solver.factorise({1.0, 0.0});
    if (solver.null_pivots() > 0) throw Error(free);
    solve(solver, inputs);
  } catch (const ShiftError&) {
    throw Error(free);
  }
  const auto look = [&](std::int64_t at_node) {
    double square = 0;
    for (int c = 0; c < 3; ++c) square += std::pow(at(at_node, c), 2);
    largest_ = std::max(largest_, std::sqrt(square));
  };
  for (std::int64_t here : mesh.nodes)
    if (map.reference[as_size(here)] < 0) look(here);
  for (std::size_t k = 0; k < map.reference_position.size(); ++k)
    look(map.points + static_cast<std::int64_t>(k));
  for (std::size_t c = 0; c < 3; ++c) {
    double least = HUGE_VAL, most = -HUGE_VAL;
    for (const Vector3& x : mesh.coordinates) {
      least = std::min(least, x[c]);
      most = std::max(most, x[c]);
    }
    extent_ = std::max(extent_, most - least);
  }
}

void Preload::solve(ShiftedSolver& solver, const Ports& inputs) {
  LoadValues others;
  for (const auto& entry : loads_)
    if (std::none_of(bolts_.begin(), bolts_.end(), [&](const Tightened& one) {
          return one.bolt->input == entry.first;
        }))
      others.push_back(entry);
  Block load = total_load(others, inputs);
  for (const Tightened& one : bolts_)
    load = concatenate(load, total_load({{one.bolt->input, 1.0}}, inputs));
  const Block u = solver.solve(load).x;
  const int count = static_cast<int>(bolts_.size());
  Dense shares(1 + count, 1);
  shares(0, 0) = 1;
  if (count > 0) { // forces of bolts by the shortenings of all
    const Dense work = inner(load, u);
    Dense stiffness(count, count);
    std::vector<std::string> names;
    std::vector<double> wanted;
    for (int i = 0; i < count; ++i) {
      const Pretension& bolt = *bolts_[as_size(i)].bolt;
      for (int j = 0; j < count; ++j)
        stiffness(i, j) = (i == j ? bolt.held : 0) - work(1 + i, 1 + j);
      if (!(stiffness(i, i) > 1e-6 * bolt.held))
        throw Error(text("preload: %s: nothing resists the shank, it shortens without "
                         "force: do both of its ends hold on to the body?",
                         bolt.input.c_str()));
      bolts_[as_size(i)].resisted = stiffness(i, i) / bolt.held;
      names.push_back(bolt.input);
      wanted.push_back(bolts_[as_size(i)].force * bolt.length);
    }
    const auto strains = shortenings(names, std::move(stiffness), wanted);
    for (int i = 0; i < count; ++i)
      shares(1 + i, 0) = bolts_[as_size(i)].strain = strains[as_size(i)];
  }
  const Block total = combine(u, shares);
  const Block::Access local(total);
  u_ = gathered<double>(total.comm(),
                        {local.column(0), as_size(total.local_rows().size())});
}

double Preload::speed() const {
  for (const Field& one : fields_)
    if (one.is_spin()) return std::sqrt(one.value);
  return 0;
}

Vector3 Preload::axis() const {
  for (const Field& one : fields_)
    if (one.is_spin()) return one.field->axis;
  return {};
}

Dense Preload::coriolis(const PlacedElement& at, const ElementMatrices& element) const {
  Dense G(element.M.rows, element.M.rows);
  for (const Field& one : fields_) {
    if (!one.is_spin()) continue;
    const Vector3& axis = one.field->axis;
    add_to(G, flexgram::coriolis(body_, at, element, axis), std::sqrt(one.value));
  }
  return G;
}

double Preload::at(std::int64_t node, int c) const {
  const PetscInt equation = map_.equation(node, c);
  return equation < 0 ? 0.0 : u_[as_size(equation)];
}

StressStiffness Preload::of_stress(const PlacedElement& at,
                                   const std::vector<double>& u) {
  const auto free = free_strain(at);
  return stress_stiffness(body_, at, u, free ? &*free : nullptr, deformation_);
}

std::optional<FreeStrain> Preload::free_strain(const PlacedElement& at) const {
  if ((temperature_.empty() && bolts_.empty()) || is_discrete(at.block().type))
    return std::nullopt;
  FreeStrain strain;
  const std::span nodes(at.nodes, at.x.size());
  bool any = false;
  if (!temperature_.empty())
    for (std::int64_t node : nodes)
      any |= strain.temperature.emplace_back(temperature_[as_size(node)]) != 0;
  if (!any) strain.temperature.clear();
  bool slopes = false;
  if (!gradient_.empty() && is_shell(at.block().type))
    for (std::int64_t node : nodes)
      slopes |= strain.gradient.emplace_back(gradient_[as_size(node)]) != 0;
  if (!slopes) strain.gradient.clear();
  any |= slopes;
  for (const auto& [bolt, force, shortened, resisted] : bolts_) {
    const auto& shank = bolt->nodes;
    if (!std::all_of(nodes.begin(), nodes.end(), [&](std::int64_t node) {
          return std::binary_search(shank.begin(), shank.end(), node);
        }))
      continue;
    any = true;
    const Vector3& n = bolt->axis;
    const std::array<double, 6> along = {n[0] * n[0],     n[1] * n[1],
                                         n[2] * n[2],     2 * n[0] * n[1],
                                         2 * n[1] * n[2], 2 * n[2] * n[0]};
    for (std::size_t r = 0; r < 6; ++r) strain.uniform[r] -= shortened * along[r];
  }
  return any ? std::optional(std::move(strain)) : std::nullopt;
}

Dense Preload::of_spin(const PlacedElement& at, const ElementMatrices& element) const {
  Dense K(element.M.rows, element.M.rows);
  for (const Field& one : fields_) {
    if (!one.is_spin()) continue;
    const Vector3& axis = one.field->axis;
    add_to(K, spin_softening(body_, at, element, axis), -one.value);
  }
  return K;
}

Dense Preload::weight(const PlacedElement& at, const ElementMatrices& element) const {
  Dense f(element.M.rows, 1);
  for (const auto& [field, number, value] : fields_)
    add_to(
        f,
        weight_of_element(*field, number, at.x, dofs_per_node(at.block().type), element),
        value);
  return f;
}

std::optional<double> fails_at(Mat K, Mat S, Mat Q, const std::vector<std::int64_t>& node,
                               const SolverOptions& options, int& negative) {
  std::vector<Mat> added{S};
  if (Q) added.push_back(Q);
  ShiftedSolver solver(K, nullptr, added, node, counting(options));
  solver.count_pivots(true);
  const auto negative_at = [&](double share) {
    try {
      std::vector<std::complex<double>> factors{share, share * share};
      factors.resize(added.size());
      solver.factorise({1.0, 0.0, std::move(factors)});
    } catch (const ShiftError&) {
      return 1;
    }
    return solver.negative_pivots();
  };
  negative = negative_at(1);
  if (negative == 0) return std::nullopt;
  double bears = 0, fails = 1;
  while (fails - bears > 0.01 * fails) {
    const double middle = 0.5 * (bears + fails);
    (negative_at(middle) > 0 ? fails : bears) = middle;
    if (fails < 1e-6) break;
  }
  return fails;
}

void Preload::expect_stable(Mat unloaded, Mat K, const std::vector<std::int64_t>& node,
                            const SolverOptions& options) const {
  Matrix added;
  FG_CALL(MatDuplicate(K, MAT_COPY_VALUES, added.out()));
  FG_CALL(MatAXPY(added, -1.0, unloaded, DIFFERENT_NONZERO_PATTERN));
  int negative = 0;
  const auto fails = fails_at(unloaded, added, nullptr, node, options, negative);
  if (!fails) return;
  const bool is_spin = spins() && loads_.size() == 1;
  throw Error(
      text("preload: the body does not bear it: under its stress K has %d negative "
           "eigenvalue%s (%s at about %.2g of %s)",
           negative, negative == 1 ? "" : "s",
           is_spin ? "a spin that tears it apart" : "buckled",
           is_spin ? std::sqrt(*fails) : *fails, is_spin ? "its speed" : "these loads"));
}

void Preload::tell(MPI_Comm comm, Observer& observer) const {
  std::string loads;
  for (const auto& [name, value] : loads_)
    loads += text("%s%s %g", loads.empty() ? "" : ", ", name.c_str(), value);
  for (const Tightened& one : bolts_) {
    loads += text(", %s shortens its shank by %.3g m", one.bolt->input.c_str(),
                  one.strain * one.bolt->length);
    constexpr double hardly = 0.05;
    if (one.resisted < hardly)
      observer.warn(text(
          "preload: %s: the body resists the shank with %.2g %% of the shank's own "
          "stiffness, so that it shortens %.0f times as far as between rigid ends: do "
          "both of its ends hold on to the body?",
          one.bolt->input.c_str(), 100 * one.resisted, 1 / one.resisted));
  }
  observer.fact(
      "preload",
      text("%s: displacement at most %.3g m, von Mises stress (of beams: axial) at "
           "most %.3g N/m²; K is that under this stress%s",
           loads.c_str(), max_over(comm, largest_), max_over(comm, deformation_.stress),
           spins() ? ", softened by the spin, whose Coriolis forces are G" : ""));
  warn_of_shape(comm, 1, observer);
}

void Preload::tell(MPI_Comm comm, const SpinRange& spin, Observer& observer) const {
  const double square = spin.most * spin.most;
  observer.fact("spin",
                text("%g to %g rad/s; at the most displacement at most %.3g m, von Mises "
                     "stress (of beams: axial) at most %.3g N/m²; seen in the frame %s",
                     spin.least, spin.most, square * max_over(comm, largest_),
                     square * max_over(comm, deformation_.stress),
                     spin.turning ? "that turns with the body, with its Coriolis forces"
                                  : "at rest, through which the body runs"));
  warn_of_shape(comm, square, observer);
}

void Preload::warn_of_shape(MPI_Comm comm, double share, Observer& observer) const {
  const double largest = share * max_over(comm, largest_),
               extent = max_over(comm, extent_),
               locked = sum_over(comm, deformation_.locked),
               energy = sum_over(comm, deformation_.energy);
  if (largest > 0.05 * extent)
    observer.warn(
        text("preload: it moves the body by %.3g m, which measures %.3g m: linear "
             "statics does not hold there; are the values in SI units?",
             largest, extent));
  const double excess = energy > 0 ? share * share * locked / energy : 0;
  if (excess > 0.02)
    observer.warn(
        text("preload: it bends elements by more than they can follow: on this mesh the "
             "shape that it bends is about %.2g %% too stiff (membrane locking); take "
             "elements that are shorter along it, or quadratic ones",
             100 * excess));
}

BodyDescription without_preload_loads(BodyDescription body) {
  const auto stays = [&](const auto& load) {
    const auto names = input_names(load);
    return std::any_of(body.preload.begin(), body.preload.end(), [&](const auto& entry) {
      return std::find(names.begin(), names.end(), entry.first) != names.end();
    });
  };
  std::erase_if(body.fields, stays);
  if (body.spin)
    std::erase_if(body.fields,
                  [&](const auto& field) { return field.name == body.spin->field.name; });
  std::erase_if(body.loads, stays);
  return body;
}

} // namespace flexgram
