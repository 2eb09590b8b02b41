/// The bound for many ports, by Gram matrices of the residuals' terms (docs/proof.md,
/// section 4, "Many ports"). Declared in certificate.hpp.

#include "base/index.hpp"
#include "medium/certificate.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>

namespace flexgram {

namespace {

/// Places of ports in an ascending list.
std::vector<int> places_of(const std::vector<int>& ports, const std::vector<int>& among) {
  std::vector<int> places;
  for (int port : ports)
    places.push_back(static_cast<int>(std::lower_bound(among.begin(), among.end(), port) -
                                      among.begin()));
  return places;
}

} // namespace

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
  std::vector<int> few;
  for (const auto& ports : result.ports) {
    Dense B = transpose(columns_of(response.modal_inputs(), ports, scale_));
    for (double& b : B.data) b = std::abs(b);
    result.sums.push_back({multiply_transposed(B, B), off(ports), 0});
    const bool is_short = 4 * ports.size() <= longest;
    result.grams.push_back(is_short ? TermGram() : of(ports));
    if (is_short) few.insert(few.end(), ports.begin(), ports.end());
  }
  std::sort(few.begin(), few.end());
  few.erase(std::unique(few.begin(), few.end()), few.end());
  result.few = residuals_of(few);
  for (std::size_t list = 0; list < result.ports.size(); ++list) {
    const std::vector<int>& ports = result.ports[list];
    const bool is_short = result.grams[list].order() == 0;
    const auto places = is_short ? places_of(ports, few) : ports;
    const auto& dropped = (is_short ? result.few.parts : parts_).dropped_ports;
    for (std::size_t k = 0; k < ports.size(); ++k)
      result.sums[list].dropped +=
          std::pow(dropped[as_size(places[k])] / scale_[as_size(ports[k])], 2);
  }
  return result;
}

namespace {

/// Norms of the residuals of each list of ports, by terms or by entries.
/// @param terms  of the modes and of the ports themselves. @param few  entries of the few.
std::vector<ViewNorms> norms_of_lists(const Certificate::ResidualGrams& grams,
                                      const MatrixSeries& terms,
                                      const MatrixSeries& few) {
  std::vector<ViewNorms> norms;
  const std::vector<int>& ports = grams.few.ports;
  for (std::size_t list = 0; list < grams.ports.size(); ++list) {
    if (grams.grams[list].order() > 0) {
      norms.push_back(term_norms(grams.grams[list], terms).norms);
      continue;
    }
    PortView view{"", std::vector<int>(as_size(few.rows())), {}};
    std::iota(view.rows.begin(), view.rows.end(), 0);
    for (int port : grams.ports[list])
      view.columns.push_back(static_cast<int>(
          std::lower_bound(ports.begin(), ports.end(), port) - ports.begin()));
    norms.push_back(view_norms(few, view));
  }
  return norms;
}

/// Without the values at the centre.
MatrixSeries moving(MatrixSeries series) {
  for (int part = 0; part < 2 * series.columns; ++part)
    std::fill_n(series.coefficients.column(part), series.rows(), 0.0);
  return series;
}

} // namespace

/// ‖E^−½ ·‖ of what T does not hold of the residuals of a list, at most.
double Certificate::lost(const ResponseSeries& factors, const ResidualGrams& grams,
                         std::size_t list, double factor) const {
  const ResidualGrams::Sums& sums = grams.sums[list];
  const bool is_short = grams.grams[list].order() == 0;
  const ResidualParts& parts = is_short ? grams.few.parts : parts_;
  double square = sums.dropped;
  for (int l = 0; l < factors.envelope.rows; ++l) {
    const auto at = as_size(l);
    square += std::pow(factors.envelope(l, 0), 2) * sums.B(l, l) *
              std::pow(factor * parts.dropped_K[at], 2);
  }
  return std::sqrt(square);
}

/// @param factors  of the modes, whose coordinates are these times their rows of B.
Certificate::RoundingSizes Certificate::rounding_sizes(const ResponseSeries& factors,
                                                       const ResidualGrams& grams,
                                                       std::size_t list) const {
  const ResidualGrams::Sums& sums = grams.sums[list];
  const Dense& envelope = factors.envelope;
  RoundingSizes sizes{{}, sums.off, 0, 0};
  for (int i = 0; i < envelope.rows; ++i)
    sizes.x.push_back(envelope(i, 0) * std::sqrt(sums.B(i, i)));
  const auto norm = [&](Dense rows) { // of each rigid row a: Σ_p (Σ_i a_i e_i |b_ip|)²
    for (int j = 0; j < rows.columns; ++j)
      for (int i = 0; i < rows.rows; ++i) rows(i, j) *= envelope(i, 0);
    const Dense summed = multiply(sums.B, rows);
    double square = 0;
    for (std::size_t k = 0; k < rows.data.size(); ++k)
      square += rows.data[k] * summed.data[k];
    return std::sqrt(square);
  };
  if (rigid_.rows.columns > 0) {
    sizes.rigid = norm(rigid_.rows);
    sizes.stiffness = norm(rigid_.stiffness);
  }
  return sizes;
}

