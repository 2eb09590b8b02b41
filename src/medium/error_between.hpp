/// The error of a small model with all values of the body's parameters in their box, everywhere in
/// the bands, by branch and bound over cells of (ω, p) (docs/proof.md, section 5). Called by
/// basis/cut.

#pragma once

#include "medium/cell_series.hpp"

namespace flexgram {

class CellBound;

class ErrorBetween {
public:
  /// About so much work at most on each rank [flops]; it is given up then.
  static constexpr double most_work = 1e11;

  /// @param medium  with any values; outlives this.
  /// @param Q       N × m, of full rank: the small model's basis in the coordinates of its system.
  ErrorBetween(const MediumModel& medium, const Dense& Q);

  struct Supremum {
    std::vector<double> worst_of; ///< of each view
    bool proved = true;           ///< it holds everywhere in the bands and the box
    int cells = 0;                ///< that were looked at
  };
  /// The largest error relative to ‖H(ω)‖, certified. Levels are those of views that may err no
  /// more than the smallest tolerance.
  /// @param limit  what is no more than this needs no smaller cells.
  /// @note Collective on `comm`: cells are dealt to ranks. It gives up where it would be long work.
  Supremum supremum(MPI_Comm comm, const std::vector<Interval>& bands,
                    double limit) const;

private:
  struct Search;
  double work_of_a_cell() const;
  double work_of_a_region() const;
  /// @param share  of all that the rank does.
  void prove(const Cell& region, int depth, double share, Search& search) const;
  void prove(const CellBound& bound, const Cell& cell, int depth, double share,
             Search& search) const;

  const MediumModel& medium_;
  Certificate::Couplings couplings_;
  Dense Q_; ///< orthonormal
};

} // namespace flexgram
