#pragma once

#include "linalg/mumps.hpp"
#include "linalg/shifted_solver.hpp"

namespace flexgram {

/// K, M and the terms on one common pattern, this rank's rows: their lower triangles, or all of
/// them where a term is not symmetric.
struct CommonPattern {
  Pattern entries;
  std::vector<double> k, m;
  std::vector<std::vector<double>> terms;
};

CommonPattern common_pattern(Mat K, Mat M, const std::vector<Mat>& terms,
                             MatrixKind kind = MatrixKind::symmetric);

/// One instance of MUMPS behind an interface without its arithmetic.
class Engine {
public:
  virtual ~Engine() = default;
  virtual FactorEstimate analyse(const Pattern& entries, const PivotOrder& order) = 0;
  virtual PivotOrder order() const = 0;
  virtual void factorise(const CommonPattern& common, const ShiftCoefficients& c,
                         bool pivoting) = 0;
  /// re, im: local rows × columns; im is null for real right-hand sides or real
  /// arithmetic.
  virtual void solve(RowRange rows, const double* re, const double* im, double* x_re,
                     double* x_im, int columns) = 0;
  virtual int negative_pivots() const = 0;
  virtual int null_pivots() const = 0;
  virtual void count_pivots(bool count) = 0; ///< before analyse()
};

/// The arithmetic that the shift needs: real or complex, double or single.
std::unique_ptr<Engine> make_engine(MPI_Comm comm, bool real, bool single,
                                    const MumpsOptions& options, MatrixKind kind);

} // namespace flexgram