std::vector<Certificate::Bound>
Certificate::of_many(const DenseResponse& response, const ResponseSeries& factors,
                     const std::vector<PortSet>& blocks, const ResidualGrams& grams,
                     const std::function<bool(std::size_t, double)>& enough) const {
  const Dense& B = response.modal_inputs();
  const Interval interval = factors.interval;
  std::vector<RoundingSizes> rounding;
  for (std::size_t list = 0; list < grams.ports.size(); ++list)
    rounding.push_back(rounding_sizes(factors, grams, list));
  if (whole_) {
    std::vector<Bound> bounds;
    for (const auto& [inputs, outputs] : grams.blocks)
      add_rounding(bounds.emplace_back(), response, interval.last, rounding[inputs],
                   rounding[outputs]);
    return bounds;
  }
  const Inverse S = inverse(response, factors);
  const auto f = residual_factors(response, interval);
  const double largest = std::abs(f[0]) + std::abs(f[1]) + std::abs(f[2]);
  const MatrixSeries g = times(f, factors.x);
  MatrixSeries constant{1, Dense(1, g.coefficients.columns), Dense(1, 1)};
  constant.coefficients(0, 0) = -1;
  const MatrixSeries terms = stacked(g, constant);
  // Gram matrices know norms to the root of rounding; where the many are left as they are,
  // those of the few must be far smaller.
  MatrixSeries of_few;
  if (const Chosen few = chosen(grams.few); !few.ports.empty()) {
    const Dense loads = columns_of(B, few.ports);
    const int degree = factors.x.degree();
    of_few = held_residual(
        response, response_series(response, interval, degree, loads).value(), few);
  }
  const std::vector<ViewNorms> norms = norms_of_lists(grams, terms, of_few);
  std::vector<double> lost_of_list;
  for (std::size_t list = 0; list < grams.ports.size(); ++list)
    lost_of_list.push_back(lost(factors, grams, list, largest));
  // Beside few ports what the many leave matters as a sum: a further block costs less than
  // products of their residuals.
  const auto worth = [&](std::size_t k) {
    const std::size_t in = blocks[k].inputs.size(), out = blocks[k].outputs.size();
    return std::max(in, out) <= std::max<std::size_t>(few_ports, 2 * std::min(in, out));
  };
  std::vector<Bound> bounds;
  std::vector<std::size_t> unclear; ///< blocks whose bound may be sharper
  std::vector<int> ports;           ///< theirs
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
    add_rounding(bound, response, interval.last, rounding[inputs], rounding[outputs]);
    if (worth(k) && !enough(k, bound.error)) {
      unclear.push_back(k);
      for (const auto* list : {&blocks[k].inputs, &blocks[k].outputs})
        ports.insert(ports.end(), list->begin(), list->end());
    }
    bounds.push_back(bound);
  }
  if (unclear.empty()) return bounds;

  // W itself at the centre; the terms say how far it moves from there.
  std::sort(ports.begin(), ports.end());
  ports.erase(std::unique(ports.begin(), ports.end()), ports.end());
  const double centre = interval.centre();
  const auto there = response_series(response, {centre, centre}, 0, columns_of(B, ports));
  if (!there) return bounds;
  const MatrixSeries w = residual(response, *there, chosen(ports));

  const std::vector<ViewNorms> moves =
      norms_of_lists(grams, moving(terms), moving(of_few));
  const auto farthest = [&](std::size_t list, const std::vector<int>& places) {
    double most = 0, tails = 0;
    for (double above : moves[list].above)
      if (!(above <= most)) most = above; // NaN too
    for (int j : places)
      for (int i = 0; i + 1 < w.rows(); ++i) tails += w.tail(i, j) * w.tail(i, j);
    return most + std::sqrt(tails) + lost_of_list[list];
  };
  ResidualsAt at_centre{w.centre()};
  for (std::size_t k : unclear) {
    const auto [inputs, outputs] = grams.blocks[k];
    const PortSet here{places_of(blocks[k].inputs, ports),
                       places_of(blocks[k].outputs, ports)};
    const double sharp = error_of(
        S, here, {farthest(inputs, here.inputs), farthest(outputs, here.outputs)},
        at_centre, at_centre);
    if (sharp < bounds[k].error) bounds[k].error = sharp;
  }
  return bounds;
}

} // namespace flexgram
