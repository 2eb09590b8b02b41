#pragma once

#include "base/observer.hpp"
#include "model/second_order_model.hpp"

namespace flexgram {

/// What the checks found out about a sound body.
struct BodyFacts {
  int rigid_modes = 0; ///< eigenvalues of (K, M) that are zero to working accuracy
  bool mass_is_singular = false;    ///< massless rows (more may hide in a consistent M)
  std::vector<std::string> skipped; ///< checks not needed, and why
  /// For the factorisations to come, if checks needed one.
  std::shared_ptr<const PivotOrder> order;
};

/// Refuses what no method can reduce: rows that are zero in both K and M, negative
/// diagonals, M, D or K with a negative eigenvalue, a mechanism (K and M share a null
/// vector), ports without load. Counts the rigid modes. Parallel ports only warn.
/// @param stiffness  factorise K + τM for a mechanism and K for its rigid modes; methods
///                   that factorise them anyway do without.
/// @param assembled  the program assembled K and M itself: definite by construction, so
///                   the factorisations of M and D are skipped.
/// @throws Error naming the matrix and the dof. Collective on model.comm.
BodyFacts check_body(const SecondOrderModel& model, bool assembled, bool stiffness,
                     const SolverOptions& options, Observer& observer);

/// That K and M share so many null vectors, and why they may.
std::string words_of_shared_null_vectors(int count);

} // namespace flexgram
