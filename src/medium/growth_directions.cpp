#include "medium/growth_directions.hpp"

#include "base/index.hpp"
#include "linalg/decompositions.hpp"

#include <algorithm>
#include <cmath>
#include <map>

namespace flexgram {

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
  const Dense F_ports = turned(basis.ports), F_K = turned(basis.K);
  std::vector<Dense> F_terms;
  for (const Dense& T : basis.terms) F_terms.push_back(turned(T));
  std::vector<SquaresOfBlock> of_blocks(blocks.size());
  const PortLists lists(blocks);
  const auto scale_of = [&](int port) { return scale[as_size(port)]; };
  std::optional<DenseResponse> transposed_response;
  if (!is_symmetric(response.system().terms)) transposed_response = response.transposed();
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
    const ComplexDense W = residual_of(F_ports, F_K, F_terms, kappa,
                                       response.system().coefficients(omega), x);
    const std::vector<Dense> squares = squares_of_lists(lists, W, scale);
    std::vector<Dense> of_transposed; // residuals of A(ω)ᵀ, where that is another
    if (transposed_response) {
      ShiftCoefficients c = response.system().coefficients(omega);
      c.terms = transposed(std::move(c.terms), response.system().terms);
      of_transposed =
          squares_of_lists(lists,
                           residual_of(F_ports, F_K, F_terms, kappa, c,
                                       transposed_response->modal_response(omega)),
                           scale);
    }
    const auto add_square = [&](Dense& sum, const std::vector<Dense>& of,
                                const std::vector<int>& ports, double weight) {
      if (sum.data.empty()) sum = Dense(k, k);
      add_to(sum, of[lists.number(ports)], weight);
    };
    for (std::size_t b = 0; b < blocks.size(); ++b) {
      const Certificate::PortSet& block = blocks[b];
      const ComplexDense& H = H_without.at(left_out[b]);
      double size = 0; // ‖H‖² of the block
      for (int j : block.inputs)
        for (int i : block.outputs)
          size += std::norm(H(i, j) / (scale_of(i) * scale_of(j)));
      if (!(size > 0)) continue;
      add_square(of_blocks[b].inputs, squares, block.inputs, 1 / std::sqrt(size));
      if (transposed_response || block.outputs != block.inputs)
        add_square(of_blocks[b].outputs, transposed_response ? of_transposed : squares,
                   block.outputs, 1 / std::sqrt(size));
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
