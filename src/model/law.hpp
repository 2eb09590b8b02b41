/// What multiplies the matrix of a term g(ω)T of A(ω). Each file of model/laws defines a kind of
/// factor g, with the file's name; their table is made by CMake.

#pragma once

#include "linalg/dense.hpp"
#include "model/spec.hpp"

#include <algorithm>
#include <complex>
#include <map>
#include <memory>
#include <string>
#include <vector>

namespace flexgram {

/// g on an interval: Σ γ_k t^k, ω = centre + half t, |t| <= 1, and a rest.
struct LawSeries {
  std::vector<std::complex<double>> coefficients; ///< two or more
  /// What the series leaves, at most; also less what it leaves at the centre.
  double rest = 0;

  /// |g| differs from its value at the centre by at most this.
  double moved() const;
  /// What comes beyond the linear part, at most.
  double beyond_linear() const;
};

/// Numbers that a law is made of, by their names in files.
using LawNumbers = std::map<std::string, std::vector<double>>;

/// A kind of factor with its numbers. For ω >= 0 its real and imaginary parts are not negative:
/// the certificate needs that (docs/proof.md, section 2).
class LawKind {
public:
  virtual ~LawKind() = default;
  /// Those of t^0 … t^degree, two at least.
  virtual std::vector<std::complex<long double>> coefficients(const Interval& interval,
                                                              int degree) const = 0;
  /// |g − Σ γ_k t^k| at most.
  virtual double rest(const Interval& /*interval*/, int /*degree*/) const { return 0; }
  /// |g| at most at frequencies up to ω.
  virtual double largest(double omega) const = 0;
  /// Frequencies where g is not smooth, ascending.
  virtual std::vector<double> breaks() const { return {}; }
  /// Whether g is (1 + iη + iωβ) times a number: a stiffness with its own η and β.
  virtual bool is_stiffness() const { return false; }
  /// Whether g is iω times a number.
  virtual bool is_of_rates() const { return false; }
  /// Whether it belongs to a skew matrix T, Tᵀ = −T.
  virtual bool is_skew() const { return false; }
  /// Whether g T takes nothing from the Hermitian part of A: T is positive semidefinite, or it is
  /// skew and g is real.
  virtual bool is_semidefinite() const { return !is_skew(); }
  /// The parameter that g depends on, known between two numbers `least` and `most`, with a `value`
  /// now; empty: none. Several terms can depend on one. @param term  the name of T.
  virtual std::string parameter(const std::string& /*term*/) const { return {}; }
  /// Coefficients of t^k in g over g at the most, the parameter being centre + half t: what it is of
  /// the parameter, whatever ω.
  virtual std::vector<double> shares(const Interval& /*values*/) const { return {1.0}; }
  /// The frequencies at which g is known.
  virtual Interval known() const;
  virtual LawNumbers numbers() const { return {}; }
  /// A phrase for the plan.
  virtual std::string words() const = 0;
};

/// @throws Error unless least, value and most are speeds that rise.
void expect_speeds(const char* law, const LawNumbers& numbers);

/// A way to make a kind of factor. Each file of model/laws defines one.
struct LawMaker {
  const char* help; ///< a phrase for messages
  std::vector<std::string> numbers;
  /// @throws Error naming what is wrong with the numbers.
  std::unique_ptr<LawKind> (*make)(const LawNumbers& numbers);
};

/// All kinds by name.
const std::vector<std::pair<std::string, const LawMaker*>>& law_makers();

/// Names of the numbers that a kind is made of, or a product, "parameter*prony"; none of a kind that
/// is none.
std::vector<std::string> numbers_of_law(const std::string& kind);

/// Name of the term that holds the skew part of K.
inline constexpr const char* skew_part_of_K = "skew_K";

/// The factor g(ω) of a term g(ω)T of A(ω), with the name of T in files and messages: iω of
/// dampers D, i of the imaginary part S of a stiffness, and those of viscoelastic materials.
class Law {
public:
  enum class Kind {
    viscous,    ///< T [N·s/m]: D
    structural, ///< T [N/m], Σ η_k K_k of materials with loss factors: S
    gyroscopic  ///< T [N·s/m], skew: G
  };
  Law(Kind kind = Kind::viscous);
  /// @throws Error for a kind that is none, or numbers that make no factor.
  Law(std::string name, const std::string& kind, const LawNumbers& numbers);

