#include "medium/residual_basis.hpp"

#include "base/event.hpp"
#include "base/index.hpp"
#include "linalg/decompositions.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>

namespace flexgram {
namespace {

using Complex = std::complex<double>;

constexpr double may_be_lost = 1e-10; ///< of a column
/// What rounding leaves of K v, rows scaled, is about this part of √(vᵀ diag(K) v).
constexpr double rounding_of_product = 64 * std::numeric_limits<double>::epsilon();

/// Coordinates of a part of the residuals, and of each column what is no more than rounding.
struct Part {
  const Dense* coordinates;
  std::vector<double> rounding; ///< empty: 0
  double rounding_of(int column) const {
    return rounding.empty() ? 0.0 : rounding[as_size(column)];
  }
};

/// P B, P K V and the terms' parts. Modes that are found well leave no more of K V than rounding.
std::vector<Part> parts_of(const MediumSpace& space) {
  std::vector<Part> parts;
  for (const Dense* a : space.residual().parts()) parts.push_back({a, {}});
  for (double g : space.rounding_weights())
    parts[1].rounding.push_back(rounding_of_product * g);
  return parts;
}

/// Columns S beside orthonormal ones T: S = T inside + more outside + what was dropped.
struct Span {
  Basis T;               ///< and what S has more
  Dense inside, outside; ///< ·×q
  std::vector<double> dropped;
  int held = 0; ///< columns of the former T

