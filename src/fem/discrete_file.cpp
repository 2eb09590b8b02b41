/// Masses and springs of a description's file. Declared in discrete.hpp.

#include "base/index.hpp"
#include "fem/description_file.hpp"
#include "fem/discrete.hpp"
#include "linalg/decompositions.hpp"

#include <cmath>

namespace flexgram {
namespace {

Place read_place(const Hdf5File& file, const std::string& object,
                 const std::string& nodes, const std::string& interface,
                 std::int64_t points) {
  Place place;
  if (file.has_attribute(object, interface))
    place.interface = file.text_attribute(object, interface);
  else if (file.exists(object + "/" + nodes))
    for (auto node : file.read_all<std::int64_t>(object + "/" + nodes)) {
      if (node < 0 || node >= points)
        throw Error(text("file %s: %s/%s holds %lld, the mesh has %lld points",
                         file.path().c_str(), object.c_str(), nodes.c_str(),
                         static_cast<long long>(node), static_cast<long long>(points)));
      place.nodes.push_back(node);
    }
  return place;
}

/// A symmetric 6×6 matrix without negative eigenvalues.
Dense read_of_motion(const Hdf5File& file, const std::string& object, const char* name) {
  Dense matrix(6, 6);
  if (!file.has_attribute(object, name)) return matrix;
  const auto values = fixed<double, 36>(file, object, name);
  std::copy(values.begin(), values.end(), matrix.data.begin());
  Dense half = matrix;
  symmetrise(half);
  double away = 0;
  for (std::size_t i = 0; i < 36; ++i)
    away = std::max(away, std::abs(half.data[i] - matrix.data[i]));
  const double size = frobenius_norm(matrix);
  if (!std::isfinite(size) || away > 1e-12 * size)
    throw Error(text("file %s: %s: %s must be finite and symmetric", file.path().c_str(),
                     object.c_str(), name));
  if (size > 0 && symmetric_eigen(half).values.front() < -1e-12 * size)
    throw Error(text("file %s: %s: %s has a negative eigenvalue", file.path().c_str(),
                     object.c_str(), name));
  return half;
}

std::vector<double> principal_moments(PointMass mass) {
  mass.offset = {};
  return symmetric_eigen(part_of(mass_matrix(mass), 3, 3, 3, 3)).values;
}

} // namespace

void expect_inertias_of_bodies(const Hdf5File& file, const BodyDescription& body) {
  for (const auto& [name, mass] : body.masses) {
    if (mass.matrix)
      throw Error(
          text("file %s: /masses/%s: a mass given by its matrix takes no spin: give "
               "its mass and inertia",
               file.path().c_str(), name.c_str()));
    const auto moments = principal_moments(mass);
    if (moments[2] > (1 + 1e-9) * (moments[0] + moments[1]))
      throw Error(text("file %s: /masses/%s: no body that spins has the principal "
                       "moments of inertia %g, "
                       "%g, %g kg m²: the largest is more than the sum of the others",
                       file.path().c_str(), name.c_str(), moments[0], moments[1],
                       moments[2]));
  }
}

void read_discrete(const Hdf5File& file, BodyDescription& body) {
  const auto count = [&](const Place& place) {
    return static_cast<std::int64_t>(place.interface.empty() ? place.nodes.size() : 1);
  };
  const auto add = [&](const std::string& object, ElementType type,
                       const std::string& name, const Place& place) {
    if (count(place) == 0)
      throw Error(text("file %s: %s has no nodes", file.path().c_str(), object.c_str()));
    body.discrete.push_back({object, type, name, {}, count(place)});
  };
  for (const auto& name : ordered_children(file, "/masses")) {
    const std::string object = "/masses/" + name;
    PointMass& mass = body.masses[name];
    mass.at = read_place(file, object, "nodes", "interface", body.points);
    if (file.has_attribute(object, "matrix")) {
      mass.matrix = read_of_motion(file, object, "matrix");
      for (int c = 0; c < 3; ++c) mass.mass += (*mass.matrix)(c, c) / 3;
      add(object, ElementType::mass1, name, mass.at);
      continue;
    }
    mass.mass = file.number_attribute(object, "mass");
    mass.inertia = fixed<double, 6>(file, object, "inertia");
    if (!(mass.mass >= 0) || !std::isfinite(mass.mass))
      throw Error(text("file %s: %s: mass = %g must be finite and not negative",
                       file.path().c_str(), object.c_str(), mass.mass));
    if (file.has_attribute(object, "offset"))
      mass.offset = fixed<double, 3>(file, object, "offset");
    for (double x : mass.offset)
      if (!std::isfinite(x))
        throw Error(text("file %s: %s: offset must be finite", file.path().c_str(),
                         object.c_str()));
    const std::vector<double> moments = principal_moments(mass);
    if (!(moments[0] >= -1e-9 * moments[2]))
      throw Error(
          text("file %s: %s: its inertia has a negative principal moment, %g kg m²",
               file.path().c_str(), object.c_str(), moments[0]));
    add(object, ElementType::mass1, name, mass.at);
  }
  for (const auto& name : ordered_children(file, "/springs")) {
    const std::string object = "/springs/" + name;
    Spring& spring = body.springs[name];
    spring.from = read_place(file, object, "nodes", "interface", body.points);
    spring.to = read_place(file, object, "to_nodes", "to_interface", body.points);
    spring.stiffness = read_of_motion(file, object, "stiffness");
    spring.damping = read_of_motion(file, object, "damping");
    if (file.has_attribute(object, "loss_factor"))
      spring.loss = file.number_attribute(object, "loss_factor");
    if (!(spring.loss >= 0) || !std::isfinite(spring.loss))
      throw Error(text("file %s: %s: loss_factor = %g must be finite and not negative",
                       file.path().c_str(), object.c_str(), spring.loss));
    spring.terms = read_terms(file, object, name);
    for (const MaterialTerm& term : spring.terms)
      if (term.part != MaterialTerm::Part::whole &&
          term.part != MaterialTerm::Part::damper)
        throw Error(text("file %s: %s: shear and bulk are parts of materials",
                         file.path().c_str(), object.c_str()));
    const auto ends = count(spring.to);
    if (ends > 1 && ends != count(spring.from))
      throw Error(text("file %s: %s: from %lld nodes to %lld", file.path().c_str(),
                       object.c_str(), static_cast<long long>(count(spring.from)),
                       static_cast<long long>(ends)));
    add(object, ends > 0 ? ElementType::spring2 : ElementType::spring1, name,
        spring.from);
  }
}

} // namespace flexgram