  std::complex<double> at(double omega) const;
  LawSeries series(const Interval& interval, int degree) const;
  const LawKind& kind() const { return *kind_; }
  double largest(double omega) const { return kind_->largest(omega); }
  /// Im g/ω: the viscous damper that takes as much energy from a vibration.
  double as_damper(double omega) const;
  bool is_viscous() const { return kind_name_ == "viscous"; }
  bool is_structural() const { return kind_name_ == "structural"; }
  /// Whether T is skew: A(ω) is not symmetric.
  bool is_skew() const { return kind_->is_skew(); }
  bool is_semidefinite() const { return kind_->is_semidefinite(); }
  Symmetry symmetry() const { return is_skew() ? Symmetry::skew : Symmetry::symmetric; }
  /// Whether g is iω times a number, `as_damper`.
  bool is_of_rates() const { return kind_->is_of_rates(); }
  /// Whether T is a skew stiffness, g = 1 or a parameter.
  bool is_circulatory() const;
  /// Whether the equations of motion in time have it as it is: poles are eigenvalues.
  bool is_linear() const { return is_of_rates() || is_circulatory(); }
  /// The parameter that g depends on; empty: none.
  std::string parameter() const { return kind_->parameter(name_); }
  bool varies() const { return !parameter().empty(); }
  std::vector<double> shares(const Interval& values) const {
    return kind_->shares(values);
  }
  /// Whether a stiffness is itself what is known between two numbers only.
  bool is_parameter() const { return kind_name_ == "parameter"; }
  /// Whether it is a parameter times another law (`product_law`).
  bool is_product() const;
  /// A number that the law has one of. @pre it has.
  double number(const std::string& name) const;
  /// The same law with another number.
  Law with(const std::string& number, double value) const;
  /// Whether it has a name of its own, beside D, S and G.
  bool is_named() const {
    return !is_viscous() && !is_structural() && kind_name_ != "gyroscopic";
  }
  const std::string& name() const { return name_; }
  const std::string& kind_name() const { return kind_name_; }
  /// Where T lies in a file: /D, /S, /G, else /terms/NAME.
  std::string path() const;
  bool operator==(const Law& other) const {
    return name_ == other.name_ && kind_name_ == other.kind_name_ &&
           kind_->numbers() == other.kind_->numbers();
  }

private:
  std::string name_, kind_name_;
  std::shared_ptr<const LawKind> kind_;
};

/// g(ω)T, T symmetric, positive semidefinite unless its law says otherwise, or skew.
template <class MatrixType>
struct Term {
  Law law;
  MatrixType matrix;
};

/// Whether A(ω) is symmetric.
template <class MatrixType>
bool is_symmetric(const std::vector<Term<MatrixType>>& terms) {
  return std::none_of(terms.begin(), terms.end(),
                      [](const auto& term) { return term.law.is_skew(); });
}

/// Whether no term takes from the real part of A(ω).
template <class MatrixType>
bool are_semidefinite(const std::vector<Term<MatrixType>>& terms) {
  return std::all_of(terms.begin(), terms.end(),
                     [](const auto& term) { return term.law.is_semidefinite(); });
}

/// The factors of A(ω)ᵀ with the same T: −g of skew ones.
template <class MatrixType>
std::vector<std::complex<double>> transposed(std::vector<std::complex<double>> g,
                                             const std::vector<Term<MatrixType>>& terms) {
  for (std::size_t t = 0; t < g.size(); ++t)
    if (terms[t].law.is_skew()) g[t] = -g[t];
  return g;
}

/// |g| of each term at most, at frequencies up to ω.
template <class MatrixType>
std::vector<double> largest_of(const std::vector<Term<MatrixType>>& terms, double omega) {
  std::vector<double> sizes;
  for (const auto& term : terms) sizes.push_back(term.law.largest(omega));
  return sizes;
}

} // namespace flexgram
