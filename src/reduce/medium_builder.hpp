#pragma once

#include "model/rigid_body_modes.hpp"
#include "reduce/medium_model.hpp"

namespace flexgram {

/// The steps of medium_model, with what they share.
class MediumBuilder {
public:
  MediumBuilder(const SecondOrderModel& fom, const MediumOptions& options,
                SolverOptions solver, Plan& plan, Monitor& monitor);

  MediumModel build(const std::vector<Interval>& bands, double last_needed,
                    int modes_wanted, bool mass_is_singular, double target);

private:
  void find_rigid_modes();
  static MediumSpace::RigidStiffness stiffness_of(const RigidSplit& split);
  static bool has_light_dofs(const SecondOrderModel& fom, double omega);
  Block start(double omega, int modes_wanted, bool mass_is_singular);
  void scale_ports(Block& response);
  void search_modes();
  void take_out_rigid_modes();
  bool cutoff_is_in_a_gap() const;
  std::vector<Resonance> resonances() const;
  void factorise_norm();
  void bound_least_eigenvalue();
  ResidualNorm norm_of(const Block& T);
  int largest_order() const;
  void certify(int most_columns);
  void judge();
  bool holds_everywhere(double target);
  void grow(double target);
  void report(double target);

  const SecondOrderModel& fom_;
  const MediumOptions& options_;
  Plan& plan_;
  Monitor& monitor_;
  ShiftedSolver solver_;
  Block rigid_modes_, loads_, ports_; ///< all ports, scaled; the second self-equilibrated
  MediumSpace::RigidStiffness rigid_stiffness_; ///< of those from the geometry
  int geometric_ = 0, expected_ = 0;
  double threshold_ = 0;
  bool modes_exact_ = false; ///< the modes themselves are the result
  std::unique_ptr<MediumSpace> space_;
  MediumModel model_;
  std::vector<Interval> bands_;
  std::vector<double> grid_;
  double of_rounding_ = 0;      ///< norm in E⁻¹ of a random vector, rows scaled
  double least_eigenvalue_ = 0; ///< of K + τM with a unit diagonal, at least
  Block image_; ///< (K + τM)⁻¹T of the last certificate: the next Krylov block
  bool complete_ = false, inertia_is_safe_ = false;
  int blocks_ = 0;
  std::string end_; ///< why the growth ended, if not by the target
};

} // namespace flexgram
