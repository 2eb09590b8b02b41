/// The bound of a Galerkin model's error over an interval of ω (docs/proof.md, sections 2
/// to 4). Made by level_certifier.cpp, asked by MediumModel.

#pragma once

#include "medium/coupling.hpp"
#include "medium/projection_rounding.hpp"
#include "medium/residual_basis.hpp"
#include "medium/response_series.hpp"
#include "medium/term_gram.hpp"
#include "model/error_form.hpp"
#include "model/softening.hpp"

#include <functional>
#include <map>
#include <memory>
#include <numeric>
#include <optional>
#include <span>

namespace flexgram {

/// The error of the Galerkin model on a space V, bounded over intervals of ω. The proof,
/// with its assumptions: docs/proof.md; the names here are those of its section 3.
///
/// With ports P = [B, C] and their residuals R = P − A V x, VᵀR = 0, the error is exactly
///   H − H_r = R_CᵀA⁻¹R_B = W_Cᵀ S⁻¹ W_B,   W = E^−½ R,   E = K − ω_c²M,
/// on the E-orthogonal complement of the Ritz vectors Φ below ω_c, where E is positive
/// definite: this follows from its inertia, and Φ need not be exact. S = a_k + c T + iωD̃ − J A_Φ⁻¹ Jᵀ
/// is the Schur complement of Φ (c = a_m + ω_c² a_k, T = E^−½ME^−½ >= 0, J what M and terms
/// couple Φ to the rest by; with skew terms Jᵀ is that of A(ω)ᵀ); so ‖S⁻¹‖ <= q/(1 − qδ), q = max |1/(a_k + c μ)| over μ >= 0,
/// δ = ‖J A_Φ⁻¹ Jᵀ‖ (with D that of its Hermitian part), and with any disc |z − z₀| <= ρ that holds these 1/(a_k + c μ)
///   ‖H − H_r‖_F <= |z₀| ‖W_CᵀW_B‖_F + (ρ + q²δ/(1 − qδ)) s,  s² = Σ σ_i(W_C)² σ_i(W_B)².
class Certificate {
public:
  struct Bound {
    double error = 0; ///< of ‖H − H_r‖_F, in the unit of H
    double floor = 0; ///< rounding of the model itself, in the unit of H; not in `error`
    double rigid_floor = 0; ///< rounding of the rigid part of H; in neither
    /// Change of H if the stiffness of rigid modes in the stored K were real; in neither.
    double rigid_rounding = 0;
    /// Change of H by the rounding of K's entries when they were printed, an estimate; in
    /// neither: the claim is of the stored K.
    double data_rounding = 0;
    bool proved = true;
  };

  /// Up to this many ports W_CᵀW_B is formed; beyond, the product of the norms is used.
  static constexpr int few_ports = 64;
  /// Squares of the singular values of residuals W.
  struct SquaredValues {
    double norm = 0;          ///< √Σσ⁴
    std::vector<double> each; ///< descending; none of many columns
  };

  Certificate() = default;
  /// @param modes  number of modes below the cutoff, the rigid ones included.
  /// @param inertia_is_safe  their number is what the inertia says, whatever its rounding.
  /// @param scale  of each port.
  Certificate(const MediumSpace& space, const DenseResponse& response,
              const ResidualBasis& basis, const ResidualNorm& norm,
              ProjectionRounding rounding, int modes, bool inertia_is_safe, double cutoff,
              const Softening& softening, std::vector<double> scale);

  /// The same proof with other values of the parameters, by vectors Φ that suit them; also of what
  /// a file holds.
  /// @param response  with these.
  Certificate at(const DenseResponse& response) const;

