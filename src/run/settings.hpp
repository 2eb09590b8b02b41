#pragma once

#include "model/reduced_io.hpp"
#include "reduce/pod.hpp"
#include "reduce/two_step.hpp"

namespace flexgram {

/// Everything that a user can set, over all verbs: each field one option.
struct Settings {
  std::string body, rom, body_out, out = "rom.h5", sweep_out = "sweep.h5",
                                   monitor = "summary";
  std::string method = "two_step";
  std::string inputs, outputs;
  std::string frame_integrals = "auto";
  std::vector<double> sweep_hz{10, 500, 200};
  GramianOptions gramian;
  PodOptions pod;
  TwoStepOptions two_step;
  ParallelOptions parallel;
  SolverOptions solver;

  /// Registers every field, and so reads it from PETSc's option database.
  void describe(Options& options);
  /// Refuses bad options before any work.
  void check() const;
  /// Memory limit and BLAS threads of this process. @return how much to print.
  /// Collective.
  Monitor::Level prepare(MPI_Comm comm);
  bool samples() const { return method == "pod"; }
};

} // namespace flexgram
