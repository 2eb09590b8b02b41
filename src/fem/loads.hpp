/// Loads beside those at the interfaces, and outputs beside the interfaces' motion.

#pragma once

#include "fem/couplings.hpp"
#include "fem/mesh.hpp"

namespace flexgram {

/// Names of the inputs of a load.
std::vector<std::string> input_names(const AccelerationField& field);
std::vector<std::string> input_names(const NodalVectors& load);

/// What an element weighs in a field of acceleration, for a unit of input `number` of it.
/// @param M  of the element, `dofs` rows a node. @return forces at its dofs.
Dense weight_of_element(const AccelerationField& field, int number,
                        const std::vector<Vector3>& x, int dofs,
                        const ElementMatrices& element);

/// Vectors over all equations that are summed node by node on the rank that has the
/// node's element, whatever rank owns its rows.
class NodalSums {
public:
  NodalSums(MPI_Comm comm, const DofMap& map, const LocalMesh& mesh,
            std::vector<std::string> names, HeldForces held = {});

  /// A force at a node, and a moment that only nodes with rotations take. What follows others
  /// hands it on to these.
  void add(int column, std::int64_t node, const Vector3& force,
           const Vector3& moment = {0, 0, 0});
  /// Collective.
  Ports take();

private:
  MPI_Comm comm_;
  const DofMap& map_;
  const LocalMesh& mesh_;
  std::vector<std::string> names_;
  HeldForces held_;
  std::vector<Handle<Vec>> sums_;
};

/// Fields of acceleration a(x), each a load M a: what the body's mass weighs in them.
class FieldLoads {
public:
  FieldLoads(MPI_Comm comm, const BodyDescription& body, const DofMap& map,
             const LocalMesh& mesh, HeldForces held);
  bool any() const { return !columns_.empty(); }
  /// @param element  with M and what is beside it, `dofs` rows a node.
  void add_element(const std::int64_t* nodes, const std::vector<Vector3>& x, int dofs,
                   const ElementMatrices& element);
  Ports take() { return sums_.take(); }

private:
  struct Column {
    const AccelerationField* field;
    int axis;
  };
  std::vector<Column> columns_;
  NodalSums sums_;
};

/// Loads or outputs given by vectors at nodes. Collective.
Ports nodal_ports(MPI_Comm comm, const std::vector<NodalVectors>& all, const DofMap& map,
                  const LocalMesh& mesh, const Partition& partition,
                  HeldForces held = {});

} // namespace flexgram
