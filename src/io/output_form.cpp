#include "io/output_form.hpp"

#include "base/index.hpp"
#include "base/text.hpp"
#include "linalg/dense.hpp"

#include <algorithm>
#include <cmath>

namespace flexgram {
namespace {

std::vector<double> read(const Hdf5File& file, const std::string& name,
                         const std::vector<std::int64_t>& shape, const char* expected) {
  if (!file.exists(name)) return {};
  if (file.shape(name) != shape)
    throw Error(
        text("file %s: %s must be %s", file.path().c_str(), name.c_str(), expected));
  std::vector<double> values = file.read_all<double>(name);
  for (double x : values)
    if (!std::isfinite(x))
      throw Error(text("file %s: %s holds %g", file.path().c_str(), name.c_str(), x));
  return values;
}

} // namespace

void write_output_form(Hdf5File& file, const SecondOrderModel& model) {
  const OutputForm form = model.output_form();
  const Dense& direct = form.direct();
  if (form.has_direct())
    file.write("/feedthrough", {direct.rows, direct.columns}, transpose(direct).data);
  if (!form.has_factors()) return;
  const auto count = static_cast<std::int64_t>(model.outputs.size());
  file.write("/output_beta", {count}, form.beta());
  file.write("/output_eta", {count}, form.eta());
}

void read_output_form(const Hdf5File& file, SecondOrderModel& model) {
  const auto n_out = static_cast<std::int64_t>(model.outputs.size()),
             n_in = static_cast<std::int64_t>(model.inputs.size());
  const auto direct =
      read(file, "/feedthrough", {n_out, n_in},
           text("n_out × n_in, %lld × %lld", static_cast<long long>(n_out),
                static_cast<long long>(n_in))
               .c_str());
  Feedthrough& through = model.feedthrough;
  for (std::size_t k = 0; k < direct.size(); ++k) {
    if (direct[k] == 0) continue;
    through.outputs.push_back(model.outputs[k / model.inputs.size()]);
    through.inputs.push_back(model.inputs[k % model.inputs.size()]);
    through.values.push_back(direct[k]);
  }
  const std::string each =
      text("one number for each of %lld outputs", static_cast<long long>(n_out));
  auto beta = read(file, "/output_beta", {n_out}, each.c_str()),
       eta = read(file, "/output_eta", {n_out}, each.c_str());
  for (const auto& [name, values] :
       {std::pair{"/output_beta", &beta}, {"/output_eta", &eta}})
    for (double x : *values)
      if (x < 0) // bounds take the factor at the end of an interval for its largest
        throw Error(text("file %s: %s holds %g, a negative damping", file.path().c_str(),
                         name, x));
  if (beta.empty() && eta.empty()) return;
  beta.resize(model.outputs.size());
  eta.resize(model.outputs.size());
  model.output_damping = {model.outputs, std::move(beta), std::move(eta)};
}

} // namespace flexgram
