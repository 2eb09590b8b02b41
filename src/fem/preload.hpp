/// Loads that stay on a body while it vibrates: the stress under them stiffens it or softens it.

#pragma once

#include "base/observer.hpp"
#include "fem/couplings.hpp"
#include "fem/mesh.hpp"

namespace flexgram {

/// The displacements under a preload, and what they add to the stiffness of elements: that of
/// stress, K_σ, and −Ω²M_c of a spin in the frame that turns with the body. Both are of first order
/// in the loads: displacements must be small, and pressure keeps its direction.
class Preload {
public:
  /// Solves K u = f.
  /// @param body    with preload and all loads.
  /// @param K       without stress.
  /// @param inputs  unit loads, among them those of the preload.
  /// @param node    of each local row.
  /// @throws Error if an input is unknown, or K is singular. Collective.
  Preload(const BodyDescription& body, const DofMap& map, Mat K, const Ports& inputs,
          const std::vector<std::int64_t>& node, const LocalMesh& mesh);

  /// Displacement of component c of a node that is no slave.
  double at(std::int64_t node, int c) const;
  /// K_σ − Ω²M_c of an element. @param u  of its dofs. @param M  of the element.
  Dense of_element(const MeshBlock& block, const std::vector<Vector3>& x,
                   const std::vector<double>& u, const Dense& M);
  /// @param K  under the preload.
  /// @throws Error if it has negative eigenvalues: the body buckles, or flies apart. Collective.
  static void expect_stable(Mat K, const std::vector<std::int64_t>& node);
  /// The loads, the largest displacement, and the largest stress met on any rank. Collective.
  void tell(MPI_Comm comm, Observer& observer) const;

private:
  struct Spin {
    double square; ///< Ω² [rad²/s²]
    Vector3 axis;
  };
  const BodyDescription& body_;
  const DofMap& map_;
  std::vector<double> u_; ///< of all equations
  std::vector<Spin> spins_;
  double largest_ = 0, stress_ = 0; ///< displacement [m], von Mises [N/m²]
};

/// The body without the loads that only its preload uses: they are no inputs.
BodyDescription without_preload_loads(BodyDescription body);

} // namespace flexgram
