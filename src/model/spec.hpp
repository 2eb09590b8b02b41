#pragma once

#include <memory>
#include <numbers>
#include <optional>
#include <string>
#include <utility>
#include <vector>

namespace flexgram {

/// 1 rad/s in Hz.
inline constexpr double hz = 0.5 / std::numbers::pi;

/// Frequencies from `first` to `last` [rad/s].
struct Interval {
  double first = 0, last = 0;
  double centre() const { return 0.5 * (first + last); }
  double half() const { return 0.5 * (last - first); }
  double width() const { return last - first; }
  bool operator==(const Interval&) const = default;
};

/// Ascending; those that touch, or have no more than a gap between them, as one.
std::vector<Interval> joined(std::vector<Interval> intervals, double gap = 0);

/// What an error of H is divided by.
enum class RelativeTo {
  pointwise, ///< ‖H(ω)‖_F at the same frequency: eq. (17) of the paper
  band,      ///< the largest ‖H‖_F over the band
  elastic,   ///< ‖H(ω)‖_F without the motion as a rigid body, at the same frequency
  both ///< the smaller of pointwise and elastic; pointwise where H has no elastic part
};

/// "pointwise", "band", "elastic", "both".
const char* word_of(RelativeTo reference);

/// In which basis vectors of a Gramian are orthonormal.
enum class Metric {
  mass,      ///< M, or M + K/ω_max² where M is singular
  euclidean, ///< I, the paper
  energy     ///< M + K/ω_max²
};

/// How errors of kinds of ports are judged beside those of all of H.
struct KindSpec {
  bool each = false; ///< each kind by itself
  /// Kinds of outputs, "stress", or with that of their inputs, "stress from force", and how
  /// many times the smallest tolerance each may err: 1 or more.
  std::vector<std::string> kinds;
  std::vector<double> allowed;
  double others = 1; ///< the same of all others
  bool operator==(const KindSpec&) const = default;
};

/// How large the reduced body is to be.
struct OrderSpec {
  int order = 0;                   ///< 0: by the tolerance or the paper's rule
  std::optional<double> tolerance; ///< relative error; unset: by `order` or the rule
  bool each_kind = true;           ///< it holds for each kind of ports by itself too
  /// Kinds with a tolerance of their own.
  std::vector<std::pair<std::string, double>> of_kinds;

  /// The smallest of all. @pre tolerance
  double smallest() const;
  KindSpec kinds() const;
};

/// Where and when what is finished is written, so that a run that was ended goes on.
struct CheckpointSpec {
  enum class When {
    automatic, ///< when the work took more than 20 s so far, and writing takes little of it
    always,
    never ///< not even when SIGTERM asks to end
  };
  std::string path;       ///< empty: nowhere
  bool is_folder = false; ///< of `pod`: a file for each frequency
  When when = When::automatic;
  bool restart = false; ///< go on from it, if it is there
  /// Whether it was written or gone on from; shared by copies.
  std::shared_ptr<bool> used = std::make_shared<bool>(false);
};

/// The paper's order rule (section 2.2): smallest m with σ_{m+1}/σ_1 < √ε ≈ 1.5e-8.
/// @param sigma  eigenvalues of the position Gramian, descending.
int order_by_rule(const std::vector<double>& sigma);

} // namespace flexgram