  /// The coordinates of (T S) a in the longer T.
  Dense coordinates(const Dense& a) const {
    if (a.data.empty()) return Dense();
    const Dense of_S = part_of(a, held, a.rows - held, 0, a.columns);
    Dense result(held + outside.rows, a.columns), top = multiply(inside, of_S);
    add_to(top, part_of(a, 0, held, 0, a.columns));
    set_part(result, 0, 0, top);
    set_part(result, held, 0, multiply(outside, of_S));
    return result;
  }
};

/// How large a column of S is where it counts: a share of this changes no part (T S) a by more than
/// that share of its norm, or by rounding. @param gram  of S without T.
std::vector<double> sizes_of(const Span& span, const Dense& gram,
                             const std::vector<Part>& parts) {
  const int q = gram.rows;
  std::vector<double> size(as_size(q), HUGE_VAL);
  for (const Part& part : parts) {
    const Dense* const a = part.coordinates;
    if (a->data.empty()) continue;
    const Dense of_S = part_of(*a, span.held, q, 0, a->columns),
                outside = multiply(gram, of_S);
    Dense inside = multiply(span.inside, of_S);
    add_to(inside, part_of(*a, 0, span.held, 0, a->columns));
    for (int i = 0; i < a->columns; ++i) {
      double square = 0;
      for (int k = 0; k < span.held; ++k) square += inside(k, i) * inside(k, i);
      for (int k = 0; k < q; ++k) square += of_S(k, i) * outside(k, i);
      const double counts =
          std::max(std::sqrt(std::max(square, 0.0)), part.rounding_of(i) / may_be_lost);
      for (int j = 0; j < q; ++j)
        if (of_S(j, i) != 0)
          size[as_size(j)] = std::min(size[as_size(j)], counts / std::abs(of_S(j, i)));
    }
  }
  for (int j = 0; j < q; ++j) { // no smaller than rounding allows
    double square = gram(j, j);
    for (int k = 0; k < span.held; ++k) square += span.inside(k, j) * span.inside(k, j);
    const double norm = std::sqrt(std::max(square, 0.0));
    if (!(size[as_size(j)] < HUGE_VAL)) size[as_size(j)] = norm; // of no part
    size[as_size(j)] = std::max(size[as_size(j)], 1e-7 * norm);
  }
  return size;
}

/// Directions of the columns of S that T does not hold, each column by its size: eigenvectors of
/// SᵀS, which show half the digits of what is left. If they leave more than 1e-10 of a column, the
/// rest is looked at once more. Rounding of the solves that made V, about 1e-9, is then held: what is
/// lost counts hundreds of times in E⁻¹ where E is nearly singular beyond the modes, as of thin
/// bodies.
/// @param T  orthonormal. @param S  is overwritten.
Span span_of(MPI_Comm comm, Basis T, Basis S, const std::vector<Part>& parts) {
  const int q = static_cast<int>(S.columns());
  Span span;
  span.held = static_cast<int>(T.columns());
  span.inside = Dense(span.held, q);
  span.outside = Dense(0, q);
  for (int twice = 0; twice < 2 && T; ++twice)
    S.for_each([&](Block& piece, int first) {
      const Dense c = inner(T, piece);
      add_product(piece, -1.0, T, c);
      for (int j = 0; j < c.columns; ++j)
        for (int i = 0; i < c.rows; ++i) span.inside(i, first + j) += c(i, j);
    });
  span.T = std::move(T);
  std::vector<double> size;
  for (int pass = 0; pass < 3; ++pass) {
    Dense gram = symmetric_inner(S, S);
    share_from_first(comm, gram.data);
    span.dropped.clear();
    for (int j = 0; j < q; ++j)
      span.dropped.push_back(std::sqrt(std::max(gram(j, j), 0.0)));
    if (pass == 0) {
      size = sizes_of(span, gram, parts);
      share_from_first(comm, size);
    }
    const auto relative = [&](int j) {
      const auto at = as_size(j);
      return size[at] > 0 ? span.dropped[at] / size[at] : 0.0;
    };
    double left = 0;
    for (int j = 0; j < q; ++j) left = std::max(left, relative(j));
    if (left < may_be_lost) break;
    for (int j = 0; j < q; ++j)
      for (int i = 0; i < q; ++i) {
        const double d = size[as_size(i)] * size[as_size(j)];
        gram(i, j) = d > 0 ? gram(i, j) / d : 0.0;
      }
    SymmetricEigen eigen = symmetric_eigen(gram);
    share_from_first(comm, eigen.values);
    share_from_first(comm, eigen.vectors.data);
    const double least =
        std::max(1e-15 * q * eigen.values.back(), may_be_lost * may_be_lost);
    int r = 0;
    while (r < q && eigen.values[as_size(q - 1 - r)] > least) ++r;
    const auto strongest = [&](int count) -> std::optional<Block> {
      Dense combination(q, count);
      for (int j = 0; j < count; ++j)
        for (int i = 0; i < q; ++i) {
          const double d = size[as_size(i)];
          combination(i, j) = d > 0
                                  ? eigen.vectors(i, q - 1 - j) /
                                        (d * std::sqrt(eigen.values[as_size(q - 1 - j)]))
                                  : 0.0;
        }
      Block found = combine(S, combination);
      for (int twice = 0; twice < 2; ++twice) { // orthonormal to working accuracy
        if (span.T) add_product(found, -1.0, span.T, inner(span.T, found));
        Dense l = inner(found, found);
        symmetrise(l);
        share_from_first(comm, l.data);
        if (cholesky(l) != 0) return std::nullopt;
        found = combine(found, inverse_transposed(l));
      }
      return found;
    };
    std::optional<Block> block;
    while (r > 0 && !(block = strongest(r))) r /= 2; // the weak ones are rounding
    if (r == 0) break;
    Block found = std::move(*block);
    Dense more(r, q);
    S.for_each([&](Block& piece, int first) {
      const Dense c = inner(found, piece);
      set_part(more, 0, first, c);
      add_product(piece, -1.0, found, c);
    });
    const int before = span.outside.rows;
    Dense all(before + r, q);
    set_part(all, 0, 0, span.outside);
    set_part(all, before, 0, more);
    span.outside = std::move(all);
    span.T.append(std::move(found));
  }
  return span;
}

/// √Σ_i (norms_i a_ij)²: what columns that are combinations of others lose with them. It
/// is rounding of the solves that made the space, so its squares add up.
std::vector<double> combined(const std::vector<double>& norms, const Dense& a) {
  std::vector<double> result;
  for (int j = 0; j < a.columns; ++j) {
    double sum = 0;
    for (int i = 0; i < a.rows; ++i) sum += std::pow(norms[as_size(i)] * a(i, j), 2);
    result.push_back(std::sqrt(sum));
  }
  return result;
}

/// T u_j = Σ_i E u_i (UᵀTU)_ij/e_i + what VᵀR = 0 leaves.
void take_terms_apart(ResidualBasis& basis, const DenseResponse& response, double kappa,
                      double cutoff) {
  const double sigma = cutoff * cutoff;
  basis.terms_outside = basis.terms;
  for (std::size_t t = 0; t < basis.terms.size(); ++t) {
    Dense parts_of_V = response.modal_terms()[t];
    for (int i = 0; i < parts_of_V.rows; ++i) {
      const double e = response.energy(i, sigma); // uᵀEu, E = K − ω_c²M
      for (int j = 0; j < parts_of_V.columns; ++j) parts_of_V(i, j) /= e;
    }
    const Dense taken = multiply(basis.K, parts_of_V);
    Dense& outside = basis.terms_outside[t];
    for (std::size_t i = 0; i < outside.data.size(); ++i)
      outside.data[i] -= (1 + kappa * sigma) * taken.data[i];
  }
}

} // namespace

ComplexDense residual_of(const Dense& ports, const Dense& K,
                         const std::vector<Dense>& terms, double kappa,
                         const ShiftCoefficients& c, const ComplexDense& x) {
  ComplexDense r = multiply(K, x);
  const Complex factor = -(c.k - kappa * c.m);
  for (std::size_t i = 0; i < r.data.size(); ++i)
    r.data[i] = ports.data[i] + factor * r.data[i];
  for (std::size_t t = 0; t < terms.size(); ++t) {
    const ComplexDense d = multiply(terms[t], x);
    for (std::size_t i = 0; i < r.data.size(); ++i) r.data[i] -= c.terms[t] * d.data[i];
  }
  return r;
}

void turn_residual(ResidualBasis& basis, const Dense& Q, const DenseResponse& response,
                   double kappa, double cutoff) {
  basis.K = multiply(basis.K, Q);
  basis.dropped_K = combined(basis.dropped_K, Q);
  for (Dense& T : basis.terms) T = multiply(T, Q);
  for (auto& dropped : basis.dropped_terms) dropped = combined(dropped, Q);
  take_terms_apart(basis, response, kappa, cutoff);
}

namespace {

/// √(before² + added²) of each column: what was lost before is still missing.
std::vector<double> lost_too(const std::vector<double>& before,
                             const std::vector<double>& added) {
  std::vector<double> result;
  for (std::size_t j = 0; j < before.size(); ++j)
    result.push_back(std::hypot(before[j], added[j]));
  return result;
}

/// [a b …], each column of norm 1, or of less where much of it is rounding. Columns of
/// zeros are left out. @param least  singular values that count.
Dense of_norm_one(const std::vector<Part>& parts, int rows, double least) {
  std::vector<double> entries;
  int columns = 0;
  for (const Part& part : parts) {
    const Dense* const a = part.coordinates;
    for (int j = 0; j < a->columns; ++j) {
      double square = 0;
      for (int i = 0; i < rows; ++i) square += (*a)(i, j) * (*a)(i, j);
      if (!(square > 0)) continue;
      const double size = std::max(std::sqrt(square), part.rounding_of(j) / least);
      for (int i = 0; i < rows; ++i) entries.push_back((*a)(i, j) / size);
      ++columns;
    }
  }
  Dense all(rows, columns);
  all.data = std::move(entries);
  return all;
}

/// Norms of the columns of a without Q Qᵀa.
std::vector<double> norms_outside(const Dense& Q, const Dense& a) {
  Dense rest = multiply(Q, multiply_transposed(Q, a));
  for (std::size_t i = 0; i < rest.data.size(); ++i)
    rest.data[i] = a.data[i] - rest.data[i];
  std::vector<double> norms;
  for (int j = 0; j < a.columns; ++j) {
    double square = 0;
    for (int i = 0; i < a.rows; ++i) square += rest(i, j) * rest(i, j);
    norms.push_back(std::sqrt(square));
  }
  return norms;
}

} // namespace

void orthonormalise_residual(MediumSpace& space) {
  static Event event("ResidualBasis");
  const auto timed = event.timed();
  const MediumSpace::Residual& parts = space.residual();
  if (parts.orthonormal == parts.S.columns()) return;
  Basis T, S;
  parts.S.for_each([&](const Block& piece, int first) {
    (first < parts.orthonormal ? T : S).append(piece.share());
  });
  // All that S spans stays: what is small in these residuals may not be in later ones.
  Span span = span_of(space.fom().comm, std::move(T), std::move(S), parts_of(space));
  const auto lost = [&](const std::vector<double>& before, const Dense& a) {
    if (a.data.empty()) return before;
    const Dense of_S = part_of(a, span.held, a.rows - span.held, 0, a.columns);
    return lost_too(before, combined(span.dropped, of_S));
  };
  MediumSpace::Residual smaller{Basis(),
                                static_cast<int>(span.T.columns()),
                                span.coordinates(parts.B),
                                span.coordinates(parts.K),
                                {},
                                lost(parts.lost_B, parts.B),
                                lost(parts.lost_K, parts.K),
                                {}};
  for (std::size_t t = 0; t < parts.terms.size(); ++t) {
    smaller.terms.push_back(span.coordinates(parts.terms[t]));
    smaller.lost_terms.push_back(lost(parts.lost_terms[t], parts.terms[t]));
  }
  smaller.S = std::move(span.T);
  space.compress_residual(std::move(smaller));
}

std::optional<Dense> directions_of_residual(const MediumSpace& space, int solved,
                                            int most) {
  const MediumSpace::Residual& parts = space.residual();
  const int r = parts.orthonormal;
  const auto pays = [&](int rank) {
    return 2 * rank <= r || rank < r - solved || (rank <= most && most < r);
  };
  if (r == 0 || !pays(parts.B.columns)) return std::nullopt; // ports are seldom alike
  constexpr double least = 1e-9;
  LeftSvd svd = left_svd(compressed(of_norm_one(parts_of(space), r, least)));
  share_from_first(space.fom().comm, svd.values);
  share_from_first(space.fom().comm, svd.vectors.data);
  int rank = 0;
  while (rank < svd.vectors.columns && svd.values[as_size(rank)] > least) ++rank;
  if (!pays(rank)) return std::nullopt;
  return first_columns(svd.vectors, rank);
}

void turn_residual_parts(MediumSpace& space, const Dense& Q) {
  const MediumSpace::Residual& parts = space.residual();
  const auto turned = [&](const Dense& a) {
    return a.data.empty() ? Dense() : multiply_transposed(Q, a);
  };
  const auto lost = [&](const std::vector<double>& before, const Dense& a) {
    return a.data.empty() ? before : lost_too(before, norms_outside(Q, a));
  };
  MediumSpace::Residual fewer{combine(parts.S, Q),
                              Q.columns,
                              turned(parts.B),
                              turned(parts.K),
                              {},
                              lost(parts.lost_B, parts.B),
                              lost(parts.lost_K, parts.K),
                              {}};
  for (std::size_t t = 0; t < parts.terms.size(); ++t) {
    fewer.terms.push_back(turned(parts.terms[t]));
    fewer.lost_terms.push_back(lost(parts.lost_terms[t], parts.terms[t]));
  }
  space.compress_residual(std::move(fewer));
}

ResidualBasis residual_basis(const MediumSpace& space, const DenseResponse& response,
                             const std::vector<double>& samples,
                             const std::vector<ParameterValues>& values, int modes,
                             double cutoff, int most) {
  const int p = response.system().B.columns, N = response.system().order();
  const MediumSpace::Residual& parts = space.residual();
  const int r = parts.orthonormal;
  ResidualBasis basis;
  basis.dropped_ports = parts.lost_B;
  basis.dropped_K = combined(parts.lost_K, response.U());
  for (const auto& lost : parts.lost_terms)
    basis.dropped_terms.push_back(combined(lost, response.U()));
  const auto turned = [&](const Dense& a) {
    return r > 0 ? multiply(a, response.U()) : Dense(0, N);
  };
  basis.ports = r > 0 ? parts.B : Dense(0, p);
  basis.K = turned(parts.K);
  for (const Dense& T : parts.terms) basis.terms.push_back(turned(T));
  take_terms_apart(basis, response, space.kappa(), cutoff);
  basis.complete = r <= most;
  if (basis.complete) return basis;

  // What the residuals are made of over the band and with each of the values, each response
  // relative to its size: enough for a Krylov block, not for a proof.
  std::vector<DenseResponse> responses;
  for (const ParameterValues& of : values) responses.push_back(response.at(of));
  if (values.empty()) responses.push_back(response);

  const std::vector<Term<Dense>>& terms = response.system().terms;
  const int sides = is_symmetric(terms) ? 1 : 2; // A(ω)ᵀ too
  Dense all(r, 2 * p * sides * static_cast<int>(samples.size() * responses.size()));
  int next = 0;
  const auto add = [&](const DenseResponse& with, bool is_transposed) {
    for (double omega : samples) {
      const ComplexDense x = with.modal_response(omega);
      const double size = std::sqrt(frobenius_norm(with.transfer(x)));
      ShiftCoefficients c = with.system().coefficients(omega);
      if (is_transposed) c.terms = transposed(std::move(c.terms), terms);
      const ComplexDense residual =
          residual_of(basis.ports, basis.K, basis.terms, space.kappa(), c, x);
      for (int j = 0; j < p; ++j, next += 2)
        for (int i = 0; i < r && size > 0; ++i) {
          all(i, next) = residual(i, j).real() / size;
          all(i, next + 1) = residual(i, j).imag() / size;
        }
    }
  };
  for (const DenseResponse& with : responses) {
    add(with, false);
    if (sides == 2) add(with.transposed(), true);
  }
  double largest = 0;
  for (double v : all.data) largest = std::max(largest, std::abs(v));
  // Residuals of the modes, so that angles above some 1e-6 are seen, and the dampers'
  // part.
  Dense of_modes = first_columns(basis.K, modes);
  for (int j = 0; j < modes; ++j) {
    const double lambda = response.lambda()[as_size(j)];
    for (int i = 0; i < r; ++i)
      of_modes(i, j) *=
          largest * (cutoff * cutoff + space.tau()) / (cutoff * cutoff - lambda);
  }
  all = beside(all, of_modes);
  for (const Dense& outside : basis.terms_outside) {
    double size = 0;
    Dense scaled = first_columns(outside, modes);
    for (double v : scaled.data) size = std::max(size, std::abs(v));
    for (double& v : scaled.data) v *= size > 0 ? largest / size : 0.0;
    all = beside(all, scaled);
  }
  LeftSvd svd = left_svd(compressed(all));
  share_from_first(space.fom().comm, svd.values);
  share_from_first(space.fom().comm, svd.vectors.data);
  const Dense u = first_columns(svd.vectors, std::min(most, svd.vectors.columns));
  const auto turn = [&](Dense& a) {
    if (!a.data.empty()) a = multiply_transposed(u, a);
  };
  turn(basis.ports);
  turn(basis.K);
  for (Dense& T : basis.terms) turn(T);
  for (Dense& T : basis.terms_outside) turn(T);
  basis.cut = u;
  return basis;
}

} // namespace flexgram
