/// The terms of a body by its materials: S of loss factors that differ, and each part of a
/// material's stiffness that has a law of its own.

#pragma once

#include "fem/followers.hpp"
#include "fem/node_matrix.hpp"

namespace flexgram {

class MaterialTerms {
public:
  explicit MaterialTerms(const BodyDescription& body);

  const std::vector<Law>& laws() const { return laws_; }
  /// The loss factor of all materials of the elements and of springs; 0 where they differ: it is in S.
  double common_loss() const { return common_loss_; }
  /// What the terms take of an element. @param K  its stiffness.
  std::vector<ElementPart> of_element(const PlacedElement& at, MassRule mass_rule,
                                      const Dense& K) const;

private:
  struct Share {
    std::size_t number; ///< of the term
    double weight;      ///< of the element's own K; without one:
    SolidMaterial material;
    Dense dashpot = {}; ///< of a spring, 6×6
  };
  const BodyDescription& body_;
  std::vector<Law> laws_;
  double common_loss_ = 0;
  std::map<std::string, std::vector<Share>> of_material_, of_spring_;
};

} // namespace flexgram
