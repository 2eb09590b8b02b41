#pragma once

#include "base/plan.hpp"
#include "reduce/band_grid.hpp"
#include "reduce/certificate.hpp"
#include "reduce/port_views.hpp"

#include <memory>

namespace flexgram {

/// What an error of H is divided by.
enum class RelativeTo {
  pointwise, ///< ‖H(ω)‖_F at the same frequency: eq. (17) of the paper
  band       ///< the largest ‖H‖_F over the band
};

/// How the medium model is built.
struct MediumOptions {
  double cutoff = 1.2;
  int limit = 0;
  double target = 0; ///< 0: from the tolerance
  std::string relative_to = "pointwise";
  /// Certify displacements from forces and rotations from moments too.
  bool by_kind = false;

  void describe(Options& options);
  void check() const;
  RelativeTo relative() const;
};

/// A Galerkin model of some ten times the final order, and the proof of its error over
/// the band: what every small model is measured against.
class MediumModel {
public:
  struct Value {
    ComplexDense H;                         ///< n_out × n_in
    std::vector<Certificate::Bound> bounds; ///< of each of the views
  };
  Value at(double omega) const;
  struct Stretch {
    MatrixSeries H;                         ///< n_out × n_in
    std::vector<Certificate::Bound> bounds; ///< of each of the views, anywhere in it
  };
  /// @return nothing if a pole is too near for an interval of this length.
  std::optional<Stretch> over(Interval interval, int degree) const;

  /// A resonance in an excluded interval.
  struct Pole {
    double omega = 0;     ///< [rad/s] of the small model (of this one, if that has none)
    double frequency = 0; ///< the body's is no farther from it, relative
    /// ‖Σ cφφᵀb‖_F over the interval's modes, (K + τM)-normalised, differs from the
    /// body's by no more, relative.
    double residue = 0;
  };
  /// The small model's resonances in the intervals, and how far the body's may be from
  /// them: Kato's and Temple's way, from the residuals of the modes (docs/proof.md,
  /// section 4). Nothing with a damping matrix.
  std::vector<Pole> poles_within(const DenseSystem& small,
                                 const std::vector<Interval>& intervals) const;

  std::vector<PortView>
      views;          ///< blocks of H that are certified by themselves; the first is all
  Basis V;            ///< n × N, W-orthonormal: rigid modes, modes, Krylov vectors
  DenseSystem system; ///< with the body's inputs and outputs, in their units
  std::vector<Resonance> resonances; ///< of these modes
  std::vector<double> lambda; ///< [rad²/s²] elastic modes below the cutoff, all of them
  int rigid = 0;
  double cutoff = 0; ///< ω_c [rad/s]
  double tau = 0, kappa = 0;
  double worst = 0; ///< largest bound over the band, relative to ‖H‖_F
  double loss_of_orthogonality = 0;
  int factorisations = 0, solved_columns = 0;
  bool proved = true;

private:
  friend class MediumBuilder;
  std::shared_ptr<const DenseResponse> response_; ///< to all ports, scaled
  Certificate certificate_;
  std::vector<int> inputs_, outputs_;
  std::vector<Certificate::PortSet> blocks_; ///< the views by columns of all ports
  std::vector<double> scale_;
  Dense modal_outputs_; ///< N × n_out, in the units of the body
};

/// Builds the medium model:
///  1. K − ω_c²M = LDLᵀ: its inertia counts the modes below ω_c, its solves find them
///  (find_modes),
///     starting from the response to all ports, which is kept: a Krylov block.
///  2. K + τM = LLᵀ: the certificate solves with the basis of the residuals; if the bound
///  is not yet
///     below the target, these solutions are the next Krylov block.
/// Two real factorisations, never both alive. No complex one.
/// @param[in] bands        [rad/s] where the certificate is to meet the target.
/// @param[in] last_needed  [rad/s] the certificate must hold up to here (beyond the band
/// for
///                         Krylov shifts outside it).
/// @param[in] modes_wanted the cutoff is raised until so many modes lie below it; 0:
/// none.
/// @note Collective on fom.comm.
MediumModel medium_model(const SecondOrderModel& fom, const std::vector<Interval>& bands,
                         double last_needed, int modes_wanted, bool mass_is_singular,
                         const MediumOptions& options, double target,
                         const SolverOptions& solver, Plan& plan, Monitor& monitor);

} // namespace flexgram
