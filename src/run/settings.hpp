/// Every option of a user, and the specs that the mathematics takes made of them. Used by
/// all verbs, in main and in the Python module.

#pragma once

#include "base/options.hpp"
#include "basis/cut.hpp"
#include "linalg/shifted_solver.hpp"
#include "sampling/gramian_basis.hpp"

namespace flexgram {

/// What is done by itself where it makes sense.
enum class Wish { automatic, yes, no };

/// Everything that a user can set, over all verbs: each field one option, in the user's
/// units. What the mathematics asks is made of it here, once.
struct Settings {
  std::string body, rom, body_out, out = "rom.h5", sweep_out = "sweep.h5", medium,
                                   medium_out;
  Observer::Level monitor = Observer::Level::summary;
  bool medium_basis = true;
  std::string method = "two_step", second_stage = "auto";
  std::string inputs, outputs, loads;
  int load_patterns = 0; ///< 0: each port by itself
  Wish frame_integrals = Wish::automatic;
  std::vector<double> band_hz{10, 500}, sweep_hz{10, 500, 200};
  bool band_is_given = false;
  std::string order_word = "auto";
  OrderSpec order;
  bool field_error = false;
  std::string tolerances_of_kinds; ///< "stress=1e-2,…"
  bool equal_ports = true, statics = false, spin_loads = false, stiffening = false;
  Metric metric = Metric::mass;
  RelativeTo relative_to = RelativeTo::both;
  FrameKind frame = FrameKind::automatic;
  std::string frame_interface;
  std::vector<double> weight, shifts_hz, error_hz;
  std::string at;           ///< values of parameters: "E_rubber=2e6,…"
  int parameter_values = 0; ///< of each; 0: by their number
  int moments = 2;
  double cutoff = 1.1, medium_target = 0;
  int medium_order = 0;
  int samples = 30, validate = 8;
  QuadratureRule quadrature = QuadratureRule::midpoint;
  bool logarithmic = false, snapshots = false;
  int groups = 0;
  SolverOptions solver;
  CheckpointSpec::When checkpoint = CheckpointSpec::When::automatic;
  bool restart = false;

  /// Registers every field, and so reads it from PETSc's option database.
  void describe(Options& options);
  /// Refuses bad options before any work, and fills in what depends on others.
  void check();
  /// A tolerance where neither it nor an order is given and no method has an order of its
  /// own: the paper's rule says nothing of the error (23 % was seen).
  void choose_tolerance(Observer& observer);
  /// Memory limit and BLAS threads of this process. @throws Error for options of the
  /// solver that cannot be. @return how much to print. Collective.
  Observer::Level prepare(MPI_Comm comm);

  bool takes_samples() const { return method == "pod"; }
  /// Methods for the small basis, in the order in which they are tried.
  std::vector<std::string> methods() const;
  /// [rad/s]
  std::vector<Interval> bands() const;
  CertifySpec certify_spec() const;
  /// Values of parameters by their names. @throws Error for what is no number.
  std::map<std::string, double> values_of_parameters() const;
  /// Beside the file that the verb writes.
  CheckpointSpec checkpoint_spec(const std::string& output) const;
  CutRequest cut_request() const;
  SamplingSpec sampling_spec() const;

private:
  void describe_files(Options& options);
  void describe_ports(Options& options);
  void describe_parameters(Options& options);
  void describe_accuracy(Options& options);
  void describe_method(Options& options);
  void describe_second_stage(Options& options);
  void describe_medium(Options& options);
  void describe_samples(Options& options);
  void describe_restart(Options& options);
  void describe_solver(Options& options);
  void check_solver() const;
  void check_band() const;
  void check_order();
  void check_kinds();
  void check_lists() const;
};

} // namespace flexgram
