/// Loads that stay on a body while it vibrates: the stress under them stiffens it or softens it.

#pragma once

#include "base/observer.hpp"
#include "fem/followers.hpp"
#include "fem/loads.hpp"
#include "linalg/shifted_solver.hpp"

#include <optional>

namespace flexgram {

/// The displacements under a preload, and what they and the loads add to the stiffness of elements:
/// that of stress and moved geometry, and −Ω²M_c of a spin in the frame that turns with the body,
/// where Coriolis forces act. Displacements must be small, and loads keep their direction.
class Preload {
public:
  /// Solves K u = f.
  /// @param body    with all loads; outlives this.
  /// @param loads   inputs, and how much of each.
  /// @param K       without stress.
  /// @param inputs  unit loads, among them those of the preload.
  /// @param node    of each local row.
  /// @throws Error if an input is unknown or cannot last, if there are two spins, if K is singular.
  /// Collective.
  Preload(const BodyDescription& body, LoadValues loads, const DofMap& map, Mat K,
          const Ports& inputs, const std::vector<std::int64_t>& node,
          const LocalMesh& mesh, const SolverOptions& options);

  /// Displacement of component c of a node that is no slave.
  double at(std::int64_t node, int c) const;
  /// What an element's stress and moved geometry add to its K. @param u  of its dofs.
  StressStiffness of_stress(const PlacedElement& at, const std::vector<double>& u);
  /// −Ω²M_c of an element.
  Dense of_spin(const PlacedElement& at, const ElementMatrices& element) const;
  /// Coriolis forces of an element where the preload spins, skew.
  Dense coriolis(const PlacedElement& at, const ElementMatrices& element) const;
  double speed() const; ///< [rad/s] of the spin; 0: there is none
  Vector3 axis() const; ///< of it
  /// What the element weighs in the preload's fields of acceleration, at its dofs.
  Dense weight(const PlacedElement& at, const ElementMatrices& element) const;
  /// @param K  under the preload.
  /// @throws Error if it has negative eigenvalues: the body buckles, or flies apart, and at which
  /// share of the load (between it and none, K is taken as linear). Collective.
  void expect_stable(Mat unloaded, Mat K, const std::vector<std::int64_t>& node,
                     const SolverOptions& options) const;
  /// The loads, the largest displacement, and the largest stress met on any rank. Collective.
  void tell(MPI_Comm comm, Observer& observer) const;
  /// The same of a spin whose speeds are known between two numbers; this is it at 1 rad/s.
  void tell(MPI_Comm comm, const SpinRange& spin, Observer& observer) const;

private:
  struct Field {
    const AccelerationField* field;
    int number; ///< of the input
    double value;
    bool is_spin() const { return field->type == AccelerationField::Type::spin; }
  };
  /// A bolt, and by how much it shortens, relative to its length.
  struct Tightened {
    const Pretension* bolt;
    double force, strain;
    double resisted = 1; ///< stiffness of the body against the shank, over the shank's
  };
  bool spins() const { return speed() > 0; }
  /// Solves for the displacements u_, of bolts with the shortening that gives their forces.
  void solve(ShiftedSolver& solver, const Ports& inputs);
  /// Strain without stress of an element: of temperatures and bolts.
  std::optional<FreeStrain> free_strain(const PlacedElement& at) const;
  /// Of displacements beyond linear statics, and of locking. @param share  of the loads.
  void warn_of_shape(MPI_Comm comm, double share, Observer& observer) const;
  const BodyDescription& body_;
  LoadValues loads_;
  const DofMap& map_;
  std::vector<double> u_; ///< of all equations
  std::vector<Field> fields_;
  std::vector<double> temperature_; ///< of nodes [K]; empty: as without stress
  std::vector<double> gradient_;    ///< of nodes, along normals [K/m]; empty: none
  std::vector<Tightened> bolts_;
  double largest_ = 0; ///< displacement [m]
  Deformation deformation_;
  double extent_ = 0; ///< of the nodes here [m]
};

/// The share of loads, to a hundredth, with which K + share·S + share²·Q has negative eigenvalues,
/// as many as `negative` with all of them. @return nothing if it has none. @param Q  null: none.
/// Collective.
std::optional<double> fails_at(Mat K, Mat S, Mat Q, const std::vector<std::int64_t>& node,
                               const SolverOptions& options, int& negative);

/// The body without the loads that only its preload uses: they are no inputs.
BodyDescription without_preload_loads(BodyDescription body);

} // namespace flexgram
