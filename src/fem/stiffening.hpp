#pragma once

#include "base/observer.hpp"
#include "fem/followers.hpp"
#include "fem/loads.hpp"
#include "linalg/shifted_solver.hpp"
#include "model/stiffening.hpp"

namespace flexgram {

/// Geometric stiffening of a body given by its mesh. A free body is held at an interface: forces
/// there balance each load, and make no stress of their own. Whatever balances loads, the stress of
/// all that act at once is the same.
class MeshStiffening : public Stiffening {
public:
  /// The static solves, with one factorisation.
  /// @param model  assembled of these. A free body is held at its first interface with six ports
  ///               (LoadMatrices::held_at changes it).
  /// @throws Error if the body is neither free nor held by its supports, if it has no such interface.
  /// Collective.
  MeshStiffening(BodyDescription body, DofMap map, LocalMesh mesh,
                 const SecondOrderModel& model, const SolverOptions& options,
                 Observer& observer);
  LoadMatrices project(const Basis& V) const override;

private:
  /// Of the loads first … first + count − 1.
  std::vector<Matrix> matrices(int first, int count, const Followers& followers) const;
  Block frame_loads(MPI_Comm comm);
  /// What the element weighs in the load, at its dofs.
  Dense weight(int load, const PlacedElement& at, const ElementMatrices& element) const;

  BodyDescription body_; ///< its fields are those that frame loads combine
  DofMap map_;
  LocalMesh mesh_;
  std::vector<std::string> names_; ///< of the loads; those of the frame come first
  Dense shares_;                   ///< of the fields' inputs in the frame's loads
  Block u_;                        ///< displacements under them
  std::vector<std::string> held_;  ///< ports that hold a free body
  Dense resultants_;               ///< of loads and these
};

} // namespace flexgram
