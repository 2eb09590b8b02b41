/// The steps of `certify` with what they share; start.cpp holds those up to the modes,
/// growth.cpp the rest, resume.cpp checkpoints. Seen by these alone.

#pragma once

#include "medium/checkpoint.hpp"
#include "medium/over_band.hpp"
#include "medium/projection_rounding.hpp"
#include "medium/space.hpp"
#include "model/rigid_body_modes.hpp"

namespace flexgram {

/// The shortfall of a medium model that is still growing: what a checkpoint says of itself.
inline constexpr const char* unfinished = "unfinished";

/// The steps of certify, with what they share.
class MediumBuilder {
public:
  MediumBuilder(const SecondOrderModel& fom, const CertifySpec& spec,
                const SolverOptions& solver, Observer& observer,
                const CheckpointSpec& checkpoint);

  Medium build(bool mass_is_singular);

private:
  bool resume();
  CheckpointState state() const;
  void expect_same_projection(const CheckpointState& state) const;
  void save(const char* what);
  void end_if_asked(const char* what) const;
  void find_rigid_modes();
  bool find_the_modes(double omega, bool mass_is_singular, bool last);
  static bool has_light_dofs(const SecondOrderModel& fom, double omega);
  Block start(double omega, bool mass_is_singular);
  Block with_company(const Block& ports) const;
  void scale_ports(Block& response);
  Block without_many_outputs(Block response) const;
  void unscale_ports();
  double angle_of_modes() const;
  void search_modes();
  void take_out_rigid_modes();
  void begin_with_null_vectors(const Dense& null, const Dense& elastic);
  bool cutoff_is_in_a_gap() const;
  std::shared_ptr<const DenseResponse> ritz_response() const;
  void need_factors();
  void factorise(double s);
  void count_factorisations();
  void need_cutoff();
  void bound_least_eigenvalue(const DenseResponse& response);
  Dense along_modes(const DenseResponse& response, const Block& g) const;
  ResidualNorm norm_of(const DenseResponse& response, const Block& T);
  int largest_order() const;
  std::string why_no_larger() const;
  void prove(int most_columns);
  void look_at(std::size_t level);
  void judge(MediumLevel& level);
  std::vector<double> beside_grid() const;
  double allowed_rounding(const MediumLevel& level) const;
  bool needs_sharper_sums(const MediumLevel& level) const;
  SharpSums vectors_to_sharpen(const ProjectionRounding& rounding,
                               double share_of_others) const;
  void certify_level(ProjectionRounding rounding, const ResidualBasis& parts);
  bool sharpen_sums();
  void sharpen_if_needed();
  void sharpen_between();
  bool holds_everywhere();
  double slow() const { return 1e-5 * medium_.cutoff * medium_.cutoff; }
  bool has_unjudged_slow_modes() const;
  void begin_again_with_exact_modes(bool mass_is_singular);
  void find_all_modes(double omega, bool mass_is_singular);
  void grow();
  void report();

  const SecondOrderModel& fom_;
  const CertifySpec& spec_;
  const CheckpointSpec& checkpoint_;
  Observer& observer_;
  double start_ = 0; ///< [s]
  SolverOptions options_;
  ShiftedSolver solver_;
  Block rigid_modes_;        ///< from the geometry, until the space has them
  std::vector<int> same_as_; ///< of each port the first one that is equal
  Block loads_, ports_;      ///< all ports, scaled; the same, self-equilibrated
  Dense rigid_stiffness_;    ///< that the stored K holds of those from the geometry
  int geometric_ = 0, expected_ = 0;
  double threshold_ = 0;
  std::unique_ptr<MediumSpace> space_;
  Medium medium_;
  std::unique_ptr<MediumOverBand> seen_; ///< one of its levels, by all ports
  std::vector<double> grid_;
  double of_rounding_ = 0;      ///< norm in E⁻¹ of a random vector, rows scaled
  double least_eigenvalue_ = 0; ///< |λ| of K − ω_c²M, scaled, at least
  Block image_; ///< (K − ω_c²M)⁻¹T of the last certificate: the next Krylov block
  bool inertia_is_safe_ = false, cutoff_is_factorised_ = false,
       factors_are_chosen_ = false;
  bool exact_modes_ = false; ///< loose ones hid one that may be rigid
  int judged_elastic_ = 0;   ///< slow modes that were found to be no rigid ones
  /// Wide blocks are cut to the directions that matter, as long as that helps.
  bool cut_blocks_ = true, block_was_cut_ = false;
  double worst_before_ = 0; ///< error of the level before
  double worst_omega_ = 0;  ///< [rad/s] where the error was largest
  /// Of the last level: its modal coordinates by plain sums, and what else its certificate is
  /// made of.
  struct Plain {
    std::shared_ptr<const DenseResponse> response;
    ResidualBasis parts;
    ResidualNorm norm;
    int modes = 0; ///< below the cutoff
  };
  Plain plain_;
  std::vector<double> rough_; ///< [rad/s] where rounding was found to be large
  double floor_ = 0; ///< largest relative rounding of the level that was judged last
  int sharpened_sums_ = 0;                     ///< of the last level
  int blocks_ = 0, factorisations_before_ = 0; ///< ... of a checkpoint
};

} // namespace flexgram
