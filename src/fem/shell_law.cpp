#include "fem/shell.hpp"

#include "base/error.hpp"
#include "base/text.hpp"

#include <cmath>

namespace flexgram {

Dense plane_stress(const ShellLayer& layer) {
  constexpr int plane[3] = {0, 1, 3};
  const auto C = [&](int i, int j) { return layer.stiffness[as_size(6 * i + j)]; };
  Dense Q(3, 3);
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 3; ++j)
      Q(i, j) = C(plane[i], plane[j]) - C(plane[i], 2) * C(2, plane[j]) / C(2, 2);
  const double c = std::cos(layer.angle), s = std::sin(layer.angle);
  Dense T(3, 3); // strains in the layer's axes
  T.data = {c * c,     s * s, -2 * c * s, s * s,        c * c,
            2 * c * s, c * s, -c * s,     c * c - s * s};
  return multiply_transposed(T, multiply(Q, T));
}

Dense heat_strain(const ShellLayer& layer) {
  if (!layer.expansion)
    throw Error("its material, which a temperature warms, has no expansion");
  const auto& e = *layer.expansion;
  const double k = std::cos(layer.angle), s = std::sin(layer.angle);
  Dense strain(3, 1); // its shear is twice that of the tensor
  strain.data = {k * k * e[0] + s * s * e[1] - k * s * e[3],
                 s * s * e[0] + k * k * e[1] + k * s * e[3],
                 2 * k * s * (e[0] - e[1]) + (k * k - s * s) * e[3]};
  return strain;
}

Dense heat_resultants(const std::vector<ShellLayer>& layers) {
  Dense held(6, 2);
  double whole = 0;
  for (const ShellLayer& layer : layers) whole += layer.thickness;
  double bottom = -0.5 * whole;
  for (const ShellLayer& layer : layers) {
    if (layer.role == ShellRole::shear) continue;
    const Dense stress = multiply(plane_stress(layer), heat_strain(layer));
    const double t = layer.thickness, cube = t * t * t / 12;
    const bool is_whole = layer.role == ShellRole::all;
    const double z = is_whole ? bottom + 0.5 * t : 0,
                 zeroth = layer.role == ShellRole::bending ? 0 : t,
                 second = layer.role == ShellRole::stretching
                              ? 0
                              : t * z * z + layer.factor * cube;
    for (int i = 0; i < 3; ++i) {
      held(i, 0) += zeroth * stress(i, 0);
      held(3 + i, 0) += zeroth * z * stress(i, 0);
      held(i, 1) += zeroth * z * stress(i, 0);
      held(3 + i, 1) += second * stress(i, 0);
    }
    bottom += t;
  }
  return held;
}

namespace {

/// Compliance against transverse shear in the section's axes: xz, yz.
Dense shear_compliance(const ShellLayer& layer) {
  const double c = std::cos(layer.angle), s = std::sin(layer.angle);
  const double of_1 = 1 / layer.stiffness[7 * 5], of_2 = 1 / layer.stiffness[7 * 4];
  Dense S(2, 2);
  S(0, 0) = c * c * of_1 + s * s * of_2;
  S(1, 1) = s * s * of_1 + c * c * of_2;
  S(0, 1) = S(1, 0) = c * s * (of_1 - of_2);
  return S;
}

/// What a layer with a role gives.
ShellLaw law_of_role(const ShellLayer& layer) {
  const Dense Q = plane_stress(layer);
  const double t = layer.thickness, square = t * t * t / 12;
  ShellLaw law;
  law.thickness = t;
  if (layer.role == ShellRole::shear) {
    law.shear = shear_compliance(layer);
    for (double& value : law.shear.data) value /= layer.factor * t;
    return law;
  }
  const int first = layer.role == ShellRole::bending ? 3 : 0;
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 3; ++j)
      law.ABD(first + i, first + j) = (first > 0 ? layer.factor * square : t) * Q(i, j);
  if (first > 0) return law;
  law.mass = layer.density * t;
  law.second = layer.density * square;
  return law;
}

