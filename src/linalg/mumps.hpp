#pragma once

#include "base/error.hpp"
#include "base/parallel.hpp"

#include <complex>
#include <map>
#include <memory>
#include <span>
#include <string>
#include <vector>

namespace flexgram {

/// Fill-reducing ordering.
enum class Ordering {
  automatic, ///< best where many frequencies are factorised; elsewhere nested dissection,
             ///< for small bodies MUMPS' own
  best,      ///< the one of the next two with fewer estimated flops
  nested_dissection, ///< METIS on the node graph
  mumps              ///< MUMPS' own choice
};

std::string mumps_version();

/// Options of every factorisation of the program.
struct MumpsOptions {
  std::map<int, double> icntl, cntl; ///< any control of MUMPS, by number
  int workspace_percent = 30;        ///< ICNTL(14), first try
  int workspace_limit = 480;         ///< ICNTL(14), last try after INFOG(1) = -8, -9
  double memory_limit_mb =
      0; ///< per rank; 0: none (the program then takes what is there)
  Ordering ordering = Ordering::automatic;
};

/// Lower triangle of a sparse symmetric matrix, or all of another one,
/// the entries spread over the ranks; 1-based as MUMPS wants them. An entry may occur on
/// several ranks or several times: MUMPS adds them up.
struct Pattern {
  int n = 0;
  std::vector<int> row, column;
};

/// A pivot order, on rank 0; nothing elsewhere.
struct PivotOrder {
  std::vector<int> position; ///< 1-based place of each variable
  /// Where blocks of variables with the same neighbours begin in the order, 0-based, and
  /// its end: of these alone the analysis makes its graph. Empty: each variable for itself.
  std::vector<int> block_start;
};

/// MUMPS' own estimate after the analysis.
struct FactorEstimate {
  double flops = 0;          ///< RINFOG(1), elimination
  double factor_entries = 0; ///< INFOG(3)
  double mb_per_rank = 0;    ///< INFOG(16), the rank that needs most
  double mb_total = 0;       ///< INFOG(17)
};

enum class MatrixKind { symmetric, general };

/// One instance of MUMPS in the arithmetic of Scalar: float, double, complex<float>,
/// complex<double>. Entries distributed, right-hand sides and
/// solutions dense and distributed by rows.
template <class Scalar>
class Mumps {
public:
  Mumps(MPI_Comm comm, const MumpsOptions& options,
        MatrixKind kind = MatrixKind::symmetric);
  ~Mumps();
  Mumps(Mumps&&) noexcept;
  Mumps& operator=(Mumps&&) noexcept;

  /// Orders and analyses, once for a pattern. An empty order: MUMPS orders. Collective.
  FactorEstimate analyse(const Pattern& pattern, const PivotOrder& order);
  /// The ordering in use.
  PivotOrder order() const;

  /// Numeric factorisation; values in the order of the entries of the analysed pattern,
  /// which is not needed afterwards.
  /// @throws ShiftError if the matrix is singular, MemoryError with the amount needed.
  /// @param pivoting  search for numerical pivots; without, as for positive definite
  /// matrices, factors keep the estimated size.
  void factorise(const Pattern& pattern, std::vector<Scalar> values,
                 bool pivoting = true);

  /// Number of negative pivots = negative eigenvalues (Sylvester), for real symmetric
  /// matrices; pivots that were zero are counted by null_pivots().
  int negative_pivots() const;
  int null_pivots() const;
  /// Detect zero pivots and let factorise() succeed on a singular matrix, for counting.
  /// Before analyse(), so that the root front is not handed to ScaLAPACK, which counts
  /// nothing.
  void tolerate_null_pivots(bool tolerate);

  /// X = A⁻¹ B in place: this rank's rows `rows`, column-major, leading dimension
  /// rows.size().
  void solve(RowRange rows, std::span<Scalar> x, int columns);

private:
  struct Instance;
  std::unique_ptr<Instance> instance_;
};

} // namespace flexgram
