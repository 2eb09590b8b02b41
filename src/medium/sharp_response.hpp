/// A level's response with twice the digits where plain sums lose too many: at resonances of
/// stiff bodies, at zeros of H (docs/proof.md, section 6). Called by level_certifier.cpp.

#pragma once

#include "medium/model.hpp"
#include "medium/projection_rounding.hpp"

namespace flexgram {

/// Columns of U whose sums with twice the digits are worth their price.
struct SharpSums {
  std::vector<int> K; ///< of K, the terms and the ports; elastic
  std::vector<int> M; ///< fewer: nothing cancels in kinetic energy; rigid ones too

  std::size_t count() const { return K.size() + M.size(); }
};

/// Ritz vectors whose energies are to be summed with twice the digits: what plain sums may have
/// lost of the others changes H by little. Few vectors matter in a stiff body, at its resonances;
/// slender ones lose digits in static responses too.
/// @param model     the level, by all ports.
/// @param response  of the level, by plain sums.
/// @param scale     of each port.
/// @param grid      [rad/s] where rounding is looked at.
/// @param allowed   relative change of H that the others may cause among themselves.
/// @note Collective on `comm`.
SharpSums sums_to_sharpen(MPI_Comm comm, const MediumModel& model,
                          const DenseResponse& response,
                          const ProjectionRounding& rounding,
                          const std::vector<double>& scale,
                          const std::vector<double>& grid, double allowed);

/// A response whose energies were summed with twice the digits for some Ritz vectors.
struct SharpResponse {
  std::shared_ptr<const DenseResponse> response;
  ProjectionRounding rounding;
  Dense turned; ///< its U is that of the response before times this
};

/// Products of small matrices with twice the digits, and more:
/// @param chosen  whose energies and ports are summed again: with twice the digits among
/// themselves, by accurate forces K y, M y, T y with all others.
/// @param sums  rounding_of_sums of the response.
/// @note One accurate product with its matrix for each of them. Collective.
SharpResponse sharpened(const MediumSpace& space, const DenseResponse& response,
                        const ProjectionRounding& sums, const Block& loads,
                        const SharpSums& chosen);

} // namespace flexgram
