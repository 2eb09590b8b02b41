/// A basis T of what residuals are made of, R(ω) = T(…) + what was dropped
/// (docs/proof.md, section 3, "W"). Declared in certificate.hpp, called by level_certifier.cpp.

#include "base/event.hpp"
#include "base/index.hpp"
#include "linalg/decompositions.hpp"
#include "medium/certificate.hpp"

#include <algorithm>
#include <cmath>
#include <map>

namespace flexgram {
namespace {

using Complex = std::complex<double>;

/// T orthonormal with S = T coordinates + what was dropped, and the norm of that in each
/// column. S becomes the latter.
struct Span {
  Block T;
  Dense coordinates; ///< r×q
  std::vector<double> dropped;
};

/// Directions of the columns of S, each column by its size: eigenvectors of SᵀS, which
/// show half the digits. If they leave more than that of a column, the rest is looked at
/// once more; rounding of the solves that made V is about 1e-9 and not worth directions.
Span span_of(MPI_Comm comm, Basis S) {
  const int q = static_cast<int>(S.columns());
  Span span{Block(), Dense(0, q), {}};
  std::vector<double> size;
  for (int pass = 0; pass < 3; ++pass) {
    Dense gram = symmetric_inner(S, S);
    share_from_first(comm, gram.data);
    span.dropped.clear();
    for (int j = 0; j < q; ++j)
      span.dropped.push_back(std::sqrt(std::max(gram(j, j), 0.0)));
    if (pass == 0) size = span.dropped;
    const auto relative = [&](int j) {
      const auto at = as_size(j);
      return size[at] > 0 ? span.dropped[at] / size[at] : 0.0;
    };
    double left = 0;
    for (int j = 0; j < q; ++j) left = std::max(left, relative(j));
    if (left < 1e-8) break;
    for (int j = 0; j < q; ++j)
      for (int i = 0; i < q; ++i) {
        const double d = size[as_size(i)] * size[as_size(j)];
        gram(i, j) = d > 0 ? gram(i, j) / d : 0.0;
      }
    SymmetricEigen eigen = symmetric_eigen(gram);
    share_from_first(comm, eigen.values);
    share_from_first(comm, eigen.vectors.data);
    const double least = 1e-15 * q * (pass == 0 ? eigen.values.back() : 1.0);
    int r = 0;
    while (r < q && eigen.values[as_size(q - 1 - r)] > least) ++r;
    if (r == 0) break;
    Dense combination(q, r);
    for (int j = 0; j < r; ++j)
      for (int i = 0; i < q; ++i) {
        const double d = size[as_size(i)];
        combination(i, j) = d > 0 ? eigen.vectors(i, q - 1 - j) /
                                        (d * std::sqrt(eigen.values[as_size(q - 1 - j)]))
                                  : 0.0;
      }
    Block found = combine(S, combination);
    for (int twice = 0; twice < 2; ++twice) { // orthonormal to working accuracy
      if (span.T) add_product(found, -1.0, span.T, inner(span.T, found));
      Dense l = inner(found, found);
      symmetrise(l);
      share_from_first(comm, l.data);
      if (cholesky(l) != 0) throw Error("the parts of the residual have no basis");
      found = combine(found, inverse_transposed(l));
    }
    Dense parts(r, q);
    S.for_each([&](Block& piece, int first) {
      const Dense c = inner(found, piece);
      set_part(parts, 0, first, c);
      add_product(piece, -1.0, found, c);
    });
    const int before = span.coordinates.rows;
    Dense all(before + r, q);
    set_part(all, 0, 0, span.coordinates);
    set_part(all, before, 0, parts);
    span.coordinates = std::move(all);
    span.T = span.T ? concatenate(span.T, found) : found.share();
  }
  if (!span.T) span.T = combine(S, Dense(q, 0));
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

/// ports − (a_k − κ a_m) K x − a_d D x
ComplexDense residual_of(const Dense& ports, const Dense& K, const Dense& D, double kappa,
                         const ShiftCoefficients& c, const ComplexDense& x) {
  ComplexDense r = multiply(K, x);
  const Complex factor = -(c.k - kappa * c.m);
  for (std::size_t i = 0; i < r.data.size(); ++i)
    r.data[i] = ports.data[i] + factor * r.data[i];
  if (!D.data.empty()) {
    const ComplexDense d = multiply(D, x);
    for (std::size_t i = 0; i < r.data.size(); ++i) r.data[i] -= c.d * d.data[i];
  }
  return r;
}

/// D u_j = Σ_i E u_i (UᵀDU)_ij/e_i + what VᵀR = 0 leaves.
void take_damping_apart(ResidualBasis& basis, const DenseResponse& response, double kappa,
                        double cutoff) {
  if (!response.system().has_extra_damping()) return;
  const double sigma = cutoff * cutoff;
  Dense parts_of_V = response.modal_damping();
  for (int i = 0; i < parts_of_V.rows; ++i) {
    const double e = response.energy(i, sigma); // uᵀEu, E = K − ω_c²M
    for (int j = 0; j < parts_of_V.columns; ++j) parts_of_V(i, j) /= e;
  }
  basis.damped_outside = basis.D;
  const Dense taken = multiply(basis.K, parts_of_V);
  for (std::size_t i = 0; i < basis.damped_outside.data.size(); ++i)
    basis.damped_outside.data[i] -= (1 + kappa * sigma) * taken.data[i];
}

} // namespace

void turn_residual(ResidualBasis& basis, const Dense& Q, const DenseResponse& response,
                   double kappa, double cutoff) {
  basis.K = multiply(basis.K, Q);
  basis.dropped_K = combined(basis.dropped_K, Q);
  if (!basis.D.data.empty()) basis.D = multiply(basis.D, Q);
  if (!basis.dropped_D.empty()) basis.dropped_D = combined(basis.dropped_D, Q);
  take_damping_apart(basis, response, kappa, cutoff);
}

ResidualBasis residual_basis(MediumSpace& space, const DenseResponse& response,
                             const std::vector<double>& samples, int modes, double cutoff,
                             int most) {
  static Event event("ResidualBasis");
  const auto timed = event.timed();
  const bool damped = response.system().has_extra_damping();
  const int p = response.system().B.columns, N = response.system().order();
  const SecondOrderModel& fom = space.fom();
  ResidualBasis basis;
  basis.dropped_ports.assign(as_size(p), 0.0);
  basis.dropped_K.assign(as_size(N), 0.0);
  if (damped) basis.dropped_D = basis.dropped_K;
  if (space.residual().S) {
    // All that S spans stays: what is small in these residuals may not be in later ones.
    const MediumSpace::Residual& parts = space.residual();
    Span span = span_of(fom.comm, parts.S.share());
    const auto in_range = [&](const Dense& a) {
      return a.data.empty() ? Dense() : multiply(span.coordinates, a);
    };
    // What was lost before is still missing.
    const auto lost = [&](std::vector<double> before, const Dense& a) {
      const std::vector<double> added = combined(span.dropped, a);
      for (std::size_t j = 0; j < added.size(); ++j)
        before[j] = std::hypot(before[j], added[j]);
      return before;
    };
    std::vector<double> lost_B = lost(parts.lost_B, parts.B),
                        lost_K = lost(parts.lost_K, parts.K), lost_D;
    if (damped) lost_D = lost(parts.lost_D, parts.D);
    basis.dropped_ports = lost_B;
    basis.dropped_K = combined(lost_K, response.U());
    if (damped) basis.dropped_D = combined(lost_D, response.U());
    space.compress_residual({span.T.share(), in_range(parts.B), in_range(parts.K),
                             in_range(parts.D), std::move(lost_B), std::move(lost_K),
                             std::move(lost_D)});
  }
  const MediumSpace::Residual& parts = space.residual();
  const int r = static_cast<int>(parts.S.columns());
  if (r == 0) {
    basis.T = Block(fom.comm, fom.rows, fom.n, 0);
    basis.ports = Dense(0, p);
    basis.K = Dense(0, N);
    if (damped) basis.D = Dense(0, N);
  } else {
    basis.ports = parts.B;
    basis.K = multiply(parts.K, response.U());
    if (damped) basis.D = multiply(parts.D, response.U());
  }
  take_damping_apart(basis, response, space.kappa(), cutoff);
  if (r == 0) return basis;
  basis.complete = r <= most;
  if (basis.complete) {
    basis.T = combine(parts.S, identity(r));
    space.unscale(basis.T);
    return basis;
  }

  // What the residuals are made of over the band, each frequency relative to its
  // response: enough for a Krylov block, not for a proof.
  Dense all(r, 2 * p * static_cast<int>(samples.size()));
  int next = 0;
  for (double omega : samples) {
    const ComplexDense x = response.modal_response(omega);
    const double size = std::sqrt(frobenius_norm(response.transfer(x)));
    const ComplexDense residual =
        residual_of(basis.ports, basis.K, basis.D, space.kappa(),
                    response.system().coefficients(omega), x);
    for (int j = 0; j < p; ++j, next += 2)
      for (int i = 0; i < r && size > 0; ++i) {
        all(i, next) = residual(i, j).real() / size;
        all(i, next + 1) = residual(i, j).imag() / size;
      }
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
  if (damped) {
    double size = 0;
    Dense scaled = first_columns(basis.damped_outside, modes);
    for (double v : scaled.data) size = std::max(size, std::abs(v));
    for (double& v : scaled.data) v *= size > 0 ? largest / size : 0.0;
    all = beside(all, scaled);
  }
  LeftSvd svd = left_svd(compressed(all));
  share_from_first(fom.comm, svd.values);
  share_from_first(fom.comm, svd.vectors.data);
  const Dense u = first_columns(svd.vectors, std::min(most, svd.vectors.columns));
  const auto turn = [&](Dense& a) {
    if (!a.data.empty()) a = multiply_transposed(u, a);
  };
  turn(basis.ports);
  turn(basis.K);
  turn(basis.D);
  turn(basis.damped_outside);
  basis.T = combine(parts.S, u);
  space.unscale(basis.T);
  return basis;
}

namespace {

/// Σ W Wᵀ of residuals W = E^−½R of a block's ports over the samples.
struct SquaresOfBlock {
  Dense inputs, outputs; ///< k × k; the latter empty where they are the former
};

/// The different lists of ports of some blocks, and the groups of ports that no list
/// divides: W Wᵀ of a list is the sum of those of its groups. With many outputs it is what
/// growth costs.
struct PortLists {
  std::vector<std::vector<int>> lists;
  std::map<std::vector<std::size_t>, std::vector<int>> groups; ///< by their lists

  explicit PortLists(const std::vector<Certificate::PortSet>& blocks) {
    for (const auto& block : blocks)
      for (const auto& ports : {block.inputs, block.outputs})
        if (std::find(lists.begin(), lists.end(), ports) == lists.end())
          lists.push_back(ports);
    std::map<int, std::vector<std::size_t>> of_port;
    for (std::size_t l = 0; l < lists.size(); ++l)
      for (int port : lists[l]) of_port[port].push_back(l);
    for (const auto& [port, in] : of_port) groups[in].push_back(port);
  }
  std::size_t number(const std::vector<int>& ports) const {
    return static_cast<std::size_t>(std::find(lists.begin(), lists.end(), ports) -
                                    lists.begin());
  }
};

/// W Wᵀ, real and imaginary parts, of each list. @param scale  of each port.
std::vector<Dense> squares_of_lists(const PortLists& lists, const ComplexDense& W,
                                    const std::vector<double>& scale) {
  std::vector<Dense> squares(lists.lists.size(), Dense(W.rows, W.rows));
  for (const auto& [in, ports] : lists.groups) {
    Dense parts(W.rows, 2 * static_cast<int>(ports.size()));
    int used = 0;
    for (int port : ports) {
      const std::complex<double>* w = W.column(port);
      const double unit = 1 / scale[as_size(port)];
      for (const bool real : {true, false}) {
        double largest = 0, *to = parts.column(used);
        for (int i = 0; i < W.rows; ++i) {
          to[i] = unit * (real ? w[i].real() : w[i].imag());
          largest = std::max(largest, std::abs(to[i]));
        }
        if (largest > 0) ++used; // of an undamped body nothing is imaginary
      }
    }
    const Dense square = outer_square(first_columns(parts, used));
    for (std::size_t l : in) add_to(squares[l], square);
  }
  return squares;
}

enum class Side { both, inputs, outputs };

/// What is dropped of W, by a projection P, changes H by W_CᵀPW_B, a block of
/// [wW_B, W_C/w]ᵀP[wW_B, W_C/w] whatever w is: the sum of squares by which directions of
/// both sides count alike, or those of one alone, with a w that leaves nothing of the
/// other. Empty if one side is both.
Dense weighted_squares(const std::vector<SquaresOfBlock>& blocks, const Dense& of_modes,
                       Side side, double target) {
  Dense squares = of_modes;
  bool differs = side == Side::both;
  for (const SquaresOfBlock& block : blocks) {
    const auto add = [&](const Dense& square, double weight) {
      if (!square.data.empty()) add_to(squares, square, weight);
    };
    const Dense& others = side == Side::inputs ? block.outputs : block.inputs;
    double most = 0, weight = 1; // w², of the inputs
    for (int i = 0; i < others.rows; ++i) most += others(i, i);
    if (side != Side::both && !block.outputs.data.empty() && most > 0) {
      differs = true;
      weight = std::pow(10 * most / target, side == Side::inputs ? 1 : -1);
    }
    add(block.inputs, weight);
    add(block.outputs, 1 / weight);
  }
  return differs ? squares : Dense();
}

/// Eigenvectors whose rest is at most the target, in the norm of ‖WᵀW‖_F.
Dense dominant(const Dense& squares, double target) {
  const SymmetricEigen eigen = symmetric_eigen(squares);
  const int k = squares.rows;
  int dropped = 0;
  for (double left = 0; dropped < k - 1; ++dropped) {
    left = std::hypot(left, eigen.values[as_size(dropped)]);
    if (left > target) break;
  }
  return part_of(eigen.vectors, 0, k, dropped, k - dropped);
}

} // namespace

Dense directions_to_grow(const ResidualBasis& basis, const Dense& gram,
                         const DenseResponse& response,
                         const std::vector<double>& samples,
                         const std::vector<Certificate::PortSet>& blocks,
                         const std::vector<double>& scale, double kappa, double cutoff,
                         int modes, const std::vector<int>& left_out, double target) {
  // F R has the norm of R in E⁻¹; dominant directions are chosen by squares: H differs by
  // products of residuals.
  const int k = gram.rows;
  const GramFactor norm = gram_factor(gram);
  const auto turned = [&](const Dense& a) {
    return a.data.empty() ? Dense() : multiply(norm.F, a);
  };
  const Dense F_ports = turned(basis.ports), F_K = turned(basis.K), F_D = turned(basis.D);
  std::vector<SquaresOfBlock> of_blocks(blocks.size());
  const PortLists lists(blocks);
  const auto scale_of = [&](int port) { return scale[as_size(port)]; };
  for (double omega : samples) {
    const ComplexDense x = response.modal_response(omega);
    const auto without = [&](int modes_left_out) {
      ComplexDense counted = x;
      for (int j = 0; j < x.columns; ++j)
        std::fill_n(counted.column(j), modes_left_out, 0.0);
      return response.transfer(counted);
    };
    std::map<int, ComplexDense> H_without;
    for (int count : left_out)
      if (!H_without.count(count)) H_without.emplace(count, without(count));
    const ComplexDense W =
        residual_of(F_ports, F_K, F_D, kappa, response.system().coefficients(omega), x);
    const std::vector<Dense> squares = squares_of_lists(lists, W, scale);
    const auto add_square = [&](Dense& sum, const std::vector<int>& ports,
                                double weight) {
      if (sum.data.empty()) sum = Dense(k, k);
      add_to(sum, squares[lists.number(ports)], weight);
    };
    for (std::size_t b = 0; b < blocks.size(); ++b) {
      const Certificate::PortSet& block = blocks[b];
      const ComplexDense& H = H_without.at(left_out[b]);
      double size = 0; // ‖H‖² of the block
      for (int j : block.inputs)
        for (int i : block.outputs)
          size += std::norm(H(i, j) / (scale_of(i) * scale_of(j)));
      if (!(size > 0)) continue;
      add_square(of_blocks[b].inputs, block.inputs, 1 / std::sqrt(size));
      if (block.outputs != block.inputs)
        add_square(of_blocks[b].outputs, block.outputs, 1 / std::sqrt(size));
    }
  }
  const double sigma = cutoff * cutoff;
  Dense of_modes = first_columns(basis.K, modes); // (ω_c² + τ) G of the certificate
  for (int j = 0; j < modes; ++j) {
    const double factor =
        (sigma + response.tau()) *
        residual_factor(response.mu()[as_size(j)], response.tau(), kappa) /
        response.energy(j, sigma);
    for (int i = 0; i < k; ++i) of_modes(i, j) *= factor;
  }
  const Dense W_of_modes = multiply(norm.F, of_modes),
              squares_of_modes = multiply(W_of_modes, transpose(W_of_modes));

  Dense fewest =
      dominant(weighted_squares(of_blocks, squares_of_modes, Side::both, target), target);
  for (const Side side : {Side::inputs, Side::outputs}) {
    const Dense squares = weighted_squares(of_blocks, squares_of_modes, side, target);
    if (squares.data.empty()) continue;
    // One side alone costs further blocks where errors are to fall far.
    Dense fewer = dominant(squares, target);
    if (2 * fewer.columns < fewest.columns) fewest = std::move(fewer);
  }
  return multiply(norm.inverse, fewest);
}

} // namespace flexgram
