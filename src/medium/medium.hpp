/// The first of two steps: a certified medium model (docs/proof.md; Fehr, Eberhard,
/// Lehner, section 2.3, with real shifts). Made by run/reduce, stored by medium_io, used
/// by basis/cut.

#pragma once

#include "base/observer.hpp"
#include "medium/certificate.hpp"
#include "model/band_grid.hpp"
#include "model/frame_integrals.hpp"

#include <memory>
#include <optional>
#include <string>

namespace flexgram {

/// What is to be certified.
struct CertifySpec {
  std::vector<Interval> bands; ///< [rad/s] where the target is to be met
  double last_needed = 0;      ///< [rad/s] the certificate must hold up to here at least
  double target = 1e-8;        ///< relative error of the medium model
  double cutoff = 1.1;         ///< ω_c over the end of the last band
  int modes = 0;               ///< so many modes at least are found, and exactly; 0: any
  int limit = 0;               ///< largest order; 0: what memory and the body allow
  RelativeTo relative_to = RelativeTo::both;
  KindSpec kinds = {}; ///< judged by themselves too
  /// Of the body's parameters, at which the target is to be met; empty: it has none.
  std::vector<ParameterValues> values = {};
  std::vector<ParameterValues> between = {}; ///< others, at which errors are looked at
  bool keep_levels = true; ///< all of them, for later cuts; else only the last one
};

/// The medium space after some blocks of growth, its first columns, and the proof of the
/// Galerkin model on it.
struct MediumLevel {
  std::shared_ptr<const DenseResponse> response; ///< to all ports, scaled
  std::shared_ptr<const Certificate> certificate;
  bool complete = true; ///< the certificate knows all that residuals are made of
  double worst = 0;     ///< largest relative bound at the frequencies it was judged at
  bool proved = true;

  int order() const { return response->system().order(); }
  /// The level with other values of the parameters. @param values  empty: as they are.
  MediumLevel at(const ParameterValues& values) const {
    if (values.empty()) return *this;
    MediumLevel other = *this;
    other.response = std::make_shared<const DenseResponse>(response->at(values));
    other.certificate =
        std::make_shared<const Certificate>(certificate->at(*other.response));
    return other;
  }
  /// The level whose responses need no finer rounding than that.
  MediumLevel to_rounding(double negligible) const {
    if (response->system().negligible == negligible) return *this;
    MediumLevel other = *this;
    other.response =
        std::make_shared<const DenseResponse>(response->to_rounding(negligible));
    return other;
  }
  /// Whether the bound meets `target` at the frequencies where it was judged. Without a proof only
  /// with a margin of a thousand: strong dampers rule out a proof, however large the space is.
  bool serves(double target) const {
    return complete && worst <= target && (proved || worst <= 1e-3 * target);
  }
};

/// Where a body with terms has its poles, and how wide their peaks are.
std::vector<Resonance> poles_below(const DenseResponse& response, double cutoff);

class SeenLevels;
std::shared_ptr<SeenLevels> no_level_seen();

/// A certified medium model, without the body's matrices: what any number of small
/// models are cut from. A looser tolerance takes an earlier level, so that the result
/// does not depend on what else was asked for.
struct Medium {
  SecondOrderModel body; ///< names, damping and dof map; no matrices
  CertifySpec spec;
  Basis V;       ///< n × N, W-orthonormal: rigid modes, modes, Krylov vectors; or empty
  int rigid = 0; ///< that many columns come first
  int modes = 0; ///< elastic modes below the cutoff, all of them
  double cutoff = 0;    ///< ω_c [rad/s]
  double reference = 0; ///< [rad/s] the certificate holds up to here
  double tau = 0;       ///< [rad²/s²] modes of small systems are (K + τM)-orthonormal
  double kappa = 0;     ///< W = M + κK
  std::vector<double> scale; ///< of each port, inputs first
  std::vector<MediumLevel> levels;
  std::string shortfall; ///< why the target is not reached; empty: it is
  double loss_of_orthogonality = 0;
  double printed_rounding = 0; ///< of K's entries, relative; 0: they do not look printed
  int factorisations = 0, solved_columns = 0;
  std::optional<FrameIntegrals> integrals; ///< of V
  /// What cuts have evaluated of the levels, for the next one.
  std::shared_ptr<SeenLevels> seen = no_level_seen();

  /// "certified to 2e-08", or how far it is from that.
  std::string claim() const;
  /// Intervals beside them are excluded from the claim.
  bool has_sharp_resonances() const;
  /// Undamped frequencies and half widths of the modes below the cutoff.
  std::vector<Resonance> resonances(const MediumLevel& level) const;
};

/// Elastic modes below the cutoff, without damping and terms.
struct NaturalFrequencies {
  std::vector<double> omega; ///< [rad/s] ascending
  /// The body's are lower by no more, relative, and higher by no more than the rounding that this
  /// has too (docs/proof.md, section 4).
  std::vector<double> error;
};
NaturalFrequencies natural_frequencies(const Medium& medium);

/// `both` is `pointwise` for a body without rigid modes, and for one with a damping matrix,
/// which mixes rigid and elastic motion; else what was asked for.
/// Of responses, relative: what does not count beside a bound of the medium model, a power of ten.
double negligible_rounding(double target);

RelativeTo resolved(RelativeTo asked, const Medium& medium);

/// @throws Error if the band of a body with rigid modes starts at 0 Hz.
void refuse_statics_of_a_free_body(double first);

/// Builds the medium model:
///  1. K − ω_c²M = LDLᵀ: its inertia counts the modes below ω_c, its solves find them
///     (find_modes), starting from the response to all ports, which is kept: a Krylov
///     block.
///  2. The certificate solves with the basis of the residuals; if the bound is not yet
///     below the target, these solutions are the next Krylov block.
/// One real factorisation (two more for slow modes of a body without coordinates; more if
/// a mode lies on the cutoff). No complex one.
/// Checkpoints are written after the search of the modes and after each level.
/// @throws Interrupted after one of these if SIGTERM asked to end.
/// @note Collective on body.comm.
Medium certify(const SecondOrderModel& body, bool mass_is_singular,
               const CertifySpec& spec, const SolverOptions& solver, Observer& observer,
               const CheckpointSpec& checkpoint = {});

} // namespace flexgram
