#pragma once

#include "base/observer.hpp"
#include "fem/dof_map.hpp"
#include "linalg/shifted_solver.hpp"
#include "model/second_order_model.hpp"

#include <optional>

namespace flexgram {

/// What the assembly found on its way.
struct AssemblyFacts {
  std::int64_t elements = 0;
  double mass = 0;                 ///< [kg]
  std::int64_t rigid_elements = 0; ///< inside one rigid interface: mass only
  double worst_shape = 1; ///< smallest ratio of Jacobian determinants in an element
  double aspect = 1;      ///< of the thinnest element (ElementMatrices)
};

/// Reads the mesh of a body file, partitions it, assembles K and M in parallel, couples
/// the interfaces and applies the supports. Ports in the order of the interfaces: fx, fy,
/// fz, mx, my, mz each; outputs are the inputs.
/// @param solver  for the static solve of a preload.
/// @param stiffening  whether geometric stiffening for a floating frame is asked for.
/// @throws Error naming inverted elements, nodes in two interfaces, and so on.
/// Collective.
SecondOrderModel assemble_body(const Hdf5File& file, const SolverOptions& solver,
                               bool stiffening, AssemblyFacts& facts, Observer& observer);

} // namespace flexgram
