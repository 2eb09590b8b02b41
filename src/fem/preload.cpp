#include "fem/preload.hpp"

#include "base/index.hpp"
#include "base/text.hpp"
#include "linalg/shifted_solver.hpp"

#include <algorithm>
#include <cmath>

namespace flexgram {
namespace {

/// The first name of an input, of its load or interface.
std::string stem_of(const std::string& input) {
  return input.substr(0, input.rfind('.'));
}

/// Σ value · column of the inputs.
Block total_load(const BodyDescription& body, const Ports& inputs) {
  Dense shares(static_cast<int>(inputs.names.size()), 1);
  for (const auto& [name, value] : body.preload) {
    const auto found = std::find(inputs.names.begin(), inputs.names.end(), name);
    if (found == inputs.names.end())
      throw Error(text("preload: the body has no input %s, did you mean %s?",
                       name.c_str(), nearest(name, inputs.names).c_str()));
    shares(static_cast<int>(found - inputs.names.begin()), 0) = value;
  }
  return combine(inputs.B, shares);
}

/// A column of all ranks' rows, whole on every rank.
std::vector<double> gathered(const Block& x) {
  const MPI_Comm comm = x.comm();
  const auto mine = static_cast<int>(x.local_rows().size());
  std::vector<int> counts(as_size(comm_size(comm))), starts(counts.size(), 0);
  MPI_Allgather(&mine, 1, MPI_INT, counts.data(), 1, MPI_INT, comm);
  for (std::size_t r = 1; r < counts.size(); ++r)
    starts[r] = starts[r - 1] + counts[r - 1];
  std::vector<double> all(as_size(x.rows()));
  const Block::Access local(x);
  MPI_Allgatherv(local.column(0), mine, MPI_DOUBLE, all.data(), counts.data(),
                 starts.data(), MPI_DOUBLE, comm);
  return all;
}

/// −Ω²M_c of a solid: M sees the part of its motion across the axis.
void soften(Dense& K, double square, const Vector3& axis, const Dense& M) {
  Dense across(M.rows, M.rows);
  for (int i = 0; i < M.rows; ++i)
    for (int c = 0; c < 3; ++c)
      across(i, i - i % 3 + c) = (i % 3 == c) - axis[as_size(i % 3)] * axis[as_size(c)];
  Dense seen = multiply_transposed(across, multiply(M, across));
  symmetrise(seen);
  add_to(K, seen, -square);
}

} // namespace

Preload::Preload(const BodyDescription& body, const DofMap& map, Mat K,
                 const Ports& inputs, const std::vector<std::int64_t>& node,
                 const LocalMesh& mesh)
    : body_(body), map_(map) {
  const Block load = total_load(body, inputs);
  for (const AccelerationField& field : body.fields)
    for (const auto& [name, value] : body.preload) {
      if (stem_of(name) != field.name) continue;
      if (field.type == AccelerationField::Type::angular)
        throw Error(
            text("preload: %s: an angular acceleration does not last; take a spin",
                 name.c_str()));
      if (field.type != AccelerationField::Type::spin) continue;
      if (value < 0)
        throw Error(text("preload: %s = %g is the square of a speed, and negative",
                         name.c_str(), value));
      spins_.push_back({value, field.axis});
    }
  try {
    ShiftedSolver solver(K, nullptr, {}, node, SolverOptions());
    solver.factorise({1.0, 0.0});
    u_ = gathered(solver.solve(load).x);
  } catch (const ShiftError&) {
    throw Error(
        "preload: the body moves freely, and nothing holds it against its preload: "
        "it needs supports");
  }
  for (std::int64_t node_here : mesh.nodes) {
    if (map.reference[as_size(node_here)] >= 0) continue;
    double square = 0;
    for (int c = 0; c < 3; ++c) square += std::pow(at(node_here, c), 2);
    largest_ = std::max(largest_, std::sqrt(square));
  }
}

double Preload::at(std::int64_t node, int c) const {
  const PetscInt equation = map_.equation(node, c);
  return equation < 0 ? 0.0 : u_[as_size(equation)];
}

Dense Preload::of_element(const MeshBlock& block, const std::vector<Vector3>& x,
                          const std::vector<double>& u, const Dense& M) {
  const Material& material = body_.materials.at(block.material);
  if (block.type != ElementType::beam2) {
    Dense K = solid_stress_stiffness(block.type, x, material.solid, u, stress_);
    for (const auto& [square, axis] : spins_) soften(K, square, axis, M);
    return K;
  }
  const BeamSection& section = body_.sections.at(block.section);
  Dense K = beam_stress_stiffness(x[0], x[1], material.beam, section, u, stress_);
  for (const auto& [square, axis] : spins_)
    add_to(K, beam_spin_softening(x[0], x[1], material.beam, section, axis), -square);
  return K;
}

void Preload::expect_stable(Mat K, const std::vector<std::int64_t>& node) {
  ShiftedSolver solver(K, nullptr, {}, node, counting(SolverOptions()));
  solver.count_pivots(true);
  solver.factorise({1.0, 0.0});
  const int negative = solver.negative_pivots();
  if (negative > 0)
    throw Error(
        text("preload: the body does not bear it: under its stress K has %d negative "
             "eigenvalue%s (buckled, or a spin that tears it apart)",
             negative, negative == 1 ? "" : "s"));
}

void Preload::tell(MPI_Comm comm, Observer& observer) const {
  std::string loads;
  for (const auto& [name, value] : body_.preload)
    loads += text("%s%s %g", loads.empty() ? "" : ", ", name.c_str(), value);
  observer.fact(
      "preload",
      text("%s: displacement at most %.3g m, von Mises stress at most %.3g N/m²; "
           "K is that under this stress%s",
           loads.c_str(), max_over(comm, largest_), max_over(comm, stress_),
           spins_.empty() ? "" : ", softened by the spin, without Coriolis forces"));
}

BodyDescription without_preload_loads(BodyDescription body) {
  const auto stays = [&](const auto& load) {
    return std::any_of(body.preload.begin(), body.preload.end(), [&](const auto& entry) {
      return stem_of(entry.first) == load.name;
    });
  };
  std::erase_if(body.fields, stays);
  std::erase_if(body.loads, stays);
  return body;
}

} // namespace flexgram
