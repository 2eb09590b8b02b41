#pragma once

#include "base/observer.hpp"
#include "model/second_order_model.hpp"
#include "model/spec.hpp"

#include <functional>
#include <memory>

namespace flexgram {

/// A body ready for many solves: the ranks are split into groups, each group holds the
/// whole body and factorises its own frequencies. Collective on the world.
class FrequencySolves {
public:
  /// @param groups      of ranks; 0: as many as the memory estimate allows.
  /// @param tasks       number of frequencies that will come; no more groups than that.
  /// @param samples_mb  what a rank will keep of the solutions, for the choice of groups.
  FrequencySolves(SecondOrderModel model, int groups, const SolverOptions& solver,
                  int tasks, double samples_mb, Observer& observer);
  ~FrequencySolves();
  FrequencySolves(FrequencySolves&&) noexcept;

  /// From now on every solution is kept as a file in the folder `checkpoint.path`, and
  /// one that is there already is read, if `checkpoint.restart` says so.
  void keep(const CheckpointSpec& checkpoint);

  /// @throws Interrupted after a frequency if SIGTERM asked to end and solutions are
  /// kept. Calls use(l, X(ω_l)) on the ranks of the group that solved frequency l. A
  /// failure in one group ends the call on all ranks. X is n × n_in (undamped) or n × 2
  /// n_in: [Re, Im].
  using Use = std::function<void(std::size_t, const Block&)>;
  void for_each(const std::vector<double>& omega, const char* what, const Use& use);

  /// H(ω_l) = Cᵀ X(ω_l) for all l, on every rank.
  std::vector<ComplexDense> transfer(const std::vector<double>& omega, const char* what);

  /// Frequencies of [0, count) that this rank's group solves.
  std::vector<std::size_t> mine(std::size_t count) const;
  /// Sums what the groups found onto every rank.
  std::vector<ComplexDense> share_transfer(std::vector<ComplexDense> mine) const;

  const SecondOrderModel& model() const; ///< on the group's communicator
  const Groups& groups() const;
  RowRange world_rows() const; ///< rows of this rank in the layout of the world
  const FactorEstimate& estimate() const;
  const std::string& ordering() const;
  int factorisations() const; ///< of all groups
  double worst_backward_error() const;

private:
  struct State;
  std::unique_ptr<State> state_;
};

} // namespace flexgram
