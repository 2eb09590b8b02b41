/// What rounding does to the projected matrices of a medium model, and so to its H
/// (docs/proof.md, section 6). Of plain sums; sharp_response has that of
/// accurate ones. Made by level_certifier.cpp, kept by the certificate.

#pragma once

#include "medium/space.hpp"
#include "model/dense_system.hpp"

#include <array>
#include <cmath>
#include <string>
#include <type_traits>

namespace flexgram {

/// Σ_k |U_kj| w_k.
std::vector<double> turned_weights(const Dense& U, const std::vector<double>& w);

/// Rounding of the entries of UᵀVᵀAVU, A one of K, M and the terms: entry (i, j) is wrong by at most
/// p_i p_j + p_i f_j + f_i p_j + s_i s_j.
struct EntryRounding {
  std::vector<double>
      plain; ///< p: of each mode what was summed with the digits of doubles
  std::vector<double>
      force; ///< f: and of the others A v, rounded once before it met those
  std::vector<double> sharp; ///< s: what was summed with twice the digits

  /// Σ |x_i||E_ij||y_j| at most, over modes from `first` on.
  double form(const std::vector<double>& x, const std::vector<double>& y,
              std::size_t first) const;
  /// |E||x|.
  std::vector<double> times(const std::vector<double>& x) const;
  /// The same in other coordinates: of QᵀAQ.
  EntryRounding turned(const Dense& Q) const {
    return {turned_weights(Q, plain), turned_weights(Q, force), turned_weights(Q, sharp)};
  }
  double at(std::size_t i, std::size_t j) const {
    return plain[i] * plain[j] + plain[i] * force[j] + force[i] * plain[j] +
           sharp[i] * sharp[j];
  }

  template <class Archive, class Self>
  static void archive(Archive&& a, const std::string& name, Self& self) {
    a(("rounding_" + name).c_str(), self.plain);
    a(("rounding_force_" + name).c_str(), self.force);
    a(("rounding_sharp_" + name).c_str(), self.sharp);
  }
};

/// In the modal coordinates of a level, the exact UᵀVᵀA(ω)VU differs from the diagonal (and the terms)
/// that the level computes with by a matrix E(ω) with, for i ≠ j,
///   |E_ij| <= |a_k| (K_ij + mixed) + ω² (M_ij + mixed/τ) + Σ |g| T_ij,
/// and |E_jj| <= |a_k| (K_jj + rounding of λ_j) + ω² M_jj + Σ |g| T_jj. H differs by x_Cᵀ E x_B.
struct ProjectionRounding {
  EntryRounding K, M; ///< K is 0 of rigid modes
  std::vector<EntryRounding> terms;
  std::vector<double> lambda; ///< rounding of μ_j λ_j
  Dense ports;                ///< of the coordinates of ports, N × ports
  /// ‖δ‖_K at most, δ the rounding of the displacements V u_j of each mode to doubles.
  std::vector<double> strain;
  double mixed = 0;      ///< UᵀKU and τUᵀMU beside their diagonals, each entry
  double mixed_norm = 0; ///< and their Frobenius norm
  double tau = 1;
  double rigid_mass = 0; ///< of ΦᵀMΦ of rigid modes
  int rigid = 0;

  /// Sizes of the coordinates of a response: of each mode the norm over some ports.
  using Sizes = std::vector<double>;
  /// Σ |x_C|ᵀ|E||x_B| at most, but for the rigid part of H. @param a_k, of_terms  its size, |g| of each term.
  double of_response(double a_k, const std::vector<double>& of_terms, double omega,
                     const Sizes& outputs, const Sizes& inputs) const;
  /// The same of rigid modes among themselves, whose mass is summed accurately; not in the former.
  double of_rigid_modes(double omega, const Sizes& outputs, const Sizes& inputs) const;
  /// |E||x|: what the equations of each mode are off by.
  Sizes of_equations(double a_k, double omega, const Sizes& x) const;
  /// |E_ij| with K and M at any ω up to the root of `square`, for undamped modes.
  double between(std::size_t i, std::size_t j, double square) const {
    return K.at(i, j) + square * M.at(i, j) + (1 + square / tau) * mixed +
           (i == j ? lambda[i] : 0.0);
  }
  /// Σ_j of entries (i, j) of K, and of M.
  std::array<std::vector<double>, 2> row_sums() const;
  /// How much of that a mode's plain sums with K and the terms, and with M, are responsible for, as roots
  /// of a diagonal part.
  std::array<double, 2> shares(std::size_t i, double a_k,
                               const std::vector<double>& of_terms, double omega) const {
    double sum = a_k * K.plain[i] * K.plain[i];
    for (std::size_t t = 0; t < terms.size(); ++t)
      sum += of_terms[t] * terms[t].plain[i] * terms[t].plain[i];
    return {std::sqrt(sum), omega * M.plain[i]};
  }

  template <class Archive, class Self>
  static void archive(Archive&& a, Self& self) {
    EntryRounding::archive(a, "K", self.K);
    EntryRounding::archive(a, "M", self.M);
    int count = static_cast<int>(self.terms.size());
    a("rounding_terms", count);
    if constexpr (!std::is_const_v<Self>)
      self.terms.resize(count > 0 && count < 1000 ? as_size(count) : 0);
    for (std::size_t t = 0; t < self.terms.size(); ++t)
      EntryRounding::archive(a, "term_" + std::to_string(t + 1), self.terms[t]);
    a("rounding_lambda", self.lambda);
    a("rounding_ports", self.ports);
    a("rounding_strain", self.strain);
    a("rounding_mixed", self.mixed);
    a("rounding_mixed_norm", self.mixed_norm);
    a("rounding_tau", self.tau);
    a("rounding_rigid_mass", self.rigid_mass);
    a("rounding_rigid", self.rigid);
  }
  bool fits(int order, int ports_count, std::size_t terms_count) const;

  /// How far the coordinates of some ports in mode i are off, in the ports' units.
  /// @param scale  of each port.
  double of_ports(std::size_t i, const std::vector<int>& some,
                  const std::vector<double>& scale) const;
  /// Takes `mixed` and its norm from what stands beside the diagonals, and what may be added to
  /// each entry. @param first  modes before are left out.
  void take_mixed(const Dense& of_K, const Dense& of_M, int first, double added = 0);
};

/// Of the plain sums that the space holds, and of plain products of small matrices.
/// @param loads  all ports, scaled.
ProjectionRounding plain_rounding(const MediumSpace& space, const DenseResponse& response,
                                  const Block& loads);
/// The same but for products of small matrices, as if they were exact.
ProjectionRounding rounding_of_sums(const MediumSpace& space,
                                    const DenseResponse& response, const Block& loads);

/// Adds what null vectors φ of K among the rigid modes have left: they differ from those of the
/// stored numbers by δ, Kδ = Kφ: of an elastic mode u they hold uᵀKφ/uᵀKu, which shows in their
/// ports and in M.
void add_null_vectors(ProjectionRounding& rounding, const MediumSpace& space,
                      const DenseResponse& response);

} // namespace flexgram
