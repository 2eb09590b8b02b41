/// What errors of a view are relative to, and how large it is (docs/proof.md, section 1).

#include "medium/model.hpp"

#include "base/index.hpp"

#include <algorithm>

namespace flexgram {

std::vector<int> MediumModel::left_out() const {
  std::vector<int> counts;
  for (const Reference& reference : reference_) counts.push_back(reference.left_out);
  return counts;
}

/// Errors relative to the elastic part of H are those of the elastic part of H_r: that of the
/// rigid part is relative to ‖H‖ (docs/proof.md, section 4).
void MediumModel::add_rigid_floor(Stretch& stretch) const {
  for (std::size_t v = 0; v < views.size(); ++v) {
    const auto& above = stretch.size[v].above;
    const double rigid_floor = stretch.bounds[v].rigid_floor;
    if (rigid_floor > 0)
      stretch.bounds[v].floor += reference_[v].left_out == 0
                                     ? rigid_floor
                                     : rigid_floor / stretch.whole[v] *
                                           *std::max_element(above.begin(), above.end());
  }
}

std::vector<double> MediumModel::factors_of_views(Interval interval) const {
  std::vector<double> factors(views.size(), 1.0);
  for (std::size_t v = 0; v < views.size(); ++v)
    for (int i : views[v].rows)
      factors[v] = std::max(factors[v], std::abs(ports_.form.factor(i, interval.last)));
  return factors;
}

void MediumModel::scale_bounds(const std::vector<double>& factors,
                               Stretch& stretch) const {
  for (std::size_t v = 0; v < views.size(); ++v) {
    Certificate::Bound& bound = stretch.bounds[v];
    for (double* value : {&bound.error, &bound.floor, &bound.rigid_floor,
                          &bound.rigid_rounding, &bound.data_rounding})
      *value *= factors[v];
  }
}

namespace {

/// Of what its ports answer to themselves, a response that is this small is as good as none.
constexpr double negligible_size = 1e-8;
/// Frequencies at which responses are looked at to see what is negligible.
constexpr int samples = 9;

template <class Look>
void look_over(const std::vector<Interval>& bands, const DenseResponse& response,
               const Look& look) {
  for (const Interval& band : bands)
    for (int l = 0; l < samples; ++l) {
      const double omega = band.first + (band.last - band.first) * l / (samples - 1);
      if (!response.is_resonance(omega)) look(omega);
    }
}

ViewNorms at_least(ViewNorms norms, double least) {
  for (double& x : norms.at) x = std::max(x, least);
  for (double& x : norms.above) x = std::max(x, least);
  for (double& x : norms.below) x = std::max(x, least);
  return norms;
}

} // namespace

/// Of each view the norms of what its errors are relative to, and of H.
/// @param norms_of  (view, whether of the elastic part) of H.
template <class NormsOf>
void MediumModel::take_sizes(const NormsOf& norms_of, Stretch& result) const {
  result.size.clear();
  result.whole.clear();
  for (std::size_t v = 0; v < views.size(); ++v) {
    const ViewNorms whole = norms_of(v, false);
    const auto [left_out, or_whole, least] = reference_[v];
    const double smallest = *std::min_element(whole.below.begin(), whole.below.end());
    result.whole.push_back(std::max(smallest, least));
    result.size.push_back(at_least(left_out == 0 ? whole
                                   : or_whole    ? smaller_of(norms_of(v, true), whole)
                                                 : norms_of(v, true),
                                   least));
  }
}

/// Whether H of a view, of modes `from` on, is nothing but rounding: at frequencies of the
/// bands every entry is 1e-9 or less of the geometric mean of what its input and its output
/// answer to themselves. So stress from gravity of a free body, or whatever symmetry forbids.
bool MediumModel::is_zero(const PortView& view, const std::vector<Interval>& bands,
                          int from) const {
  const DenseResponse& response = *level_.response;
  const Dense& ports = response.modal_inputs();
  const auto entry = [&](const ComplexDense& x, int output, int input, int first) {
    std::complex<double> sum = 0;
    for (int k = first; k < x.rows; ++k) sum += ports(k, output) * x(k, input);
    return sum;
  };
  const OutputForm& form = ports_.form;
  bool is_zero = true;
  look_over(bands, response, [&](double omega) {
    if (!is_zero) return;
    const ComplexDense x = response.modal_response(omega);
    for (int j : view.columns)
      for (int i : view.rows) {
        const int input = ports_.inputs[as_size(j)], output = ports_.outputs[as_size(i)];
        const double own = std::sqrt(std::abs(entry(x, input, input, 0)) *
                                     std::abs(entry(x, output, output, 0)));
        std::complex<double> H = form.factor(i, omega) * entry(x, output, input, from);
        if (form.has_direct())
          H += form.direct()(i, j) * ports_.scale[as_size(output)] *
               ports_.scale[as_size(input)];
        if (std::isfinite(own) && std::abs(H) > 1e-9 * own) is_zero = false;
      }
  });
  return is_zero;
}

/// √(Σ|H_ii| Σ|H_jj|) over the outputs and the inputs of a view, which its ‖H‖ is no larger than
/// where H is that of springs; of modes `from` on, the least of some frequencies.
double MediumModel::own_size(const PortView& view, const std::vector<Interval>& bands,
                             int from) const {
  const DenseResponse& response = *level_.response;
  const Dense& ports = response.modal_inputs();
  double least = HUGE_VAL;
  look_over(bands, response, [&](double omega) {
    const ComplexDense x = response.modal_response(omega);
    const auto answers = [&](const std::vector<int>& of, const std::vector<int>& chosen) {
      double sum = 0;
      for (int k : of) {
        const int port = chosen[as_size(k)];
        std::complex<double> own = 0;
        for (int l = from; l < x.rows; ++l) own += ports(l, port) * x(l, port);
        sum += std::abs(own) * std::pow(ports_.scale[as_size(port)], -2);
      }
      return sum;
    };
    least = std::min(least, std::sqrt(answers(view.rows, ports_.outputs) *
                                      answers(view.columns, ports_.inputs)));
  });
  return std::isfinite(least) ? least : 0;
}

/// Chooses what errors of each view are relative to, and drops views that are nothing but
/// rounding. With kinds of ports there are few of them. @throws Error if nothing is left.
void MediumModel::choose_references(const std::vector<Interval>& bands,
                                    RelativeTo relative_to) {
  const bool both = relative_to == RelativeTo::both;
  const int left_out = both || relative_to == RelativeTo::elastic ? rigid : 0;
  reference_.assign(views.size(), {left_out, both});
  if (ports_.inputs.size() * ports_.outputs.size() > 250'000) return;
  std::vector<PortView> kept;
  reference_.clear();
  for (std::size_t v = 0; v < views.size(); ++v) {
    Reference reference{left_out, both};
    if (is_zero(views[v], bands, left_out)) {
      // Of ports that only move the body as a rigid one all of H counts.
      const bool all_of_it = both && !is_zero(views[v], bands, 0);
      if (!all_of_it && v == 0)
        throw Error(left_out > 0 && !both
                        ? "{tol_relative_to} elastic: the inputs move the body as a "
                          "rigid one only, H has no elastic part"
                        : "H is zero: these inputs move none of these outputs");
      if (!all_of_it) {
        zero_views.push_back(views[v].name);
        continue;
      }
      reference = {};
    }
    if (v > 0 && parameters_of(level_.response->system().terms).empty())
      reference.least = negligible_size * own_size(views[v], bands, reference.left_out);
    kept.push_back(std::move(views[v]));
    reference_.push_back(reference);
  }
  views = std::move(kept);
}

/// The sizes from H = CᵀX and what outputs hold beside it.
void MediumModel::sizes_by_entries(const ResponseSeries& x, const MatrixSeries& H,
                                   Stretch& result) const {
  const bool apart = std::any_of(reference_.begin(), reference_.end(),
                                 [](const Reference& r) { return r.left_out > 0; });
  MatrixSeries elastic = apart
                             ? transfer_series(ports_.modal_outputs, x, rigid, &numbers_)
                             : MatrixSeries(),
               whole;
  const bool plain = ports_.form.is_plain();
  if (!plain) whole = complete(x, H);
  if (!plain && apart) elastic = complete(x, elastic);
  take_sizes(
      [&](std::size_t v, bool of_elastic) {
        return view_norms(of_elastic ? elastic : plain ? H : whole, views[v]);
      },
      result);
}

/// The same from the terms. @return whether rounding is far below them.
bool MediumModel::sizes_by_terms(const MatrixSeries& factors, Stretch& result) const {
  const MatrixSeries elastic = from_row(factors, rigid);
  bool clear = true;
  take_sizes(
      [&](std::size_t v, bool of_elastic) {
        const TermNorms size = term_norms(many_.terms[v], of_elastic ? elastic : factors);
        const auto& at = size.norms.at;
        clear = clear && size.rounding <= 0.1 * *std::min_element(at.begin(), at.end());
        return size.norms;
      },
      result);
  return clear;
}

double MediumModel::whole_over_elastic(double omega) const {
  ComplexDense whole = transfer(omega), elastic = transfer(omega, rigid);
  for (ComplexDense* H : {&whole, &elastic}) ports_.form.complete(*H, omega);
  return frobenius_norm(whole) / frobenius_norm(elastic);
}

} // namespace flexgram
