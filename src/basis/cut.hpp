/// The second of two steps: a small body out of a certified medium model (Fehr, Eberhard,
/// Lehner, section 2.3). Called by run/reduce and, through it, by Python.

#pragma once

#include "basis/band_gramian.hpp"
#include "medium/medium.hpp"
#include "model/reduced_model.hpp"
#include "model/spec.hpp"

namespace flexgram {

/// Frame of reference of a free body's basis.
enum class FrameKind {
  automatic, ///< buckens if the body is free
  none,      ///< rigid motion mixed into the basis
  buckens,   ///< basis vectors orthogonal to the rigid modes, which come first
  tangent    ///< at rest at an interface
};

/// What a small body is asked to be.
struct CutRequest {
  std::string name = "two_step";    ///< of the method, for the file
  std::vector<std::string> methods; ///< of basis/method to try; empty: those of auto
  OrderSpec order;
  double medium_target = 0;     ///< of the medium model's error; 0: by the tolerance
  std::vector<Interval> bands;  ///< [rad/s]; empty: those of the medium model
  BandWeight weight;            ///< of the Gramian; empty: 1 over the bands
  Metric metric = Metric::mass; ///< in which the Gramian's eigenvectors are orthonormal
  bool equal_ports = true;      ///< every port weighs the same in the Gramian
  bool statics = false;         ///< the static response to every port is in the basis
  std::vector<double> shifts;   ///< [rad/s] of krylov; empty: ends and middle of the band
  int moments = 2;              ///< of krylov, at each shift
  FrameKind frame = FrameKind::automatic;
  std::string frame_interface; ///< of tangent; empty: the first with six ports
  RelativeTo relative_to = RelativeTo::both;
  bool field = false; ///< the error of the field in the energy norm is to be known too
  std::vector<double> error_omega;          ///< [rad/s] further frequencies of the curve
  std::vector<std::string> inputs, outputs; ///< ports to keep; empty: all
};

/// The methods that are tried where none is named: by a tolerance or an order, and by the
/// paper's rule.
std::vector<std::string> automatic_methods(const OrderSpec& order);
/// Expansion points over the bands: both ends and the middle.
std::vector<double> default_shifts(const std::vector<Interval>& bands);
/// The medium model's error that small models of this order ask for.
double medium_target(const OrderSpec& order);

/// The second step (Fehr, Eberhard, Lehner, section 2.3, with a proof): a small body out
/// of the certified medium model, by the position Gramian or another method, at the
/// smallest order whose certified error meets the tolerance. Dense work; the body itself
/// is not needed.
/// @throws Error if the medium model holds too little for the request, and what to
/// certify.
/// @note Collective on medium.body.comm.
ReducedModel cut(const Medium& medium, const CutRequest& request, Observer& observer);

} // namespace flexgram
