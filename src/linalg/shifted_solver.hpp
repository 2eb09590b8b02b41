#pragma once

#include "linalg/block.hpp"
#include "linalg/mumps.hpp"
#include "linalg/shifted_matrix.hpp"

#include <petscmat.h>

#include <complex>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

namespace flexgram {

/// Arithmetic of the factors. Single precision is refined to double accuracy.
enum class Precision { automatic, double_precision, single_precision };

/// How the shifted systems are solved.
struct SolverOptions {
  MumpsOptions mumps;
  Precision precision = Precision::automatic; ///< double, unless use() says otherwise
  int refinements = 2;                        ///< at most so many refinement steps
  double backward_error = 1e-13; ///< refine and warn above it; 1e-6 is an error
  /// By nested dissection, known before: 1-based position of each row, on rank 0. Null:
  /// each solver finds its own.
  std::shared_ptr<const PivotOrder> order;
};

/// For counting pivots: in double, with a threshold for null pivots.
SolverOptions counting(SolverOptions options);

/// The order that solvers with K and M, or with one of them alone, can share; null where
/// the options ask for none by nested dissection. Arguments as of ShiftedSolver.
/// Collective.
std::shared_ptr<const PivotOrder>
shared_order(Mat K, Mat M, const std::vector<std::int64_t>& node_of_row,
             const SolverOptions& options);

/// What MUMPS may assume: K + τM of a supported or free body is positive definite and
/// needs no search for pivots.
enum class Definiteness { indefinite, positive };

/// Factorises K + Σ g T − ω²M and its real relatives in the arithmetic that the shift
/// needs: real where the coefficients are real, complex otherwise; LDLᵀ, or LU where a term is
/// skew. One analysis
/// a pattern and arithmetic, one ordering for all.
/// @note Collective on the communicator of the matrices, which must outlive this object.
class ShiftedSolver {
public:
  /// @param[in] K, M, terms  real n×n, both triangles stored; M may be null.
  /// @param[in] kind  general: a term is not symmetric.
  /// @param[in] node_of_row  node number of each local row; empty: found from the
  /// pattern.
  ShiftedSolver(Mat K, Mat M, std::vector<Mat> terms,
                std::vector<std::int64_t> node_of_row, const SolverOptions& options,
                MatrixKind kind = MatrixKind::symmetric);
  ~ShiftedSolver();

  /// Analyses for the arithmetic that such a shift needs, and returns MUMPS' estimate.
  FactorEstimate analyse(bool real);

  /// Arithmetic and place of the factors from now on.
  void use(bool single, bool out_of_core);

  /// With factors in single precision and count_pivots() a real A is factorised twice:
  /// first in double, without keeping factors, for its inertia.
  /// @throws ShiftError if A is singular, MemoryError if it does not fit.
  void factorise(const ShiftCoefficients& coefficients,
                 Definiteness definiteness = Definiteness::indefinite);

  struct Solution {
    Block x;               ///< n × p if A is real, else n × 2p: [Re X, Im X]
    double backward_error; ///< max_j ‖b − A x‖∞ / (‖A‖∞ ‖x‖∞ + ‖b‖∞)
    int refinements;
  };
  /// X = A⁻¹ B with the last factorisation.
  /// @throws ShiftError if the solution is so large that A must be taken as singular.
  /// @param verify  refinement and backward error by all columns, by the first alone
  /// (all, if that one is not good), or none (the backward error is then 0).
  enum class Verify { all, first_column, none };
  Solution solve(const Block& b, Verify verify = Verify::all);

  /// Eigenvalues of the last real A below zero, by Sylvester's law; needs
  /// count_pivots(true) before the factorisation.
  int negative_pivots() const;
  int null_pivots() const;
  void count_pivots(bool count);

  /// Frees what only further factorisations need; one that comes all the same makes it
  /// again.
  void forget_pattern();

  /// Whether single precision was not enough, so that factors are in double now.
  bool fell_back() const;

  /// "nested dissection" or "MUMPS"; what was taken after analyse().
  const std::string& ordering() const;
  int factorisations() const;

private:
  struct State;
  void fall_back();
  std::unique_ptr<State> state_;
};

} // namespace flexgram
