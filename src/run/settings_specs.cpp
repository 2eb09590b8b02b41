/// The specs that the mathematics takes, made of a user's options.

#include "base/text.hpp"
#include "basis/method.hpp"
#include "run/settings.hpp"

namespace flexgram {
namespace {

std::vector<double> in_rad(const std::vector<double>& frequencies) {
  std::vector<double> omega;
  for (double f : frequencies) omega.push_back(f / hz);
  return omega;
}

} // namespace

std::vector<std::string> Settings::methods() const {
  if (method != "two_step") return {method};
  if (second_stage != "auto") return {second_stage};
  return automatic_methods(order);
}

std::vector<Interval> Settings::bands() const {
  const auto omega = in_rad(band_hz);
  if (omega.size() == 1) return {{omega[0], omega[0]}};
  std::vector<Interval> bands;
  for (std::size_t i = 0; i < omega.size(); i += 2)
    bands.push_back({omega[i], omega[i + 1]});
  return bands;
}

CertifySpec Settings::certify_spec() const {
  CertifySpec spec;
  spec.bands = bands();
  spec.target = medium_target > 0 ? medium_target : flexgram::medium_target(order);
  spec.cutoff = cutoff;
  spec.limit = medium_order;
  spec.relative_to = relative_to;
  spec.kinds = order.kinds();
  const auto shifts = shifts_hz.empty() ? default_shifts(spec.bands) : in_rad(shifts_hz);
  const Demand asked = demand_of(methods(), order.order, shifts);
  spec.modes = asked.modes;
  spec.last_needed = asked.last_needed;
  return spec;
}

std::map<std::string, double> Settings::values_of_parameters() const {
  std::map<std::string, double> values;
  for (const std::string& word : split(at, ',')) {
    const auto equals = word.find('=');
    char* end = nullptr;
    const double value =
        equals == std::string::npos ? 0 : std::strtod(word.c_str() + equals + 1, &end);
    require_option(end && end != word.c_str() + equals + 1 && *end == 0, "-mor_at", word,
                   "NAME=VALUE, separated by commas");
    values[word.substr(0, equals)] = value;
  }
  return values;
}

CheckpointSpec Settings::checkpoint_spec(const std::string& output) const {
  CheckpointSpec spec;
  spec.is_folder = takes_samples();
  spec.path = output + (spec.is_folder ? ".samples" : ".checkpoint");
  spec.when = checkpoint;
  spec.restart = restart;
  return spec;
}

CutRequest Settings::cut_request() const {
  CutRequest request;
  request.name = method;
  request.methods = methods();
  request.order = order;
  request.medium_target = medium_target;
  if (band_is_given) request.bands = bands();
  for (std::size_t i = 0; i < weight.size(); i += 2) {
    request.weight.omega.push_back(weight[i] / hz);
    request.weight.weight.push_back(weight[i + 1]);
  }
  request.metric = metric;
  request.equal_ports = equal_ports;
  request.statics = statics;
  request.field = field_error;
  request.shifts = in_rad(shifts_hz);
  request.moments = moments;
  request.frame = frame;
  request.frame_interface = frame_interface;
  request.relative_to = relative_to;
  request.inputs = split(inputs, ',');
  request.outputs = split(outputs, ',');
  if (!error_hz.empty()) {
    const int count = static_cast<int>(error_hz[2]);
    for (int l = 0; l < count; ++l) {
      const double t = count == 1 ? 0.0 : static_cast<double>(l) / (count - 1);
      request.error_omega.push_back((error_hz[0] + t * (error_hz[1] - error_hz[0])) / hz);
    }
  }
  return request;
}

SamplingSpec Settings::sampling_spec() const {
  SamplingSpec spec;
  spec.band = bands().front();
  spec.samples = samples;
  spec.rule = quadrature;
  spec.logarithmic = logarithmic;
  spec.snapshots = snapshots;
  spec.metric = metric;
  spec.equal_ports = equal_ports;
  spec.order = order;
  spec.checks = validate;
  return spec;
}

} // namespace flexgram
