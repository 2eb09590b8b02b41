#pragma once

#include "linalg/block.hpp"
#include "linalg/shifted_solver.hpp"
#include "model/law.hpp"
#include "model/stiffening.hpp"

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

namespace flexgram {

/// Viscous damping αM + βK, and structural damping K(1 + iη). Every part may be zero.
struct Damping {
  double alpha = 0; ///< [1/s]
  double beta = 0;  ///< [s]
  double eta = 0;   ///< loss factor
};

/// What inputs add to outputs at once, with no motion between: y += value·u of the named
/// ports. Heat adds −C α T to the stress of its strain. The same in every reduced body.
struct Feedthrough {
  std::vector<std::string> outputs, inputs;
  std::vector<double> values; ///< one a pair
  /// n_out × n_in, of the named ports.
  Dense between(const std::vector<std::string>& outputs,
                const std::vector<std::string>& inputs) const;
  void append(const Feedthrough& more);
};

/// Outputs that are forces of the damped stiffness, as reactions are: their row of H is
/// (1 + iη + iωβ) Cᵀ A⁻¹B, with factors of their own.
struct OutputDamping {
  std::vector<std::string> outputs;
  std::vector<double> beta, eta; ///< [s], [1]; one an output
};

/// How H of some outputs and inputs follows from the response to the inputs:
///   H = diag(1 + iη + iωβ) Cᵀ A⁻¹B + F.
class OutputForm {
public:
  OutputForm() = default;
  OutputForm(const OutputDamping& damping, const Feedthrough& direct,
             const std::vector<std::string>& outputs,
             const std::vector<std::string>& inputs);
  /// Whether H is CᵀA⁻¹B.
  bool is_plain() const { return !has_factors() && direct_.data.empty(); }
  bool has_factors() const { return !beta_.empty(); }
  bool has_direct() const { return !direct_.data.empty(); }
  std::complex<double> factor(int output, double omega) const {
    const auto at = static_cast<std::size_t>(output);
    return has_factors() ? std::complex<double>(1, eta_[at] + omega * beta_[at]) : 1.0;
  }
  /// Its derivative by ω.
  std::complex<double> slope(int output) const {
    return has_factors()
               ? std::complex<double>(0, beta_[static_cast<std::size_t>(output)])
               : 0.0;
  }
  /// Factors alone: differences of H from those of CᵀA⁻¹B.
  void scale(ComplexDense& H, double omega) const;
  /// H from CᵀA⁻¹B.
  void complete(ComplexDense& H, double omega) const;
  /// Without F of an output.
  void leave_out_direct(int output);
  const Dense& direct() const { return direct_; } ///< F, n_out × n_in; empty: zero
  const std::vector<double>& beta() const { return beta_; }
  const std::vector<double>& eta() const { return eta_; }

private:
  std::vector<double> beta_, eta_; ///< of each output; empty: none has a factor
  Dense direct_;
};

/// A(ω) q = B u, A = K(1 + iη) + iω(αM + βK) − ω²M + Σ g(ω)T of the terms, y = Cᵀ q and what
/// `output_form` adds: the same type for a full body (sparse, rows over the ranks of comm) and
/// for a reduced one (dense, whole on every rank, comm = self).
///
/// M [kg], K [N/m], T: n×n, real symmetric, T of G skew; B: n×n_in; C: n×n_out (the paper's C_e).
struct SecondOrderModel {
  std::string name;
  MPI_Comm comm = MPI_COMM_NULL;
  PetscInt n = 0;
  RowRange rows;
  Matrix M, K;
  Damping damping;
  std::vector<Term<Matrix>> terms; ///< what αM + βK and ηK do not cover; no name twice
  /// [rad/s] G is that of Coriolis forces, and no larger than this times M: ±iG <= coriolis·M. 0:
  /// not known.
  double coriolis = 0;
  Block B, C; ///< C shares B where the outputs are the inputs
  bool outputs_are_inputs = true;
  /// Whether e × u at the nodes of the rows is e × u everywhere; not where dofs follow others by
  /// levers or in some directions, nor where masses lie beside their nodes.
  bool turns_by_nodes = true;
  std::vector<std::string> inputs, outputs; ///< port names

