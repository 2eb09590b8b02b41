/// A level of a medium model seen by some ports: what small models are measured against.
/// Made by basis/cut and level_judge.cpp.

#pragma once

#include "medium/medium.hpp"
#include "medium/term_gram.hpp"
#include "medium/transfer_series.hpp"
#include "model/port_views.hpp"

#include <cmath>

namespace flexgram {

/// CᵀX over an interval: its entries, or, with many ports and without a damping
/// matrix, the factors of its modes, H = Σ_i f_i c_i b_iᵀ. Without rigid modes, if H has an
/// elastic part: small models have the same ones.
struct TransferSeries {
  MatrixSeries entries; ///< n_out × n_in
  double size = 0;      ///< of all of H at the centre, if there are entries
  MatrixSeries factors; ///< N × 1
  bool has_many_ports() const { return factors.columns > 0; }
};

/// @throws Error: of a free body with a damping matrix.
[[noreturn]] void refuse_elastic_part();

/// What a level shows of itself to some ports, in numbers.
struct SeenSystem {
  std::vector<PortView>
      views; ///< blocks of H that are certified by themselves; the first is all
  std::vector<std::string> zero_views; ///< those that are nothing but rounding
  SecondOrderModel names;              ///< body and ports, without matrices
  /// In modal coordinates, M-normalised (massless ones (K + τM)-normalised), rigid modes
  /// first; inputs and outputs in their units. There energies do not cancel.
  DenseSystem system;
  std::vector<Resonance> resonances;
  std::vector<double> lambda; ///< [rad²/s²] elastic modes below the cutoff, all of them
  int rigid = 0;
  double cutoff = 0; ///< ω_c [rad/s]
  double tau = 0, kappa = 0;
};

/// A level of a medium model seen by some of its ports: a Galerkin model of some ten
/// times the final order, and the proof of its error. What small models are measured
/// against.
class MediumModel : public SeenSystem {
public:
  /// @param enough  with many ports, relative errors of H up to this need no sharper bound;
  /// 0: the medium model's target.
  /// @param values  of the parameters; empty: those that the body has.
  /// @param negligible  rounding of responses; 0: as the medium model's target needs.
  /// @throws Error if errors are to be relative to the elastic part of H and a damping
  /// matrix leaves no such part.
  MediumModel(const Medium& medium, std::size_t level, const PortSelection& ports,
              const KindSpec& kinds, RelativeTo relative_to, double enough = 0,
              const ParameterValues& values = {}, double negligible = 0);

  struct Stretch {
    TransferSeries H;
    std::vector<ViewNorms> size; ///< of each of the views: of H, or its elastic part
    std::vector<double> whole;   ///< ‖H‖ of each view at least
    /// The same, anywhere in it; the floor with that of the rigid part, which is as small
    /// relative to ‖H‖ as it counts beside `size`.
    std::vector<Certificate::Bound> bounds;
  };
  /// @param hopeless  with many ports, relative bounds above this need not be sharp.
  /// @return nothing if a pole is too near for an interval of this length.
  std::optional<Stretch> over(Interval interval, int degree,
                              double hopeless = HUGE_VAL) const;
  /// H of it alone.
  std::optional<TransferSeries> response(Interval interval, int degree) const;
  /// Entries of H, however many. @param from  of modes from this one on.
  std::optional<MatrixSeries> entries(Interval interval, int degree, int from) const;
  /// Factors of all modes. @pre has_many_ports()
  std::optional<MatrixSeries> factors(Interval interval, int degree) const;
  /// So many first modes are no part of a TransferSeries.
  int apart() const { return has_elastic_part() ? rigid : 0; }
  /// At one frequency. @throws ShiftError at an undamped resonance.
  Stretch at(double omega, double hopeless = HUGE_VAL) const {
    return known(over({omega, omega}, 0, hopeless));
  }
  /// CᵀX of modes from this one on; `outputs` makes H of it.
  ComplexDense transfer(double omega, int from = 0) const;
  /// What H holds beside CᵀX. H_r holds the same.
  const OutputForm& outputs() const { return ports_.form; }
  bool is_resonance(double omega) const { return level_.response->is_resonance(omega); }
  /// Whether H has an elastic part: no damping matrix mixes it with rigid motion.
  bool has_elastic_part() const { return level_.response->is_diagonal(); }
  /// ‖H‖ of all ports at a frequency over that of its elastic part. @pre has_elastic_part()
  double whole_over_elastic(double omega) const;

  /// Whether norms come from the terms of H, (N + m)² products each, not from its entries.
  bool has_many_ports() const { return !many_.terms.empty(); }
  /// Terms of H − H_r for a view of a small model: those of the medium model, then those of
  /// the small one. @pre has_many_ports()
  TermGram terms_of_difference(std::size_t view, const DenseResponse& small) const;