  /// Columns of ports that are the inputs and the outputs of a block of H.
  struct PortSet {
    std::vector<int> inputs, outputs;
  };
  /// @param x  the response to all ports over an interval, or at a frequency.
  /// @param of_transposed  that of A(ω)ᵀ; null: A is symmetric.
  /// @return a bound for each block that holds everywhere in the interval.
  std::vector<Bound> over(const DenseResponse& response, const ResponseSeries& x,
                          const std::vector<PortSet>& blocks,
                          const ResponseSeries* of_transposed = nullptr) const;
  struct FieldBound {
    double error = 0; ///< ‖X − V x‖_K of the responses to some ports, in their units
    double floor = 0; ///< of it by rounding
    bool proved = true;
  };
  /// What the residuals of few ports are made of, in coordinates of their own where T has
  /// more rows than these parts span. Norms stay what they are; the rounding of the change
  /// counts as dropped.
  struct FewResiduals;
  FewResiduals residuals_of(const std::vector<int>& ports) const;
  /// The error of the field itself in the norm of the strain energy. Nothing is proved with
  /// a damping matrix. @param x  the response to the few ports. @param strain  √(uᵀKu) of
  /// each mode.
  FieldBound field_over(const DenseResponse& response, const ResponseSeries& x,
                        const FewResiduals& few, const std::vector<double>& strain) const;
  /// Of the residuals' terms, for the inputs and the outputs of some blocks.
  struct ResidualGrams;
  ResidualGrams residual_grams(const DenseResponse& response,
                               const std::vector<PortSet>& blocks) const;
  /// Bounds like those of `over` for many ports of a diagonal system, by ‖W_C‖‖W_B‖:
  /// larger by the root of the number of ports where their residuals are independent, at
  /// a price without the ports. Where they are not `enough` (number of the block, error),
  /// W_CᵀW_B at the centre makes them sharper.
  std::vector<Bound>
  of_many(const DenseResponse& response, const ResponseSeries& factors,
          const std::vector<PortSet>& blocks, const ResidualGrams& grams,
          const std::function<bool(std::size_t, double)>& enough) const;
  /// Largest sine of the angle between a mode below the cutoff and the space.
  double worst_angle() const;

  /// What is known of the body's modes below the cutoff, with E = K + τM, in descending
  /// order of μ = 1/(λ + τ): the k-th of the body lies between `mu[k]`, which is the model's, and
  /// `largest_mu[k]`; none of the others is above `rest`.
  struct Modes {
    std::vector<double> mu, largest_mu;
    std::vector<double> residual; ///< ‖E^−½(Mu − μEu)‖, uᵀEu = 1
    double rest = 0;
  };
  Modes modes() const;
  /// ‖E^−½(p − EVx)‖ of each port p, in its unit, E = K + τM: what V does not hold of its
  /// response to E. @note x: that of the model.
  std::vector<double> outside(const DenseResponse& response) const;
  /// Rounding of uᵢᵀKuⱼ between two Ritz vectors.
  double rounding_between(std::size_t i, std::size_t j) const {
    return rounding_.between(i, j, shifts_.sigma);
  }
  /// Rounding of μ_j, relative: of K, and of the dense eigenvalue problem.
  double rounding_of_mode(std::size_t j) const {
    return rounding_.between(j, j, shifts_.sigma);
  }
  const ProjectionRounding& rounding() const { return rounding_; }

