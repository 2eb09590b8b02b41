#pragma once

#include "model/error_form.hpp"
#include "model/frame_integrals.hpp"
#include "model/parameters.hpp"
#include "model/second_order_model.hpp"

#include <array>
#include <optional>
#include <utility>

namespace flexgram {

/// What is claimed of the error everywhere in the bands.
struct BandClaim {
  double worst = 0;    ///< largest relative error, of H and of each kind of ports
  double attained = 0; ///< the bound at one frequency: `worst` is no less than this
  double at = 0;       ///< [rad/s] that frequency
  std::vector<std::string> parameters; ///< of the body
  std::vector<ParameterValues> values; ///< of them, with which the claim holds
  ParameterValues at_values;           ///< those of `attained`
  /// Largest error of H as a whole seen with values between them, at frequencies.
  std::optional<double> between;
  /// Largest relative errors with all values of the box, of H and of each kind of ports; none: it
  /// is not proved.
  std::vector<double> of_all_values;
  int cells_between = 0; ///< of (ω, p) that were looked at for it
  double whole = 0;      ///< largest relative error of H as a whole
  /// Change of H, relative to all of H, if the stiffness of rigid modes in the stored K, which
  /// counts as rounding, were real. Not in `worst`: the claim is of a body that is exactly rigid there.
  double rigid_rounding = 0;
  /// Largest relative change of H by the rounding of K's entries when they were printed, an
  /// estimate, and where [rad/s]. Not in `worst`: the claim is of the stored matrices.
  double data_rounding = 0, data_rounding_at = 0;
  std::string relative_to = "pointwise";
  std::vector<std::array<double, 2>> bands;    ///< [rad/s]
  std::vector<std::array<double, 2>> excluded; ///< [rad/s] where nothing is claimed
  /// Resonances in these: frequency [rad/s], how far the body's is from it at most,
  /// relative, and how far its residue, relative. Empty with a damping matrix.
  std::vector<std::array<double, 3>> poles;
  /// [rad/s] where the tolerance is not met, outside `excluded`; empty if it is, or where
  /// nothing is proved.
  std::vector<std::array<double, 2>> unmet;
  std::optional<double> tolerance; ///< that was asked for
  bool met = true;                 ///< it is
};

/// What is claimed of the field that some inputs cause, in the norm of the strain energy.
struct FieldClaim {
  std::string inputs;  ///< their kind, or "all ports"
  double worst = 0;    ///< largest relative error everywhere in the bands
  double attained = 0; ///< the bound at one frequency
  double at = 0;       ///< [rad/s] that frequency
  bool proved = true;
};

/// Loads that a body was reduced for, instead of each input by itself: combinations of its
/// inputs, P. What is claimed is of PᵀHP, the motion along them in answer to any in their
/// span, relative to all of it; of HP where the outputs are not the inputs.
struct LoadSpan {
  Dense patterns; ///< n_in × k
  std::vector<std::string> names;
};

/// A free body held at one interface, without damping, against the medium model.
struct HeldInterface {
  std::string interface;
  /// [rad/s] of the reduced body and of the medium model; infinite where there is none.
  std::vector<std::array<double, 2>> omega;
  /// Largest relative error of the static displacement or rotation of a port in answer to its
  /// own load, and that port; none: all ports are held.
  std::optional<double> compliance;
  std::string port;
  /// Largest relative error of these frequencies.
  double frequency_error() const;
};

/// The error at frequencies.
struct ErrorCurve {
  std::vector<double> omega;         ///< [rad/s]
  std::vector<double> error;         ///< relative there, eq. (17) of the paper
  std::vector<double> bound;         ///< proved upper bound of it; empty: none
  std::vector<double> floor;         ///< its part that is rounding
  std::vector<double> data_rounding; ///< (BandClaim); empty: K was not printed
};

/// The error of one kind: of displacements from forces, of rotations from moments and so on.
struct KindClaim {
  std::string name;
  double worst = 0; ///< largest bound in the bands
  /// What its error is relative to where its response is smaller, in the unit of that.
  double least = 0;
};

/// What is claimed of a reduced body's error.
struct Claim {
  /// Certified, everywhere in the bands; certified outside the excluded intervals; or
  /// estimated.
  std::string kind = "estimated";
  double band[2] = {0, 0}; ///< [rad/s]
  ErrorCurve curve;
  std::optional<BandClaim> supremum;   ///< none: nothing is known between the frequencies
  std::vector<KindClaim> by_kind;      ///< empty: not asked for
  std::vector<double> kind_tolerances; ///< of each; empty: all the same
  std::vector<FieldClaim> fields;      ///< empty: not asked for
  std::vector<HeldInterface> held;     ///< of a free body
  std::optional<ErrorForm> form;       ///< none: the claim is all that is known
  std::optional<LoadSpan> loads;       ///< none: each input by itself
};

/// The frame of reference of a reduced body.
struct Frame {
  std::string kind = "none";
  std::string interface; ///< that it follows, or that was asked for; empty: none
  int rigid_modes = 0;   ///< of the body; the first basis vectors unless the kind is none
  std::optional<FrameIntegrals> integrals;
};

/// How a reduced body was made.
struct Provenance {
  std::string method, second_stage;
  int factorisations = 0;
  /// What was done and what was skipped, as printed: name and value.
  std::vector<std::pair<std::string, std::string>> plan;
  int medium_order = 0; ///< of the model that it was cut from; 0: none
};

/// A reduced body, of the parts that its file has groups for and Python attributes.
struct ReducedModel {
  SecondOrderModel system; ///< dense and the same on every rank
  Block V;                 ///< the basis, n × m, rows over the ranks of the world
  Claim claim;
  Frame frame;
  Provenance provenance;
  std::vector<double> sigma; ///< eigenvalues of the position Gramian, descending
  std::vector<double> modes; ///< [rad/s], undamped eigenfrequencies of the reduced body
};

} // namespace flexgram
