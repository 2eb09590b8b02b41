#pragma once

#include "linalg/block.hpp"
#include "linalg/shifted_solver.hpp"

#include <cstdint>
#include <string>
#include <vector>

namespace flexgram {

/// Damping D_total = αM + βK + D, and structural damping K(1 + iη). Every part may be
/// zero.
struct Damping {
  double alpha = 0; ///< [1/s]
  double beta = 0;  ///< [s]
  double eta = 0;   ///< loss factor
};

/// What inputs add to outputs at once, with no motion between: y += value·u of the named
/// ports. Heat adds −C α T to the stress of its strain. H and every claim of its error are
/// without it: it is the same in every reduced body.
struct Feedthrough {
  std::vector<std::string> outputs, inputs;
  std::vector<double> values; ///< one a pair
  /// n_out × n_in, of the named ports.
  Dense between(const std::vector<std::string>& outputs,
                const std::vector<std::string>& inputs) const;
  void append(const Feedthrough& more);
};

/// M q'' + D q' + K (1 + iη) q = B u, y = Cᵀ q: the same type for a full body (sparse,
/// rows over the ranks of comm) and for a reduced one (dense, whole on every rank, comm =
/// self).
///
/// M [kg], D [N·s/m], K [N/m]: n×n, real symmetric; B: n×n_in; C: n×n_out (the paper's
/// C_e).
struct SecondOrderModel {
  std::string name;
  MPI_Comm comm = MPI_COMM_NULL;
  PetscInt n = 0;
  RowRange rows;
  Matrix M, K, D; ///< D: what αM + βK do not cover; may be null
  Damping damping;
  Block B, C; ///< C shares B where the outputs are the inputs
  bool outputs_are_inputs = true;
  std::vector<std::string> inputs, outputs; ///< port names

  // Dof map, this rank's rows; empty where the body has none.
  std::vector<std::int64_t> node;      ///< node of each row, 0-based
  std::vector<std::int64_t> label;     ///< the FE code's number of that node; empty: node
  std::vector<std::int64_t> component; ///< 0-2 translation, 3-5 rotation
  std::vector<double> position;        ///< [m], 3 numbers a row
  std::vector<std::string> remarks;    ///< what reading changed, in words
  double rounding = 0; ///< relative, of K's entries, if they were printed; 0: not known
  Feedthrough feedthrough;

  /// How many outputs are no inputs, by their names.
  PetscInt further_outputs() const;
  bool undamped() const;
  /// Damping class in words, for the plan.
  std::string damping_class() const;
  /// A(ω) = K(1+iη) + iω(αM + βK + D) − ω²M as coefficients of K, M, D.
  ShiftCoefficients coefficients(double omega) const;
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

/// H(ω) = Cᵀ A(ω)⁻¹ B of a dense (reduced) model, n_out × n_in.
ComplexDense dense_transfer(const SecondOrderModel& model, double omega);

/// Cᵀ X from X = [Re X, Im X] or a real X.
ComplexDense output_of(const Block& C, const Block& x, PetscInt inputs);

/// A dense matrix held whole by this rank, and back.
Matrix make_dense(const Dense& a);
Dense to_dense(Mat a);
Block make_block(const Dense& a);

} // namespace flexgram
