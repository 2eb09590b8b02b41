/// What a method for the small basis is, their table, and what they share. Called by cut
/// and order_choice; each file of methods/ defines one (CONTRIBUTING.md).

#pragma once

#include "basis/band_gramian.hpp"
#include "medium/model.hpp"

#include <functional>
#include <memory>
#include <string>
#include <vector>

namespace flexgram {

/// What the small bases are made from: the medium model and how they are asked to be.
struct SecondStage {
  const MediumModel& medium;
  std::vector<const MediumModel*> others; ///< with other values of the body's parameters
  std::vector<BandWeight> bands;          ///< [rad/s], with their weights
  bool equal_ports = true;
  /// The first basis vectors are to be the rigid modes, exactly; what keeps them apart
  /// anyway need not look.
  bool keep_rigid = true;
  Dense gram; ///< N×N inner product of the Gramian's eigenvectors, in coordinates of V
  std::vector<double> shifts; ///< [rad/s] of krylov
  int moments = 2;
  RelativeTo relative_to = RelativeTo::pointwise; ///< what errors are divided by
  double tolerance = 0; ///< an error that is good enough; 0: none is
  bool statics = false; ///< the static response to every port is to be in the basis
};

/// A way to span a small space: for every order m up to `most` a basis of m columns in
/// the coordinates of the medium model's V.
struct Candidate {
  std::string name;
  int least = 1, most = 0;
  bool nested = false; ///< basis(m) is the first m columns of basis(most)
  std::function<Dense(int)> basis;
  /// Of the position Gramian over the bands that the basis is made of (whole_axis: of its
  /// elastic part over all frequencies; balanced: Hankel singular values); else empty.
  std::vector<double> sigma;
  bool rigid_first = true; ///< the first vectors are the rigid modes
  std::string remark;
  /// Another candidate that is nested and needs no fewer vectors: where the search for an
  /// order starts, if each order of this one is costly.
  std::shared_ptr<const Candidate> no_fewer;
};

/// What a method asks of the medium model, beyond the band.
struct Demand {
  int modes = 0;          ///< so many modes, exactly
  double last_needed = 0; ///< [rad/s] the certificate must hold up to here
};

/// A method for the small basis. Each file of basis/methods defines one, with the file's
/// name; the table of all is made of them by CMake.
struct Method {
  const char* help; ///< a phrase for -help and the documentation
  Candidate (*make)(const SecondStage&);
  /// The order without tolerance and order; nothing: the paper's rule.
  int (*rule)(const Candidate&, const SecondStage&) = nullptr;
  /// Nothing: no more than the band.
  Demand (*demand)(int order, const std::vector<double>& shifts) = nullptr;
};

/// All methods by name.
const std::vector<std::pair<std::string, const Method*>>& methods();
/// @throws Error for a name that is none.
const Method& method(const std::string& name);
Candidate make_candidate(const std::string& name, const SecondStage& stage);
/// What all of them ask of the medium model.
Demand demand_of(const std::vector<std::string>& names, int order,
                 const std::vector<double>& shifts);

// ---- what methods share

/// Unit vectors first … N−1 of R^N.
Dense unit_vectors(int N, int first);
/// Unit vectors of the rigid modes, then the columns of `a`, which has the last rows.
Dense after_rigid(const Dense& a, int rigid, int N);
Dense all_ports(const DenseSystem& system); ///< B, and C where that is another
/// A candidate whose basis of order m is the first m columns of `all`.
Candidate nested(Dense all, int least = 1);
/// Orthonormal columns spanning those of A, dropping what adds less than 1e-10 (modified
/// Gram-Schmidt, twice): the span of the first columns stays nested.
Dense nested_span(const Dense& A);

/// Left singular vectors of F in the inner product G: G-orthonormal, descending.
struct WeightedSvd {
  Dense vectors;
  std::vector<double> sigma; ///< squares of the singular values
};
WeightedSvd weighted_svd(const Dense& F, const Dense& G);

/// The medium model without its rigid modes.
struct Elastic {
  explicit Elastic(const SecondStage& stage);
  /// K⁻¹ of all ports, count × ports: of a free body the elastic part of its response to
  /// constant loads.
  Dense statics() const;

  int rigid, N, count; ///< N = rigid + count
  DenseSystem system;
  Dense gram;
  DenseResponse response;
};

/// Eigenvectors of the position Gramian over the bands; where the rigid modes are kept
/// apart those of its elastic part. With parameters: of the sum of the Gramians.
/// @param bands  for the medium model, and for each of the others.
Candidate gramian_candidate(const SecondStage& stage,
                            const std::vector<std::vector<BandWeight>>& bands);
/// Eigenvectors of the position Gramian over the whole axis.
Candidate whole_axis_candidate(const SecondStage& stage);

} // namespace flexgram