  /// The field that some inputs cause over an interval, in coordinates whose squares add up
  /// to twice the strain energy: ‖x‖_F = ‖V U x‖_K. And what is known of the body's.
  struct Field {
    MatrixSeries x;   ///< N × inputs
    double error = 0; ///< ‖X − V U x‖_K at most, anywhere in it
    double floor = 0; ///< rounding
    bool proved = true;
  };
  /// A damping matrix leaves no bound of the field (docs/proof.md, section 4).
  bool claims_field() const { return level_.response->is_diagonal(); }
  /// Of some inputs, made once for many intervals.
  struct FieldLoads {
    Certificate::FewResiduals residuals;
    std::vector<double> strain; ///< √(uᵀKu) of each mode
  };
  FieldLoads field_loads(const std::vector<int>& inputs) const;
  /// @return nothing if a pole is too near for an interval of this length.
  std::optional<Field> field(Interval interval, int degree, const FieldLoads& of) const;
  /// Columns of Q in these coordinates. @param Q  rows: coordinates of `system`.
  Dense strain_coordinates(const Dense& Q) const;

  /// What is known of the error beyond its norm; nothing with a damping matrix, for what is
  /// not proved, or where it is too much to keep.
  std::optional<ErrorForm> error_form() const;

  /// What A couples `system` to in the rest of the body; ports: inputs, then outputs if they are
  /// others.
  Certificate::Couplings couplings() const;

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
  /// Takes the resonances from the poles: strong dampers move the peaks.
  void follow_dampers();
  /// Coordinates of V from those of `system`.
  Dense in_V(const Dense& Q) const { return multiply(to_V_, Q); }
  /// The vectors of the body with coordinates Q in `system`; no columns if the medium model is
  /// kept without V.
  Block lift(const Dense& Q) const;
  /// VᵀV in the coordinates of `system`.
  Dense euclidean_gram() const;

  /// The views by columns of all ports.
  const std::vector<Certificate::PortSet>& blocks() const { return ports_.blocks; }
  /// Of each view so many first modes, rigid ones, are no part of what errors are relative to.
  std::vector<int> left_out() const;
  /// Errors of a kind of ports are relative to this where its response is smaller, in its unit:
  /// 1e-8 of what its inputs and its outputs answer to themselves. 0 of all ports together.
  double least_size(std::size_t view) const { return reference_[view].least; }

private:
  void choose_references(const std::vector<Interval>& bands, RelativeTo relative_to);
  bool is_zero(const PortView& view, const std::vector<Interval>& bands, int from) const;
  double own_size(const PortView& view, const std::vector<Interval>& bands,
                  int from) const;
  std::vector<double> strain() const; ///< √(uᵀKu) of each mode, 0 of rigid ones
  ResponseSeries inputs_of(const ResponseSeries& x) const;
  /// CᵀX of these inputs; what small models are compared with, without rigid modes.
  MatrixSeries transfer(const ResponseSeries& x) const;
  TransferSeries seen(const ResponseSeries& x, const MatrixSeries& H) const;
  /// H from CᵀX, itself where nothing is added.
  MatrixSeries complete(const ResponseSeries& x, const MatrixSeries& H) const {
    return complete_outputs(ports_.form, x.interval, H);
  }
  /// The largest entry of that at the centre of the interval.
  double size_of_outputs(const ResponseSeries& x, const MatrixSeries& H) const {
    return size_at_centre(ports_.form.is_plain() ? H : complete(x, H));
  }
  /// Of each view the largest factor of its outputs over the interval.
  std::vector<double> factors_of_views(Interval interval) const;
  void scale_bounds(const std::vector<double>& factors, Stretch& stretch) const;
  ComplexDense input_response(double omega) const;
  void add_rigid_floor(Stretch& stretch) const;
  template <class NormsOf>
  void take_sizes(const NormsOf& norms_of, Stretch& result) const;
  void sizes_by_entries(const ResponseSeries& x, const MatrixSeries& H,
                        Stretch& result) const;
  bool sizes_by_terms(const MatrixSeries& factors, Stretch& result) const;
  template <class T>
  static T known(std::optional<T> value) {
    if (!value) throw ShiftError("the body is undamped and the frequency is a resonance");
    return std::move(*value);
  }
  void take_modal_system();
  std::vector<double> units() const;
  MediumLevel level_;
  std::optional<DenseResponse> transposed_; ///< of A(ω)ᵀ, where A is not symmetric
  Basis V_;
  Dense to_V_;           ///< coordinates of V from those of `system`
  ModalNumbers numbers_; ///< the same system, for more digits
  double enough_digits_ =
      0; ///< relative: with terms, tails of H up to this are good enough
  /// The ports that are seen, among all.
  struct Ports {
    std::vector<double> scale; ///< of all
    std::vector<int> inputs, outputs;
    std::vector<Certificate::PortSet> blocks; ///< the views by columns of all ports
    Dense modal_inputs, modal_outputs;        ///< N × n_in, n_out, in the body's units
    OutputForm form;
  } ports_;
  /// Where ports are many.
  struct ManyPorts {
    /// With many inputs and outputs, of each view: terms of H. With many of either: those
    /// of the residuals.
    std::vector<TermGram> terms;
    Certificate::ResidualGrams residuals;
    double enough = 0; ///< errors of H up to this need no sharper bound, relative
  } many_;
  /// What errors of a view are relative to: H without `left_out` modes, or the smaller of that
  /// and H.
  struct Reference {
    int left_out = 0;
    bool or_whole = false;
    double least = 0; ///< or this, if it is larger
  };
  std::vector<Reference> reference_; ///< of each view
};

} // namespace flexgram
