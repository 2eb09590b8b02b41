/// The bound for many ports, by Gram matrices of the residuals' terms (docs/proof.md,
/// section 4, "Many ports"). Declared in certificate.hpp.

#include "base/index.hpp"
#include "medium/certificate.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>

namespace flexgram {

/// W = P − Σ_i f_i k_i b_iᵀ: terms of the modes, and one that is P.
Certificate::ResidualGrams
Certificate::residual_grams(const DenseResponse& response,
                            const std::vector<PortSet>& blocks) const {
  const auto of = [&](const std::vector<int>& columns) {
    const Dense B = columns_of(response.modal_inputs(), columns, scale_),
                P = columns_of(parts_.ports, columns, scale_);
    const Dense forces = multiply(parts_.K, P); // N × columns
    Dense mixed(B.rows, 1);
    for (int j = 0; j < B.columns; ++j)
      for (int i = 0; i < B.rows; ++i) mixed(i, 0) += forces(i, j) * B(i, j);
    TermGram constant;
    constant.Q = Dense(1, 1);
    constant.size = {frobenius_norm(P)};
    constant.Q(0, 0) = constant.size[0] * constant.size[0];
    constant.summed = P.rows + P.columns;
    return TermGram(TermGram(parts_.K, B), mixed, constant);
  };
  ResidualGrams result;
  const auto list_of = [&](const std::vector<int>& ports) {
    const auto known = std::find(result.ports.begin(), result.ports.end(), ports);
    if (known != result.ports.end()) return as_size(known - result.ports.begin());
    result.ports.push_back(ports);
    return result.ports.size() - 1;
  };
  std::size_t longest = 0;
  for (const PortSet& block : blocks) {
    const std::size_t inputs = list_of(block.inputs);
    result.blocks.push_back({inputs, list_of(block.outputs)});
    longest = std::max({longest, block.inputs.size(), block.outputs.size()});
  }
  for (const auto& ports : result.ports) {
    const bool is_short = 4 * ports.size() <= longest;
    result.grams.push_back(is_short ? TermGram() : of(ports));
    if (is_short) result.few.insert(result.few.end(), ports.begin(), ports.end());
  }
  std::sort(result.few.begin(), result.few.end());
  result.few.erase(std::unique(result.few.begin(), result.few.end()), result.few.end());
  return result;
}

std::vector<Certificate::Bound>
Certificate::of_many(const DenseResponse& response, const ResponseSeries& factors,
                     const std::vector<PortSet>& blocks, const ResidualGrams& grams,
                     const std::function<bool(std::size_t, double)>& enough) const {
  const Dense& B = response.modal_inputs();
  ResponseSeries x{factors.interval, {}, Dense(B.rows, B.columns), {}, factors.largest};
  for (int j = 0; j < B.columns; ++j)
    for (int i = 0; i < B.rows; ++i)
      x.envelope(i, j) = factors.envelope(i, 0) * std::abs(B(i, j));
  const Inverse S = inverse(response, x);
  const auto f = residual_factors(response, x.interval);
  const double largest = std::abs(f[0]) + std::abs(f[1]) + std::abs(f[2]);
  const MatrixSeries g = times_quadratic(f, factors.x);
  MatrixSeries constant{1, Dense(1, g.coefficients.columns), Dense(1, 1)};
  constant.coefficients(0, 0) = -1;
  const MatrixSeries terms = stacked(g, constant);
  std::vector<double> lost_in_units;
  for (int j = 0; j < B.columns; ++j)
    lost_in_units.push_back(lost(x, j, largest) / scale_[as_size(j)]);
  const auto lost_of = [&](const std::vector<int>& columns) {
    double square = 0;
    for (int j : columns) square += std::pow(lost_in_units[as_size(j)], 2);
    return std::sqrt(square);
  };
  // Gram matrices know norms to the root of rounding; where the many are left as they are,
  // those of the few must be far smaller.
  MatrixSeries of_few;
  if (!grams.few.empty()) {
    const Dense loads = columns_of(B, grams.few);
    const int degree = factors.x.degree();
    of_few = held_residual(response,
                           response_series(response, x.interval, degree, loads).value(),
                           grams.few);
  }
  const auto norms_of = [&](const MatrixSeries& series, const MatrixSeries& few) {
    std::vector<ViewNorms> norms; // of each list of ports
    for (std::size_t list = 0; list < grams.ports.size(); ++list) {
      if (grams.grams[list].order() > 0) {
        norms.push_back(term_norms(grams.grams[list], series).norms);
        continue;
      }
      PortView view{"", {}, {}};
      for (int port : grams.ports[list])
        view.columns.push_back(
            static_cast<int>(std::lower_bound(grams.few.begin(), grams.few.end(), port) -
                             grams.few.begin()));
      view.rows.resize(as_size(few.rows()));
      std::iota(view.rows.begin(), view.rows.end(), 0);
      norms.push_back(view_norms(few, view));
    }
    return norms;
  };
  const std::vector<ViewNorms> norms = norms_of(terms, of_few);
  std::vector<double> lost_of_list;
  for (const auto& ports : grams.ports) lost_of_list.push_back(lost_of(ports));
  // Beside few ports what the many leave matters as a sum: a further block costs less than
  // products of their residuals.
  const auto worth = [&](std::size_t k) {
    const std::size_t in = blocks[k].inputs.size(), out = blocks[k].outputs.size();
    return std::max(in, out) <= std::max<std::size_t>(few_ports, 2 * std::min(in, out));
  };
  std::vector<Bound> bounds;
  bool sharper = false;
  for (std::size_t k = 0; k < blocks.size(); ++k) {
    const auto [inputs, outputs] = grams.blocks[k];
    const ViewNorms &in = norms[inputs], &out = norms[outputs];
    const double lost_in = lost_of_list[inputs], lost_out = lost_of_list[outputs];
    double product = 0;
    for (std::size_t i = 0; i < pieces; ++i)
      if (const double here = (in.above[i] + lost_in) * (out.above[i] + lost_out);
          !(here <= product)) // NaN too
        product = here;
    Bound bound;
    bound.error = S.norm * product;
    bound.proved = S.proved;
    add_rounding(bound, response, x, blocks[k]);
    sharper = sharper || (worth(k) && !enough(k, bound.error));
    bounds.push_back(bound);
  }
  if (!sharper) return bounds;

  // W itself at the centre; the terms say how far it moves from there.
  const double centre = x.interval.centre();
  const auto there = response_series(response, {centre, centre}, 0);
  if (!there) return bounds;
  const MatrixSeries w = residual(response, *there);
  const ComplexDense at_centre = w.centre();
  MatrixSeries moving = terms;
  for (int part = 0; part < 2; ++part)
    std::fill_n(moving.coefficients.column(part), moving.rows(), 0.0);
  for (int part = 0; part < 2 * of_few.columns; ++part)
    std::fill_n(of_few.coefficients.column(part), of_few.rows(), 0.0);
  const auto rounding_of = [&](const std::vector<int>& columns) {
    double square = 0;
    for (int j : columns)
      for (int i = 0; i + 1 < w.rows(); ++i) square += w.tail(i, j) * w.tail(i, j);
    return std::sqrt(square);
  };
  Squares squares;
  const std::vector<ViewNorms> moves = norms_of(moving, of_few);
  std::vector<double> farthest;
  for (std::size_t list = 0; list < moves.size(); ++list) {
    double most = 0;
    for (double above : moves[list].above)
      if (!(above <= most)) most = above; // NaN too
    farthest.push_back(most + rounding_of(grams.ports[list]) + lost_of_list[list]);
  }
  for (std::size_t k = 0; k < blocks.size(); ++k) {
    if (!worth(k) || enough(k, bounds[k].error)) continue;
    const auto [inputs, outputs] = grams.blocks[k];
    const double sharp =
        error_of(S, at_centre, blocks[k], farthest[inputs], farthest[outputs], squares);
    if (sharp < bounds[k].error) bounds[k].error = sharp;
  }
  return bounds;
}

} // namespace flexgram
