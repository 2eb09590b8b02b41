#pragma once

#include "linalg/basis.hpp"

#include <string>
#include <vector>

namespace flexgram {

/// Matrices by the names of the loads that make them.
struct LoadMatrices {
  std::vector<std::string> loads;
  std::vector<Dense> matrices;
  /// The six ports of the interface that holds a free body: forces there make no matrices of their
  /// own. None: its supports hold the body.
  std::vector<std::string> held;
  Dense
      resultants; ///< 6 × (loads, held), Rᵀf of a free body's loads, R its rigid motions

  LoadMatrices project(const Dense& Q) const; ///< QᵀKQ of each
  /// The same where another interface holds a free body: balanced by forces there, the stress under a
  /// load is a sum of the stresses known.
  /// @throws Error if it has no six ports.
  LoadMatrices held_at(const std::string& interface) const;
};

/// Geometric stiffening of a body in a floating frame of reference: what the stress under unit loads
/// adds to its stiffness. The loads are those of the frame's motion (frame.ax … frame.az for a
/// unit of acceleration of the origin, frame.alphax … for one of angular acceleration,
/// frame.spinxx, yy, zz, xy, yz, zx for a unit of ω_x², …, ω_zω_x), and each port of interfaces.
class Stiffening {
public:
  virtual ~Stiffening() = default;
  /// VᵀK_σV of each load [N/m a unit]. Collective.
  virtual LoadMatrices project(const Basis& V) const = 0;
};

} // namespace flexgram
