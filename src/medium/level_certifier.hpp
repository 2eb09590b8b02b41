/// Makes levels of a growing medium model: the response of the space, its certificate, and sums
/// with twice the digits where rounding asks for them (docs/proof.md, sections 3 and 6). Called
/// by growth.cpp.

#pragma once

#include "medium/inverse_norm.hpp"
#include "medium/level_judge.hpp"
#include "medium/sharp_response.hpp"

namespace flexgram {

/// Certifies the space as it is, as the last level of a medium model.
class LevelCertifier {
public:
  LevelCertifier(const CertifyRun& run, ModalSpace& modal, Medium& medium,
                 LevelJudge& judge)
      : run_(run), modal_(modal), medium_(medium), judge_(judge) {}

  /// What a level was made of, beside what it keeps.
  struct Parts {
    std::shared_ptr<const DenseResponse> response; ///< by plain sums
    ResidualBasis residuals;
    ResidualNorm norm;
    std::vector<double> samples;       ///< [rad/s] where residuals were looked at
    double worst = 0, worst_omega = 0; ///< by plain sums: its largest bound, and where
  };
  /// The bound of the space, with one block solve: a level, in the place of an incomplete one
  /// of the same order.
  /// @param bounds  of E⁻¹; made if they are unknown.
  /// @param most    at most so many columns for what residuals are made of.
  /// @note Collective.
  void prove(InverseBounds& bounds, const std::vector<double>& grid, int most);
  /// Of the level that was made last.
  const Parts& parts() const { return parts_; }
  /// (K − ω_c²M)⁻¹T of it: the next Krylov block.
  const Basis& images() const { return images_.images(); }

  /// Sharper sums for the last level, if the grid shows that it needs them. Collective.
  void sharpen_if_needed();
  /// Sharper sums where the grid did not show that they are needed: at zeros of H. Collective.
  void sharpen_between();

private:
  MediumLevel& last() { return medium_.levels.back(); }
  bool needs_sharper_sums() {
    return last().complete && judge_.floor() > judge_.allowed_rounding(last());
  }
  void certify(ProjectionRounding rounding, const ResidualBasis& residuals);
  bool sharpen();

  const CertifyRun& run_;
  ModalSpace& modal_;
  Medium& medium_;
  LevelJudge& judge_;
  Parts parts_;
  ResidualImages images_;
  bool is_sharp_ = false; ///< the last level
};

} // namespace flexgram