  /// Every field by its name, for a file.
  template <class Archive, class Self>
  static void archive(Archive&& a, Self& self) {
    a("tau", self.shifts_.tau);
    a("sigma", self.shifts_.sigma);
    a("kappa", self.shifts_.kappa);
    a("mu_plus", self.shifts_.mu_plus);
    a("gyration", self.softening_.gyration);
    a("gyration_stiffness", self.softening_.gyration_stiffness);
    a("softening_mass", self.softening_.mass);
    a("softening_stiffness", self.softening_.stiffness);
    a("data_rounding", self.data_rounding_);
    a("provable", self.provable_);
    a("whole", self.whole_);
    a("scale", self.scale_);
    a("rounding_weights", self.rounding_weights_);
    a("ports", self.parts_.ports);
    a("K", self.parts_.K);
    a("terms", self.parts_.terms);
    a("dropped_ports", self.parts_.dropped_ports);
    a("dropped_K", self.parts_.dropped_K);
    a("dropped_terms", self.parts_.dropped_terms);
    a("mode_mu", self.ritz_.mu);
    a("mode_residual", self.ritz_.residual);
    a("mode_G_norm", self.ritz_.G_norm);
    a("enlarged", self.shifts_.enlarged);
    ProjectionRounding::archive(a, self.rounding_);
    a("coordinates", self.gram_.each);
    a("added", self.gram_.added);
    a("rigid", self.rigid_.rows);
    a("rigid_stiffness", self.rigid_.stiffness);
  }
  /// What is known of the error beyond its norm, for some of the ports. @pre no damping matrix
  /// @return nothing if it is not proved.
  std::optional<ErrorForm> form(const DenseResponse& response,
                                const PortSet& ports) const;
  /// What A couples V to in the rest of the body, the E-orthogonal complement of V, where the
  /// coordinates make E⁻¹ the identity: columns are those of a diagonal system of V.
  struct Couplings {
    Dense ports, M; ///< k × ports in their units, k × N; K couples σ times what M does
    std::vector<Dense> terms; ///< k × N
    double sigma = 0;         ///< ω_c²
    Softening softening = {};
    std::vector<double> dropped_ports; ///< norms of what these do not hold, at most
    double dropped_M = 0;              ///< Frobenius
    std::vector<double> dropped_terms;
    bool provable = false;
  };
  /// @param system  of V, K and M diagonal: columns of U times `unit`.
  Couplings couplings(const DenseSystem& system, const std::vector<double>& unit,
                      const std::vector<int>& ports, const Dense& port_rows) const;
  /// Whether the fields are of the sizes that a model of this order has.
  bool fits(int order, int ports, int modes, int rigid, std::size_t terms) const;

private:
  /// Bounds of the inverse of S over an interval.
  struct Inverse {
    std::complex<double> centre; ///< z₀
    double radius = 0;           ///< ρ + q²δ/(1 − qδ)
    double norm = 0;             ///< q/(1 − qδ)
    bool proved = true;
  };
  Inverse inverse(const DenseResponse& response, const ResponseSeries& x) const;
  /// Residuals W of some ports at the centre of an interval.
  struct ResidualsAt {
    ComplexDense w;
    std::map<std::vector<int>, SquaredValues> squares = {}; ///< of some columns
    const SquaredValues& squares_of(const std::vector<int>& columns);
  };
  /// How far those of a block move from there, at most.
  struct Moved {
    double inputs, outputs;
  };
  double error_of(const Inverse& S, const PortSet& block, const Moved& moved,
                  ResidualsAt& of_inputs, ResidualsAt& of_outputs) const;
  double mode_coupling(const DenseResponse& response, const ResponseSeries& x) const;
  std::vector<std::complex<double>> residual_factors(const DenseResponse& response,
                                                     Interval interval) const;
  struct ResidualParts;
  static std::vector<double> moved(const MatrixSeries& w);
  /// Of some ports: the parts of their residuals, and their columns there.
  struct Chosen {
    const ResidualParts& parts;
    std::vector<int> columns, ports;
    bool of_transposed = false; ///< residuals of A(ω)ᵀ
  };
  Chosen chosen(const std::vector<int>& ports, bool of_transposed = false) const {
    return {parts_, ports, ports, of_transposed};
  }
  static Chosen chosen(const FewResiduals& few);
  double lost(const ResponseSeries& x, int column, const Chosen& of, std::size_t k,
              double factor, const std::vector<double>& of_terms) const;
  /// @param x  the response to these ports.
  MatrixSeries held_residual(const DenseResponse& response, const ResponseSeries& x,
                             const Chosen& of) const;
  MatrixSeries residual(const DenseResponse& response, const ResponseSeries& x,
                        const Chosen& of) const;
  ProjectionRounding::Sizes sizes_of(const ResponseSeries& x,
                                     const std::vector<int>& ports,
                                     const std::vector<int>& columns) const;
  /// Of some ports: what the rounding of their responses is made of.
  struct RoundingSizes {
    ProjectionRounding::Sizes x, ports; ///< of each mode: its coordinate, its ports' own
    double rigid = 0, stiffness = 0;    ///< of the rigid rows
  };
  std::vector<double> off(const std::vector<int>& ports) const;
  RoundingSizes rounding_sizes(const ResponseSeries& x,
                               const std::vector<int>& ports) const;
  RoundingSizes rounding_sizes(const ResponseSeries& factors, const ResidualGrams& grams,
                               std::size_t list) const;
  double lost(const ResponseSeries& factors, const ResidualGrams& grams, std::size_t list,
              double factor) const;
  void add_rounding(Bound& bound, const DenseResponse& response, double omega,
                    const RoundingSizes& in, const RoundingSizes& out) const;

