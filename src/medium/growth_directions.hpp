/// The directions by which a space grows that has many ports. Called by growth.cpp.

#pragma once

#include "medium/certificate.hpp"

namespace flexgram {

/// Which combinations of the columns of E⁻¹T the space should grow by: the dominant
/// directions of the residuals, in E⁻¹, of ports and of modes. Those that are left out
/// change H by about `target` at most, relative to each block at each of the frequencies.
/// @param gram     TᵀE⁻¹T.
/// @param samples  [rad/s]
/// @param scale    of each port.
/// @param left_out of each block: so many first modes, rigid ones, are no part of its size.
/// @return k×d, d as small as it can be.
Dense directions_to_grow(const ResidualBasis& basis, const Dense& gram,
                         const DenseResponse& response,
                         const std::vector<double>& samples,
                         const std::vector<Certificate::PortSet>& blocks,
                         const std::vector<double>& scale, double kappa, double cutoff,
                         int modes, const std::vector<int>& left_out, double target);

} // namespace flexgram