/// The layers' laws, each by itself but for transverse shear, where it is the compliance: the energy
/// of a force of 1, half.
std::vector<ShellLaw> laws_of(const std::vector<ShellLayer>& layers) {
  double whole = 0;
  for (const ShellLayer& layer : layers) {
    if (!(layer.thickness > 0))
      throw Error(text("a shell's thickness %g must be positive", layer.thickness));
    whole += layer.thickness;
  }
  std::vector<ShellLaw> laws;
  if (layers.front().role != ShellRole::all) {
    for (const ShellLayer& layer : layers) laws.push_back(law_of_role(layer));
    return laws;
  }
  std::vector<Dense> Q;
  double stretch[2] = {}, moment[2] = {}; // of each direction: ∫Q_ii and ∫Q_ii z
  double bottom = -0.5 * whole;
  for (const ShellLayer& layer : layers) {
    const double t = layer.thickness, z = bottom + 0.5 * t,
                 square = t * (z * z + t * t / 12);
    Q.push_back(plane_stress(layer));
    ShellLaw& law = laws.emplace_back();
    for (int i = 0; i < 3; ++i)
      for (int j = 0; j < 3; ++j) {
        const double q = Q.back()(i, j);
        law.ABD(i, j) = t * q;
        law.ABD(3 + i, 3 + j) = square * q;
        law.ABD(3 + i, j) = law.ABD(i, 3 + j) = t * z * q;
      }
    for (int i = 0; i < 2; ++i) {
      stretch[i] += t * Q.back()(i, i);
      moment[i] += t * z * Q.back()(i, i);
    }
    law.mass = layer.density * t;
    law.first = layer.density * t * z;
    law.second = layer.density * square;
    law.thickness = whole;
    bottom += t;
  }
  // A moment that varies along i shears by g_i(z) = ∫ Q_ii (z − z_i) from the bottom on, over the
  // bending stiffness about the neutral height z_i.
  double neutral[2], bending[2] = {}, g[2] = {};
  for (int i = 0; i < 2; ++i) neutral[i] = moment[i] / stretch[i];
  bottom = -0.5 * whole;
  for (std::size_t k = 0; k < layers.size(); ++k) {
    const double t = layers[k].thickness;
    const Dense S = shear_compliance(layers[k]);
    const auto beyond = [&](int i, double h) { // of the first h of this layer
      return Q[k](i, i) * h * (bottom + 0.5 * h - neutral[i]);
    };
    constexpr double at[3] = {-0.774596669241483377036, 0, 0.774596669241483377036};
    constexpr double weight[3] = {5.0 / 18, 8.0 / 18, 5.0 / 18};
    for (int p = 0; p < 3; ++p) {
      const double h = 0.5 * t * (1 + at[p]);
      double here[2];
      for (int i = 0; i < 2; ++i) {
        const double z = bottom + h - neutral[i];
        here[i] = g[i] + beyond(i, h);
        bending[i] += weight[p] * t * Q[k](i, i) * z * z;
      }
      for (int i = 0; i < 2; ++i)
        for (int j = 0; j < 2; ++j)
          laws[k].shear(i, j) += weight[p] * t * here[i] * S(i, j) * here[j];
    }
    for (int i = 0; i < 2; ++i) g[i] += beyond(i, t);
    bottom += t;
  }
  for (ShellLaw& law : laws)
    for (int i = 0; i < 2; ++i)
      for (int j = 0; j < 2; ++j) law.shear(i, j) /= bending[i] * bending[j];
  return laws;
}

Dense inverse_of_two(const Dense& F) {
  const double det = F(0, 0) * F(1, 1) - F(0, 1) * F(1, 0);
  Dense result(2, 2);
  result(0, 0) = F(1, 1) / det;
  result(1, 1) = F(0, 0) / det;
  result(0, 1) = result(1, 0) = -F(0, 1) / det;
  return result;
}

} // namespace

ShellLaw part_of_law(const std::vector<ShellLayer>& layers,
                     const std::vector<bool>& counts) {
  const std::vector<ShellLaw> laws = laws_of(layers);
  ShellLaw part;
  Dense compliance(2, 2), own(2, 2);
  for (std::size_t k = 0; k < laws.size(); ++k) {
    add_to(compliance, laws[k].shear);
    if (!counts[k]) continue;
    add_to(own, laws[k].shear);
    add_to(part.ABD, laws[k].ABD);
    part.mass += laws[k].mass;
    part.first += laws[k].first;
    part.second += laws[k].second;
    part.thickness = laws[k].thickness;
  }
  const Dense shear = inverse_of_two(compliance);
  part.shear = multiply(shear, multiply(own, shear));
  return part;
}

ShellLaw shell_law(const std::vector<ShellLayer>& layers) {
  return part_of_law(layers, std::vector<bool>(layers.size(), true));
}

} // namespace flexgram