  void enclose_modes();
  /// @param outside  what T U has beyond E V, of each term.
  void couple_terms(const DenseResponse& response, const Dense& K,
                    const std::vector<Dense>& outside);

  ProjectionRounding rounding_;
  Softening softening_;
  double data_rounding_ = 0;
  bool provable_ = true; ///< the residual is known whole, and the modes are counted
  bool whole_ =
      false; ///< V is the whole space: nothing is outside, the error is rounding
  std::vector<double> scale_, rounding_weights_;
  TermCoupling by_terms_; ///< with terms, of a body whose claims are proved; not in files
  /// What K and M are combined by.
  struct Shifts {
    double tau = 0, sigma = 0, kappa = 0, mu_plus = 0;
    double enlarged = 1; ///< (K + τM)⁻¹ of residuals over (K − ω_c²M)⁻¹ at most, its root
  } shifts_;
  /// Parts of the residuals, in coordinates where the Gram matrix is the identity.
  struct ResidualParts {
    Dense ports, K;                               ///< K transposed
    std::vector<Dense> terms;                     ///< so
    std::vector<double> dropped_ports, dropped_K; ///< ‖·‖ in E⁻¹
    std::vector<std::vector<double>> dropped_terms;
    mutable std::shared_ptr<const Dense> sizes_of_K = nullptr;
    /// |K|, made when it is first asked for.
    const Dense& K_sizes() const {
      if (!sizes_of_K) sizes_of_K = std::make_shared<const Dense>(absolute(K));
      return *sizes_of_K;
    }
  };
  ResidualParts parts_;
  /// Φ: μ_j, ‖(K + τM)^−½(Mu − μ(K + τM)u)‖ at most, ‖G_j‖.
  struct RitzVectors {
    std::vector<double> mu, residual, G_norm;
  } ritz_;
  struct GramCoordinates {
    std::vector<double> each; ///< 1/√γ of the Gram matrix' eigenvalues
    double added = 0;         ///< what these hold beyond the norm itself, at most
  } gram_;
  struct RigidRows {
    Dense rows, stiffness; ///< transposed: |rigid rows of U|; |stiffness set to zero|
  } rigid_;
};

struct Certificate::FewResiduals {
  std::vector<int> ports;
  ResidualParts parts; ///< whose ports are these alone
};

struct Certificate::ResidualGrams {
  std::vector<std::vector<int>> ports; ///< each list of them once
  std::vector<TermGram> grams; ///< of each list; none of short ones beside long ones
  FewResiduals few;            ///< the ports of the short lists
  struct Sums {                ///< over a list, in the units of the ports
    Dense B;                   ///< |b_i|ᵀ|b_j| of the modes' rows of B
    std::vector<double> off;   ///< rounding of the ports, of each mode
    double dropped = 0;        ///< squares of what T does not hold of the ports
  };
  std::vector<Sums> sums; ///< of each list
  struct Lists {
    std::size_t inputs, outputs;
  };
  std::vector<Lists> blocks;
};

} // namespace flexgram
