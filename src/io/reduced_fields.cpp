#include "io/reduced_fields.hpp"

#include "linalg/sparse.hpp"

#include <algorithm>
#include <limits>

namespace flexgram {
namespace {

std::vector<double> row_major(const Dense& a) { return transpose(a).data; }

Dense local_dense(const Block& block) {
  Dense a(static_cast<int>(block.rows()), static_cast<int>(block.columns()));
  const Block::Access access(block);
  std::copy_n(access.column(0), a.data.size(), a.data.begin());
  return a;
}

void matrix(FieldSink& sink, const std::string& name, const Dense& a) {
  sink.array(name, {a.rows, a.columns}, row_major(a));
}

void vector(FieldSink& sink, const std::string& name, const std::vector<double>& v) {
  sink.array(name, {static_cast<std::int64_t>(v.size())}, v);
}

template <std::size_t columns>
void rows(FieldSink& sink, const std::string& name,
          const std::vector<std::array<double, columns>>& rows) {
  if (rows.empty()) return;
  std::vector<double> all;
  for (const auto& row : rows) all.insert(all.end(), row.begin(), row.end());
  sink.array(name, {static_cast<std::int64_t>(rows.size()), columns}, all);
}

void system(FieldSink& sink, const SecondOrderModel& model) {
  const int m = static_cast<int>(model.n);
  const Dense M = to_dense(model.M), K = to_dense(model.K);
  const Mat viscous = model.term({});
  Dense D = viscous ? to_dense(viscous) : Dense(m, m); // all of rates
  matrix(sink, "M", M);
  matrix(sink, "K", K);
  bool others = false;
  for (const auto& [law, T] : model.terms) {
    if (law.is_skew() && !law.is_named()) add_to(D, to_dense(T));
    if (law.is_of_rates() && !law.is_named()) continue;
    others = true;
    const std::string name = law.path().substr(1);
    matrix(sink, name, to_dense(T));
    if (!law.is_named()) continue;
    sink.value(name + "/law", law.kind_name());
    for (const auto& [number, values] : law.kind().numbers())
      sink.value(name + "/" + number, values);
  }
  if (others) {
    add_to(D, M, model.damping.alpha);
    add_to(D, K, model.damping.beta);
    sink.value("alpha", model.damping.alpha);
    sink.value("beta", model.damping.beta);
  }
  matrix(sink, "D", D);
  sink.value("eta", model.damping.eta);
  matrix(sink, "B", local_dense(model.B));
  sink.value("B/names", model.inputs);
  matrix(sink, "C", transpose(local_dense(model.C)));
  sink.value("C/names", model.outputs);
  const OutputForm form = model.output_form();
  if (form.has_direct()) matrix(sink, "feedthrough", form.direct());
  if (!form.has_factors()) return;
  vector(sink, "output_beta", form.beta());
  vector(sink, "output_eta", form.eta());
}

void supremum_of(FieldSink& sink, const BandClaim& claim) {
  sink.value("error/worst", claim.worst);
  sink.value("error/whole", claim.whole);
  sink.value("error/attained", claim.attained);
  sink.value("error/at", claim.at);
  sink.value("error/rigid_rounding", claim.rigid_rounding);
  sink.value("error/data_rounding_worst", claim.data_rounding);
  sink.value("error/data_rounding_at", claim.data_rounding_at);
  sink.value("error/relative_to", claim.relative_to);
  rows(sink, "error/bands", claim.bands);
  rows(sink, "error/excluded", claim.excluded);
  rows(sink, "error/unmet", claim.unmet);
  rows(sink, "error/poles", claim.poles);
  if (!claim.values.empty()) {
    std::vector<double> all;
    for (const ParameterValues& values : claim.values)
      all.insert(all.end(), values.begin(), values.end());
    sink.array("error/parameter_values",
               {static_cast<std::int64_t>(claim.values.size()),
                static_cast<std::int64_t>(claim.at_values.size())},
               all);
    sink.value("error/parameter_values/names", claim.parameters);
    vector(sink, "error/at_values", claim.at_values);
    if (claim.between) sink.value("error/between_values", *claim.between);
    if (!claim.of_all_values.empty())
      vector(sink, "error/all_values", claim.of_all_values);
  }
  if (!claim.tolerance) return;
  sink.value("error/tolerance", *claim.tolerance);
  sink.value("error/met", claim.met ? 1.0 : 0.0);
}

void held(FieldSink& sink, const std::vector<HeldInterface>& all) {
  if (all.empty()) return;
  std::vector<std::string> interfaces, ports;
  std::vector<double> count, compliance;
  std::vector<std::array<double, 2>> omega;
  for (const HeldInterface& h : all) {
    interfaces.push_back(h.interface);
    ports.push_back(h.port.empty() ? "none" : h.port);
    count.push_back(static_cast<double>(h.omega.size()));
    compliance.push_back(h.compliance.value_or(std::numeric_limits<double>::quiet_NaN()));
    omega.insert(omega.end(), h.omega.begin(), h.omega.end());
  }
  vector(sink, "held/compliance", compliance);
  rows(sink, "held/omega", omega);
  sink.value("held/interfaces", interfaces);
  sink.value("held/ports", ports);
  sink.value("held/frequencies", count);
}

void form_of(FieldSink& sink, const ErrorForm& form) {
  vector(sink, "form/stiffness", form.stiffness);
  vector(sink, "form/mass", form.mass);
  matrix(sink, "form/inputs", form.inputs);
  matrix(sink, "form/outputs", form.outputs);
  matrix(sink, "form/residual_stiffness", form.residual_stiffness);
  matrix(sink, "form/residual_inputs", form.residual_inputs);
  matrix(sink, "form/residual_outputs", form.residual_outputs);
  vector(sink, "form/lost_stiffness", form.lost_stiffness);
  vector(sink, "form/lost_inputs", form.lost_inputs);
  vector(sink, "form/lost_outputs", form.lost_outputs);
  vector(sink, "form/coupling", form.coupling);
  vector(sink, "form/rounding_stiffness", form.rounding_stiffness);
  vector(sink, "form/rounding_mass", form.rounding_mass);
  matrix(sink, "form/rounding_inputs", form.rounding_inputs);
  matrix(sink, "form/rounding_outputs", form.rounding_outputs);
  sink.value("form/alpha", form.damping.alpha);
  sink.value("form/beta", form.damping.beta);
  sink.value("form/eta", form.damping.eta);
  sink.value("form/kappa", form.kappa);
  sink.value("form/cutoff", form.cutoff);
}

void claim_of(FieldSink& sink, const Claim& claim) {
  vector(sink, "error/omega", claim.curve.omega);
  vector(sink, "error/relative", claim.curve.error);
  if (!claim.curve.bound.empty()) {
    vector(sink, "error/bound", claim.curve.bound);
    vector(sink, "error/floor", claim.curve.floor);
    if (!claim.curve.data_rounding.empty())
      vector(sink, "error/data_rounding", claim.curve.data_rounding);
  }
  sink.value("error/kind", claim.kind);
  if (claim.supremum) supremum_of(sink, *claim.supremum);
  if (!claim.by_kind.empty()) {
    std::vector<std::string> kinds;
    std::vector<double> worst, sizes;
    for (const KindClaim& kind : claim.by_kind) {
      kinds.push_back(kind.name);
      worst.push_back(kind.worst);
      sizes.push_back(kind.least);
    }
    sink.value("error/kinds", kinds);
    sink.value("error/by_kind", worst);
    sink.value("error/kind_least", sizes);
    if (!claim.kind_tolerances.empty())
      sink.value("error/kind_tolerances", claim.kind_tolerances);
  }
  if (!claim.fields.empty()) {
    std::vector<std::string> inputs;
    std::vector<double> worst;
    for (const FieldClaim& field : claim.fields) {
      inputs.push_back(field.inputs);
      worst.push_back(field.proved ? field.worst
                                   : std::numeric_limits<double>::infinity());
    }
    sink.value("error/field_inputs", inputs);
    sink.value("error/field", worst);
  }
  held(sink, claim.held);
  if (claim.form) form_of(sink, *claim.form);
  if (!claim.loads) return;
  matrix(sink, "loads/patterns", claim.loads->patterns);
  sink.value("loads/names", claim.loads->names);
}

void frame_of(FieldSink& sink, const Frame& frame, std::int64_t m) {
  sink.value("frame/kind", frame.kind);
  sink.value("frame/rigid_modes", static_cast<double>(frame.rigid_modes));
  if (!frame.integrals) return;
  const FrameIntegrals& i = *frame.integrals;
  // Blocks of m columns stand side by side; in the file the block index is between.
  const auto blocks = [&](const char* name, const Dense& a) {
    sink.array(name, {a.rows, a.columns / m, m}, row_major(a));
  };
  sink.value("frame/mass", i.mass);
  vector(sink, "frame/centre", {i.centre.begin(), i.centre.end()});
  matrix(sink, "frame/M_r", i.M_r);
  matrix(sink, "frame/M_er", i.M_er);
  blocks("frame/gyroscopic", i.gyroscopic);
  blocks("frame/inertia_first", i.inertia_first);
  sink.array("frame/inertia_second", {3, m, 3, m}, row_major(i.inertia_second));
  if (i.stiffening.loads.empty()) return;
  std::vector<double> all;
  for (const Dense& K : i.stiffening.matrices)
    all.insert(all.end(), K.data.begin(), K.data.end());
  sink.array("frame/stiffening",
             {static_cast<std::int64_t>(i.stiffening.loads.size()), m, m}, all);
  sink.value("frame/stiffening/names", i.stiffening.loads);
}

void log(FieldSink& sink, const Provenance& made, const std::string& body) {
  sink.value("log/body", body);
  sink.value("log/factorisations", static_cast<double>(made.factorisations));
  std::vector<std::string> plan;
  for (const auto& [name, value] : made.plan) plan.push_back(name + "\t" + value);
  if (!plan.empty()) sink.value("log/plan", plan);
  if (made.medium_order > 0)
    sink.value("log/medium_order", static_cast<double>(made.medium_order));
}

} // namespace

void visit_fields(const ReducedModel& rom, FieldSink& sink) {
  sink.value("method", rom.provenance.method);
  if (!rom.provenance.second_stage.empty())
    sink.value("second_stage", rom.provenance.second_stage);
  sink.value("band", std::vector<double>{rom.claim.band[0], rom.claim.band[1]});
  system(sink, rom.system);
  vector(sink, "gramian/sigma", rom.sigma);
  claim_of(sink, rom.claim);
  vector(sink, "modes/omega", rom.modes);
  frame_of(sink, rom.frame, rom.system.n);
  log(sink, rom.provenance, rom.system.name);
}

} // namespace flexgram
