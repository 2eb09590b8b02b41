/// What an unfinished `certify` leaves behind, for one that goes on.

#pragma once

#include "medium/growth.hpp"

namespace flexgram {

/// The shortfall of a medium model that is still growing: what a checkpoint says of itself.
inline constexpr const char* unfinished = "unfinished";

/// Writes and reads the checkpoints of one run, and ends it if it is asked to.
class Checkpoints {
public:
  /// @param spec  kept by reference.
  Checkpoints(const SecondOrderModel& fom, const CheckpointSpec& spec,
              Observer& observer);

  /// Writes a checkpoint if it is time for one. @param what  is done, in words.
  /// @throws Interrupted after that if SIGTERM asked to end. Collective.
  void save(const CertifyRun& run, CertifyState& state, const char* what);
  /// Where nothing could be saved. @throws Interrupted if SIGTERM asked to end. Collective.
  void end_if_asked(const char* what) const;
  /// What a checkpoint holds. @return nothing if there is none, or if it is not wanted.
  /// @throws Error naming the difference if it is of another body, band, ports or version.
  /// Collective.
  std::optional<CertifyState> resume(const CertifyRun& run) const;

private:
  bool is_asked_to_end() const;

  const SecondOrderModel& fom_;
  const CheckpointSpec& spec_;
  Observer& observer_;
  double last_;          ///< [s] when the last one was written; or the beginning
  double seconds_of_mb_; ///< that writing a MB of V took; a guess before the first one
};

} // namespace flexgram
