/// Loads and outputs of a description's file.

#include "fem/description_file.hpp"

#include <algorithm>
#include <cmath>

namespace flexgram {
namespace {

/// Names of inputs, and their values.
/// @pre materials and loads are known.
void read_preload(const Hdf5File& file, BodyDescription& body) {
  const auto inputs = file.texts_attribute("/preload", "inputs");
  const auto values = file.numbers_attribute("/preload", "values");
  if (inputs.size() != values.size())
    throw Error(text("file %s: /preload: inputs and values must be as many",
                     file.path().c_str()));
  for (std::size_t k = 0; k < inputs.size(); ++k) {
    if (!std::isfinite(values[k]))
      throw Error(text("file %s: preload: %s must be finite", file.path().c_str(),
                       inputs[k].c_str()));
    body.preload.emplace_back(inputs[k], values[k]);
  }
}

void refuse_varying_stress(const Hdf5File& file, const BodyDescription& body) {
  for (const auto& [name, material] : body.materials)
    for (const MaterialTerm& term : material.terms)
      if (term.law.is_parameter())
        throw Error(text(
            "file %s: material %s: its stress under a preload, or a spin, depends on "
            "%s: give the material one number, or leave the preload out",
            file.path().c_str(), name.c_str(), term.law.name().c_str()));
}

AccelerationField read_field(const Hdf5File& file, const std::string& object,
                             const std::string& name, const std::string& type) {
  using Type = AccelerationField::Type;
  AccelerationField field{name, Type::uniform, {}, {}};
  if (type == "acceleration") {
    if (!file.has_attribute(object, "vector")) return field;
    field.vector = fixed<double, 3>(file, object, "vector");
    for (double x : *field.vector)
      if (!std::isfinite(x))
        throw Error(text("file %s: load %s: vector must be finite", file.path().c_str(),
                         name.c_str()));
    return field;
  }
  field.type = type == "spin" ? Type::spin : Type::angular;
  field.point = fixed<double, 3>(file, object, "point");
  if (field.type == Type::spin) field.axis = fixed<double, 3>(file, object, "axis");
  double length = 0;
  for (std::size_t i = 0; i < 3; ++i) {
    length += field.axis[i] * field.axis[i];
    if (!std::isfinite(field.point[i]) || !std::isfinite(field.axis[i]))
      throw Error(text("file %s: load %s: point and axis must be finite",
                       file.path().c_str(), name.c_str()));
  }
  if (field.type == Type::spin && !(std::abs(length - 1) < 1e-9))
    throw Error(text("file %s: load %s: axis must be of unit length", file.path().c_str(),
                     name.c_str()));
  return field;
}

/// @pre the field has a name that no load has.
SpinRange read_spin(const Hdf5File& file) {
  const auto number = [&](const char* name) {
    return file.number_attribute("/spin", name);
  };
  const std::string frame = file.text_attribute("/spin", "frame");
  if (frame != "turning" && frame != "rest")
    throw Error(text("file %s: /spin: frame %s must be turning or rest",
                     file.path().c_str(), frame.c_str()));
  SpinRange spin{read_field(file, "/spin", "the body's spin", "spin"), number("least"),
                 number("most"), number("value"), frame == "turning"};
  try {
    expect_speeds(
        "spin",
        {{"least", {spin.least}}, {"most", {spin.most}}, {"value", {spin.value}}});
  } catch (Error& error) {
    error.add_context(text("file %s: /spin", file.path().c_str()));
    throw;
  }
  return spin;
}

/// /outputs/NAME/feedthrough, columns × inputs, with the names of these.
Feedthrough read_feedthrough(const Hdf5File& file, const std::string& object,
                             const NodalVectors& vectors) {
  const std::string place = object + "/feedthrough";
  const auto inputs = file.texts_attribute(place, "inputs");
  if (file.shape(place) !=
      std::vector<std::int64_t>{static_cast<std::int64_t>(vectors.columns.size()),
                                static_cast<std::int64_t>(inputs.size())})
    throw Error(
        text("file %s: %s must be columns × inputs", file.path().c_str(), place.c_str()));
  Feedthrough through;
  through.values = file.read_all<double>(place);
  for (double x : through.values)
    if (!std::isfinite(x))
      throw Error(text("file %s: %s holds %g", file.path().c_str(), place.c_str(), x));
  for (const auto& column : vectors.columns)
    for (const auto& input : inputs) {
      through.outputs.push_back(vectors.name + "." + column);
      through.inputs.push_back(input);
    }
  return through;
}

NodalVectors read_vectors(const Hdf5File& file, const std::string& group,
                          const std::string& name, std::int64_t points) {
  const std::string object = group + "/" + name;
  NodalVectors vectors{name, file.texts_attribute(object, "columns"),
                       read_nodes(file, object, points)};
  const auto shape = file.shape(object + "/values");
  if (shape.size() != 3 || shape[0] != static_cast<std::int64_t>(vectors.nodes.size()) ||
      shape[1] != static_cast<std::int64_t>(vectors.columns.size()) ||
      (shape[2] != 3 && shape[2] != 6) || shape[1] == 0)
    throw Error(
        text("file %s: %s/values must be nodes × columns × 3, or × 6 with moments",
             file.path().c_str(), object.c_str()));
  vectors.components = as_size(shape[2]);
  vectors.values = file.read_all<double>(object + "/values");
  for (double x : vectors.values)
    if (!std::isfinite(x))
      throw Error(
          text("file %s: %s/values holds %g", file.path().c_str(), object.c_str(), x));
  if (file.exists(object + "/feedthrough"))
    vectors.feedthrough = read_feedthrough(file, object, vectors);
  return vectors;
}

/// What a load by forces stands for: temperatures, or a bolt that is tightened.
void read_free_strain(const Hdf5File& file, const std::string& name,
                      BodyDescription& body) {
  const std::string heat = "/loads/" + name + "/temperature",
                    bolt = "/loads/" + name + "/pretension";
  if (file.exists(heat)) {
    const std::string column = file.texts_attribute("/loads/" + name, "columns").front();
    NodeTemperatures warm{name + "." + column, read_nodes(file, heat, body.points),
                          file.read_all<double>(heat + "/values")};
    if (warm.values.size() != warm.nodes.size())
      throw Error(text("file %s: %s must have one value a node", file.path().c_str(),
                       heat.c_str()));
    if (file.exists(heat + "/gradients"))
      warm.gradients = file.read_all<double>(heat + "/gradients");
    if (!warm.gradients.empty() && warm.gradients.size() != warm.nodes.size())
      throw Error(text("file %s: %s must have one gradient a node", file.path().c_str(),
                       heat.c_str()));
    for (const auto* numbers : {&warm.values, &warm.gradients})
      for (double value : *numbers)
        if (!std::isfinite(value))
          throw Error(
              text("file %s: %s holds %g", file.path().c_str(), heat.c_str(), value));
    body.temperatures.push_back(std::move(warm));
  }
  if (file.exists(bolt)) {
    Pretension tension{name + ".force", read_nodes(file, bolt, body.points),
                       fixed<double, 3>(file, bolt, "axis"),
                       file.number_attribute(bolt, "held"),
                       file.number_attribute(bolt, "length")};
    std::sort(tension.nodes.begin(), tension.nodes.end());
    double square = 0;
    for (double c : tension.axis) square += c * c;
    if (!(tension.held > 0 && std::isfinite(tension.held)) ||
        !(tension.length > 0 && std::isfinite(tension.length)) ||
        !(std::abs(square - 1) < 1e-9))
      throw Error(text("file %s: %s: held and length must be positive, and axis of unit "
                       "length",
                       file.path().c_str(), bolt.c_str()));
    body.pretensions.push_back(std::move(tension));
  }
}

/// A pretension is known by its force in the preload.
void expect_tightened(const Hdf5File& file, const BodyDescription& body) {
  for (const Pretension& bolt : body.pretensions)
    if (std::none_of(body.preload.begin(), body.preload.end(),
                     [&](const auto& entry) { return entry.first == bolt.input; }))
      throw Error(text("file %s: %s is a pretension, which stays: give its force in the "
                       "preload",
                       file.path().c_str(), bolt.input.c_str()));
}

Reaction read_reaction(const Hdf5File& file, const std::string& name,
                       std::int64_t points) {
  const std::string object = "/outputs/" + name;
  Reaction reaction{name,
                    read_nodes(file, object, points),
                    fixed<double, 3>(file, object, "point"),
                    {}};
  std::sort(reaction.nodes.begin(), reaction.nodes.end());
  for (double x : reaction.point)
    if (!std::isfinite(x))
      throw Error(text("file %s: output %s: point must be finite", file.path().c_str(),
                       name.c_str()));
  for (double axis : file.numbers_attribute(object, "axes")) {
    if (axis != std::floor(axis) || axis < 0 || axis > 5)
      throw Error(text("file %s: output %s: axis %g must be 0 to 5", file.path().c_str(),
                       name.c_str(), axis));
    reaction.axes.push_back(static_cast<int>(axis));
  }
  return reaction;
}

} // namespace

void read_loads(const Hdf5File& file, BodyDescription& body) {
  for (const auto& name : ordered_children(file, "/loads")) {
    const std::string type = file.text_attribute("/loads/" + name, "type");
    const std::vector<std::string> known = {"acceleration", "angular_acceleration",
                                            "spin", "forces"};
    if (std::find(known.begin(), known.end(), type) == known.end())
      throw Error(text("file %s: load %s: type %s must be one of %s", file.path().c_str(),
                       name.c_str(), type.c_str(), join(known).c_str()));
    if (type == "forces") {
      body.loads.push_back(read_vectors(file, "/loads", name, body.points));
      read_free_strain(file, name, body);
    } else
      body.fields.push_back(read_field(file, "/loads/" + name, name, type));
  }
  if (file.exists("/preload")) read_preload(file, body);
  expect_tightened(file, body);
  if (file.exists("/spin")) body.spin = read_spin(file);
  if (!body.preload.empty() || (body.spin && body.spin->turning))
    refuse_varying_stress(file, body);
}

void read_outputs(const Hdf5File& file, BodyDescription& body) {
  for (const auto& name : ordered_children(file, "/outputs")) {
    if (file.has_attribute("/outputs/" + name, "axes"))
      body.reactions.push_back(read_reaction(file, name, body.points));
    else
      body.outputs.push_back(read_vectors(file, "/outputs", name, body.points));
  }
}

} // namespace flexgram
