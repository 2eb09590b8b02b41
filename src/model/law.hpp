#pragma once

#include <complex>
#include <vector>

namespace flexgram {

/// The factor g(ω) of a term g(ω)T of A(ω): iω of dampers, i of the imaginary part of a stiffness.
/// It is linear in ω. Its real and imaginary parts are not negative for ω >= 0, and its size does
/// not fall with ω: the certificate needs both (docs/proof.md, section 2).
class Law {
public:
  enum class Kind {
    viscous,   ///< T [N·s/m]
    structural ///< T [N/m], Σ η_k K_k of materials with loss factors
  };
  Law(Kind kind = Kind::viscous) : kind_(kind) {}

  std::complex<double> at(double omega) const {
    return {0.0, kind_ == Kind::viscous ? omega : 1.0};
  }
  /// dg/dω.
  std::complex<double> slope() const { return {0.0, kind_ == Kind::viscous ? 1.0 : 0.0}; }
  /// |g| at most at frequencies up to ω.
  double largest(double omega) const { return at(omega).imag(); }
  /// Im g/ω: the viscous damper that takes as much energy from a vibration.
  double as_damper(double omega) const {
    return kind_ == Kind::viscous ? 1.0 : 1.0 / (omega > 1e-300 ? omega : 1e-300);
  }
  bool is_viscous() const { return kind_ == Kind::viscous; }
  /// The name of T in files and messages: D or S.
  const char* letter() const { return is_viscous() ? "D" : "S"; }
  bool operator==(const Law&) const = default;

private:
  Kind kind_;
};

/// g(ω)T, T symmetric positive semidefinite.
template <class MatrixType>
struct Term {
  Law law;
  MatrixType matrix;
};

/// |g| of each term at most, at frequencies up to ω.
template <class MatrixType>
std::vector<double> largest_of(const std::vector<Term<MatrixType>>& terms, double omega) {
  std::vector<double> sizes;
  for (const auto& term : terms) sizes.push_back(term.law.largest(omega));
  return sizes;
}

} // namespace flexgram
