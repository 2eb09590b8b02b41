#pragma once

#include "reduce/band_gramian.hpp"
#include "reduce/medium_model.hpp"

#include <functional>

namespace flexgram {

/// What the small bases are made from: the medium model and how they are asked to be.
struct SecondStage {
  const MediumModel& medium;
  std::vector<BandWeight> bands; ///< [rad/s], with their weights
  bool equal_ports = true;
  bool keep_rigid = true; ///< the first basis vectors are the rigid modes, exactly
  Dense gram; ///< N×N inner product of the Gramian's eigenvectors, in coordinates of V
  std::vector<double> shifts; ///< [rad/s] of krylov
  int moments = 2;
};

/// A way to span a small space: for every order m up to `most` a basis of m columns in
/// the coordinates of the medium model's V.
struct Candidate {
  std::string name;
  int least = 1, most = 0;
  bool nested = false; ///< basis(m) is the first m columns of basis(most)
  std::function<Dense(int)> basis;
  std::vector<double> sigma; ///< eigenvalues of the position Gramian, if it is one
  std::string remark;
};

/// gramian: eigenvectors of the position Gramian over the band (the paper's second step);
/// gramian_modes: the modes of the band, then the Gramian of what they leave; weighted:
/// Gramian with the weight 1/‖H(ω)‖; whole_axis: eq. 5; balanced: position-velocity
/// balancing; irka; modal; craig_bampton; krylov; medium: all of it.
Candidate make_candidate(const std::string& name, const SecondStage& stage);

/// Names of all candidates.
const std::vector<std::string>& candidate_names();

} // namespace flexgram
