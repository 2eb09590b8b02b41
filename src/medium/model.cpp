#include "medium/model.hpp"

#include "base/index.hpp"

#include <algorithm>

namespace flexgram {
namespace {

/// Entries of H for each mode and view from which its terms are fewer: a view takes an
/// N × N Gram matrix of the terms, all views together H's entries, once.
constexpr double many = 4;

} // namespace

void refuse_elastic_part() {
  throw Error(
      "{tol_relative_to} elastic: with a damping matrix, or loss factors by material, H "
      "has no elastic part by itself that a claim could be relative to");
}

MediumModel::MediumModel(const Medium& medium, std::size_t level,
                         const PortSelection& ports, const KindSpec& kinds,
                         RelativeTo relative_to, double enough,
                         const ParameterValues& values, double negligible)
    : level_(medium.levels[level]
                 .to_rounding(negligible > 0 ? negligible
                                             : negligible_rounding(medium.spec.target))
                 .at(values)),
      V_(medium.V.share()),
      ports_{medium.scale, ports.inputs, ports.outputs, {}, {}, {}, {}} {
  names = medium.body.head();
  rigid = medium.rigid;
  cutoff = medium.cutoff;
  tau = medium.tau;
  kappa = medium.kappa;
  if (relative_to == RelativeTo::elastic && rigid > 0 && !has_elastic_part())
    refuse_elastic_part();
  select_names(names, ports);
  // Outputs of a body whose outputs are its inputs are among these; others follow them.
  if (!medium.body.outputs_are_inputs)
    for (int& output : ports_.outputs)
      output += static_cast<int>(medium.body.inputs.size());
  ports_.form = claimed_outputs(names);
  views = port_views(names, kinds);
  choose_references(medium.spec.bands, resolved(relative_to, medium));
  for (const PortView& view : views) {
    Certificate::PortSet block;
    for (int j : view.columns) block.inputs.push_back(ports_.inputs[as_size(j)]);
    for (int i : view.rows) block.outputs.push_back(ports_.outputs[as_size(i)]);
    ports_.blocks.push_back(std::move(block));
  }
  const DenseResponse& response = *level_.response;
  if (!is_symmetric(response.system().terms)) transposed_ = response.transposed();
  take_modal_system();
  system.outputs_are_inputs = ports.same;
  ports_.modal_inputs = columns_of(response.modal_inputs(), ports_.inputs, ports_.scale);
  ports_.modal_outputs =
      columns_of(response.modal_inputs(), ports_.outputs, ports_.scale);
  numbers_ = ModalNumbers::of(response, ports_.modal_inputs, ports_.modal_outputs);
  enough_digits_ = 0.1 * medium.spec.target;
  const double terms = static_cast<double>(views.size()) * response.system().order(),
               entries =
                   static_cast<double>(ports_.inputs.size() * ports_.outputs.size());
  std::vector<int> ports_once = ports_.inputs;
  ports_once.insert(ports_once.end(), ports_.outputs.begin(), ports_.outputs.end());
  std::sort(ports_once.begin(), ports_once.end());
  const double distinct = static_cast<double>(
      std::unique(ports_once.begin(), ports_once.end()) - ports_once.begin());
  if (response.is_diagonal() && distinct * distinct > many * terms) {
    many_.enough = (enough > 0 ? enough : medium.spec.target);
    many_.enough /= 1 + many_.enough; // of ‖H‖, for an error relative to ‖H‖ − error
    many_.residuals = level_.certificate->residual_grams(response, ports_.blocks);
  }
  if (response.is_diagonal() && entries > many * terms && ports_.form.is_plain())
    for (const PortView& view : views)
      many_.terms.emplace_back(columns_of(ports_.modal_outputs, view.rows),
                               columns_of(ports_.modal_inputs, view.columns));
  resonances = medium.resonances(level_);
  lambda.assign(response.lambda().begin() + rigid,
                response.lambda().begin() + rigid + medium.modes);
}

/// Columns of U times these are the coordinates of `system`.
std::vector<double> MediumModel::units() const {
  std::vector<double> unit;
  for (double mu : level_.response->mu())
    unit.push_back(mu * tau > 1e-14 ? 1 / std::sqrt(mu) : 1.0);
  return unit;
}

void MediumModel::take_modal_system() {
  const DenseResponse& response = *level_.response;
  const int N = response.system().order();
  system.M = system.K = Dense(N, N);
  const std::vector<double> unit = units();
  for (int j = 0; j < N; ++j) {
    const auto at = as_size(j);
    const double mu = response.mu()[at];
    const bool massless = !(mu * tau > 1e-14);
    system.M(j, j) = massless ? mu : 1.0;
    system.K(j, j) = massless ? 1 - tau * mu : response.lambda()[at];
  }
  to_V_ = response.U();
  for (std::size_t t = 0; t < response.modal_terms().size(); ++t)
    system.terms.push_back({response.system().terms[t].law, response.modal_terms()[t]});
  Dense B = response.modal_inputs();
  const auto scale_of = [&](int j) { return unit[as_size(j)]; };
  for (int j = 0; j < N; ++j) {
    for (int i = 0; i < N; ++i) to_V_(i, j) *= scale_of(j);
    for (auto& [law, T] : system.terms)
      for (int i = 0; i < N; ++i) T(i, j) *= scale_of(i) * scale_of(j);
    for (int p = 0; p < B.columns; ++p) B(j, p) *= scale_of(j);
  }
  system.damping = response.system().damping;
  system.negligible = response.system().negligible;
  system.B = columns_of(B, ports_.inputs, ports_.scale);
  system.C = columns_of(B, ports_.outputs, ports_.scale);
}

void MediumModel::follow_dampers() {
  if (system.terms.empty() || system.order() > 250) return;
  const DenseResponse& response = *level_.response;
  const bool moves = !parameters_of(response.system().terms).empty();
  resonances = poles_below(moves ? response.stiffened() : response, cutoff);
}

/// Modal coordinates of the response to the chosen inputs, in their units.
ComplexDense MediumModel::input_response(double omega) const {
  ComplexDense x = columns_of(level_.response->modal_response(omega), ports_.inputs);
  for (int j = 0; j < x.columns; ++j)
    for (int i = 0; i < x.rows; ++i)
      x(i, j) /= ports_.scale[as_size(ports_.inputs[as_size(j)])];
  return x;
}

ComplexDense MediumModel::transfer(double omega, int from) const {
  ComplexDense x = input_response(omega);
  for (int j = 0; j < x.columns; ++j) std::fill_n(x.column(j), from, 0.0);
  return multiply_transposed(ports_.modal_outputs, x);
}

MatrixSeries MediumModel::transfer(const ResponseSeries& x) const {
  if (!system.terms.empty()) { // more digits are dense solves in long double
    MatrixSeries H = transfer_series(ports_.modal_outputs, x, 0, nullptr);
    const MatrixSeries whole = ports_.form.is_plain() ? H : complete(x, H);
    if (std::all_of(views.begin(), views.end(), [&](const PortView& view) {
          return tail_of(whole, view) <= enough_digits_ * size_of(whole, view);
        }))
      return H;
  }
  MatrixSeries H = transfer_series(ports_.modal_outputs, x, 0, &numbers_);
  if (!ports_.form.has_direct()) return H;
  const double left = size_of_outputs(x, H); // of what both terms cancel
  if (left < size_at_centre(H))
    H = transfer_series(ports_.modal_outputs, x, 0, &numbers_, left);
  return H;
}

TransferSeries MediumModel::seen(const ResponseSeries& x, const MatrixSeries& H) const {
  if (apart() == 0) return {H, size_of_outputs(x, H), {}};
  const auto elastic = [&](double size) {
    return transfer_series(ports_.modal_outputs, x, apart(), &numbers_, size);
  };
  MatrixSeries entries = elastic(0);
  const double size = std::min(size_of_outputs(x, H), size_of_outputs(x, entries));
  if (size < size_at_centre(entries)) entries = elastic(size);
  return {std::move(entries), size, {}};
}

/// Of the response to all ports that to the chosen inputs, in their units.
ResponseSeries MediumModel::inputs_of(const ResponseSeries& all) const {
  const MatrixSeries& x = all.x;
  const int n_in = static_cast<int>(ports_.inputs.size()), parts = 2 * (x.degree() + 1);
  const Dense none(x.rows(), n_in);
  ResponseSeries chosen{
      all.interval, {n_in, Dense(x.rows(), n_in * parts), none}, none, none, {}};
  for (int j = 0; j < n_in; ++j) {
    const int port = ports_.inputs[as_size(j)];
    const double scale = 1 / ports_.scale[as_size(port)];
    for (int i = 0; i < x.rows(); ++i) {
      for (int part = 0; part < parts; ++part)
        chosen.x.coefficients(i, n_in * part + j) =
            scale * x.coefficients(i, x.columns * part + port);
      chosen.x.tail(i, j) = scale * x.tail(i, port);
      chosen.envelope(i, j) = scale * all.envelope(i, port);
      chosen.rounding(i, j) = scale * all.rounding(i, port);
    }
  }
  return chosen;
}

std::optional<MediumModel::Stretch> MediumModel::over(Interval interval, int degree,
                                                      double hopeless) const {
  const DenseResponse& response = *level_.response;
  Stretch result;
  if (many_.residuals.grams.empty()) {
    const auto all = response_series(response, interval, degree);
    if (!all) return std::nullopt;
    std::optional<ResponseSeries> of_transposed;
    if (transposed_) {
      of_transposed = response_series(*transposed_, interval, degree);
      if (!of_transposed) return std::nullopt;
    }
    const ResponseSeries x = inputs_of(*all);
    const MatrixSeries H = transfer(x);
    sizes_by_entries(x, H, result);
    result.H = seen(x, H);
    result.bounds = level_.certificate->over(response, *all, ports_.blocks,
                                             transposed_ ? &*of_transposed : nullptr);
    scale_bounds(factors_of_views(interval), result);
    add_rigid_floor(result);
    return result;
  }
  const auto factors = modal_factors(response, interval, degree);
  if (!factors) return std::nullopt;
  bool clear = false;
  if (has_many_ports()) {
    result.H.factors = from_row(factors->x, apart());
    clear = sizes_by_terms(factors->x, result);
  }
  if (!clear) {
    const auto x = response_series(response, interval, degree, ports_.modal_inputs);
    if (!x && !has_many_ports()) return std::nullopt;
    if (x) {
      const MatrixSeries H = transfer(*x);
      sizes_by_entries(*x, H, result);
      if (!has_many_ports()) result.H = seen(*x, H);
    }
  }
  std::vector<double> least; // ‖H‖
  for (const ViewNorms& size : result.size)
    least.push_back(*std::min_element(size.below.begin(), size.below.end()));
  const std::vector<double> larger = factors_of_views(interval);
  result.bounds = level_.certificate->of_many(
      response, *factors, ports_.blocks, many_.residuals,
      [&](std::size_t v, double error) {
        error *= larger[v];
        return error <= many_.enough * least[v] || error > hopeless * least[v];
      });
  scale_bounds(larger, result);
  add_rigid_floor(result);
  return result;
}

Certificate::Couplings MediumModel::couplings() const {
  std::vector<int> ports = ports_.inputs;
  Dense rows = system.B;
  if (!system.outputs_are_inputs) {
    ports.insert(ports.end(), ports_.outputs.begin(), ports_.outputs.end());
    rows = beside(rows, system.C);
  }
  return level_.certificate->couplings(system, units(), ports, rows);
}

std::optional<ErrorForm> MediumModel::error_form() const {
  constexpr double most = 1e6; // numbers
  const double N = level_.order(),
               ports = static_cast<double>(ports_.inputs.size() + ports_.outputs.size());
  if (!level_.response->is_diagonal() || 4 * N * ports + N * N > most)
    return std::nullopt;
  return level_.certificate->form(*level_.response, {ports_.inputs, ports_.outputs});
}

std::optional<TransferSeries> MediumModel::response(Interval interval, int degree) const {
  TransferSeries H;
  if (has_many_ports()) {
    auto factors = modal_factors(*level_.response, interval, degree);
    if (!factors) return std::nullopt;
    H.factors = from_row(std::move(factors->x), apart());
  } else {
    const auto x =
        response_series(*level_.response, interval, degree, ports_.modal_inputs);
    if (!x) return std::nullopt;
    H = seen(*x, transfer(*x));
  }
  return H;
}

std::optional<MatrixSeries> MediumModel::entries(Interval interval, int degree,
                                                 int from) const {
  auto x = response_series(*level_.response, interval, degree, ports_.modal_inputs);
  if (!x) return std::nullopt;
  return transfer_series(ports_.modal_outputs, *x, from, &numbers_);
}

std::optional<MatrixSeries> MediumModel::factors(Interval interval, int degree) const {
  auto factors = modal_factors(*level_.response, interval, degree);
  if (!factors) return std::nullopt;
  return std::move(factors->x);
}

std::vector<double> MediumModel::strain() const {
  const DenseResponse& response = *level_.response;
  std::vector<double> root;
  for (int k = 0; k < response.U().columns; ++k)
    root.push_back(k < rigid ? 0.0 : std::sqrt(std::max(response.energy(k, 0), 0.0)));
  return root;
}

MediumModel::FieldLoads MediumModel::field_loads(const std::vector<int>& inputs) const {
  std::vector<int> ports;
  for (int j : inputs) ports.push_back(ports_.inputs[as_size(j)]);
  return {level_.certificate->residuals_of(ports), strain()};
}

std::optional<MediumModel::Field> MediumModel::field(Interval interval, int degree,
                                                     const FieldLoads& of) const {
  const DenseResponse& response = *level_.response;
  const std::vector<int>& ports = of.residuals.ports;
  const auto x = response_series(response, interval, degree,
                                 columns_of(response.modal_inputs(), ports));
  if (!x) return std::nullopt;
  const std::vector<double>& root = of.strain;
  const int p = static_cast<int>(ports.size()), all = x->x.columns,
            parts = x->x.coefficients.columns / all, N = x->x.rows();
  Field field{{p, Dense(N, p * parts), Dense(N, p)}, 0, 0, true};
  for (int j = 0; j < p; ++j) {
    const int port = ports[as_size(j)];
    const double scale = 1 / ports_.scale[as_size(port)];
    for (int k = 0; k < N; ++k) {
      const double factor = scale * root[as_size(k)];
      for (int part = 0; part < parts; ++part)
        field.x.coefficients(k, part * p + j) =
            factor * x->x.coefficients(k, part * all + j);
      field.x.tail(k, j) = factor * x->x.tail(k, j);
    }
  }
  const Certificate::FieldBound bound =
      level_.certificate->field_over(response, *x, of.residuals, root);
  field.error = bound.error;
  field.floor = bound.floor;
  field.proved = bound.proved;
  return field;
}

Dense MediumModel::strain_coordinates(const Dense& Q) const {
  Dense coordinates = Q;
  for (int k = 0; k < Q.rows; ++k) {
    const double root = k < rigid ? 0.0 : std::sqrt(std::max(system.K(k, k), 0.0));
    for (int j = 0; j < Q.columns; ++j) coordinates(k, j) *= root;
  }
  return coordinates;
}

TermGram MediumModel::terms_of_difference(std::size_t view,
                                          const DenseResponse& small) const {
  const std::vector<int>&rows = views[view].rows, &columns = views[view].columns;
  const Dense B = columns_of(small.modal_inputs(), columns),
              C = columns_of(small.modal_outputs(), rows);
  Dense mixed = multiply(columns_of(ports_.modal_outputs, rows), transpose(C));
  const Dense of_B = multiply(columns_of(ports_.modal_inputs, columns), transpose(B));
  for (std::size_t i = 0; i < mixed.data.size(); ++i) mixed.data[i] *= of_B.data[i];
  return {many_.terms[view], mixed, TermGram(C, B)};
}

Block MediumModel::lift(const Dense& Q) const {
  if (!V_) return Block(names.comm, names.rows, names.n, 0);
  Dense all(static_cast<int>(V_.columns()), Q.columns);
  set_part(all, 0, 0, in_V(Q));
  return combine(V_, all);
}

Dense MediumModel::euclidean_gram() const {
  if (!V_)
    throw Error("{inner_product} euclidean needs the basis of the medium model: certify "
                "with {medium_basis} yes");
  Dense gram = inner(V_, V_);
  gram = multiply_transposed(
      to_V_, multiply(part_of(gram, 0, system.order(), 0, system.order()), to_V_));
  symmetrise(gram);
  return gram;
}

} // namespace flexgram