  // Dof map, this rank's rows; empty where the body has none.
  std::vector<std::int64_t> node;      ///< node of each row, 0-based
  std::vector<std::int64_t> label;     ///< the FE code's number of that node; empty: node
  std::vector<std::int64_t> component; ///< 0-2 translation, 3-5 rotation
  std::vector<double> position;        ///< [m], 3 numbers a row
  std::vector<std::string> remarks;    ///< what reading changed, in words
  std::vector<std::string> doubts;     ///< what reading found that may be a mistake
  double rounding = 0; ///< relative, of K's entries, if they were printed; 0: not known
  Feedthrough feedthrough;
  OutputDamping output_damping;
  /// What a floating frame takes of it for geometric stiffening; null: not asked for.
  std::shared_ptr<const Stiffening> stiffening;

  OutputForm output_form() const {
    return {output_damping, feedthrough, outputs, inputs};
  }
  /// How many outputs are no inputs, by their names.
  PetscInt further_outputs() const;
  bool undamped() const;
  /// Whether K may have negative eigenvalues: gyroscopic forces may hold a body that is unstable
  /// without them.
  bool may_be_unstable() const { return !is_symmetric(terms); }

  /// Damping class in words, for the plan.
  std::string damping_class() const;
  /// A(ω) as coefficients of K, M and the terms.
  ShiftCoefficients coefficients(double omega) const;
  /// Parameters are stiffness: what damps K damps them too, by β and η as they are now.
  void damp_parameters();
  /// The matrix of a term of that law; null where there is none.
  Mat term(const Law& law) const;
  /// Handles of the terms' matrices.
  std::vector<Mat> term_matrices() const;
  /// A second handle on the same matrices.
  SecondOrderModel share() const;
  /// Everything but the matrices: names, damping, where the rows are.
  SecondOrderModel head() const;
  /// Relative rounding of K's entries if they were printed: what is known of it, else what
  /// their decimal digits show; 0 if they look like any doubles. Not for decisions: a factor
  /// of K changes its digits. Collective.
  double printed_rounding() const;
  std::int64_t nonzeros() const;
  /// Memory of the matrices on this rank [MB].
  double memory_mb() const;
};

/// The model on the group's communicator, each group a whole copy. Collective on
/// groups.world.
SecondOrderModel move_to_group(SecondOrderModel model, const Groups& groups);

/// Ports by their numbers.
struct PortSelection {
  std::vector<int> inputs, outputs;
  bool same = true; ///< the outputs are the inputs
  bool operator==(const PortSelection&) const = default;
};
/// The named ports of the model. A name is a port ("lower.fx") or an interface ("lower").
/// An empty list means all, outputs those of the inputs where they are the same.
/// @throws Error naming the nearest for an unknown port.
PortSelection find_ports(const SecondOrderModel& model,
                         const std::vector<std::string>& inputs,
                         const std::vector<std::string>& outputs);
/// Keeps the names of these alone.
void select_names(SecondOrderModel& model, const PortSelection& ports);
/// Keeps only the named ports.
void select_ports(SecondOrderModel& model, const std::vector<std::string>& inputs,
                  const std::vector<std::string>& outputs);

/// H(ω) of a dense (reduced) model, n_out × n_in.
ComplexDense dense_transfer(const SecondOrderModel& model, double omega);

/// H(ω) from the response X = A⁻¹B, as [Re X, Im X] or a real X. Collective.
ComplexDense transfer_of(const SecondOrderModel& model, const Block& x, double omega);

/// A dense matrix held whole by this rank, and back.
Matrix make_dense(const Dense& a);
Dense to_dense(Mat a);
Block make_block(const Dense& a);

} // namespace flexgram
