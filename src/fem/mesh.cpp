#include "fem/mesh.hpp"

#include "base/index.hpp"
#include "base/text.hpp"

#include <algorithm>
#include <cmath>

namespace flexgram {
namespace {

constexpr std::int64_t chunk = 1 << 16; // elements or points read at a time

std::array<double, 6> checked_axes(const Hdf5File& file, const MeshBlock& block,
                                   std::int64_t element, const double* values) {
  std::array<double, 6> axes;
  std::copy(values, values + 6, axes.begin());
  double one = 0, two = 0, both = 0;
  for (std::size_t c = 0; c < 3; ++c) {
    one += axes[c] * axes[c];
    two += axes[3 + c] * axes[3 + c];
    both += axes[c] * axes[3 + c];
  }
  for (double off : {one - 1, two - 1, both})
    if (!(std::abs(off) < 1e-9))
      throw Error(text("file %s: %s/axes: those of element %lld are not orthonormal",
                       file.path().c_str(), block.path.c_str(),
                       static_cast<long long>(element)));
  return axes;
}

} // namespace

std::size_t LocalMesh::place(std::int64_t node) const {
  return as_size(std::lower_bound(nodes.begin(), nodes.end(), node) - nodes.begin());
}

LocalMesh read_local_mesh(const Hdf5File& file, const BodyDescription& body,
                          const Partition& partition, std::vector<std::int64_t> extra) {
  const int rank = comm_rank(file.comm());
  LocalMesh mesh;
  agree(file.comm(), [&] {
    mesh.nodes = std::move(extra);
    for (std::size_t b = 0; b < body.blocks.size(); ++b) {
      const MeshBlock& block = body.blocks[b];
      const auto width = as_size(node_count(block.type));
      LocalElements mine{&block, {}, {}};
      for (std::int64_t first = 0; first < block.elements; first += chunk) {
        const std::int64_t count = std::min(chunk, block.elements - first);
        const auto nodes =
            file.read<std::int64_t>(block.path + "/connectivity", first, count);
        std::vector<double> axes;
        if (block.axes > 0) axes = file.read<double>(block.path + "/axes", first, count);
        for (std::int64_t e = 0; e < count; ++e) {
          if (partition.element_owner[b][as_size(first + e)] != rank) continue;
          const auto begin = nodes.begin() + static_cast<long>(as_size(e) * width);
          mine.number.push_back(first + e);
          mine.connectivity.insert(mine.connectivity.end(), begin,
                                   begin + static_cast<long>(width));
          for (std::size_t k = 0; k < block.axes; ++k)
            mine.axes.push_back(checked_axes(file, block, first + e,
                                             &axes[6 * (block.axes * as_size(e) + k)]));
        }
      }
      mesh.nodes.insert(mesh.nodes.end(), mine.connectivity.begin(),
                        mine.connectivity.end());
      mesh.elements.push_back(std::move(mine));
    }
    std::sort(mesh.nodes.begin(), mesh.nodes.end());
    mesh.nodes.erase(std::unique(mesh.nodes.begin(), mesh.nodes.end()), mesh.nodes.end());
    mesh.coordinates.resize(mesh.nodes.size());
    std::size_t next = 0;
    for (std::int64_t first = 0; first < body.points; first += chunk) {
      const std::int64_t count = std::min(chunk, body.points - first);
      if (next == mesh.nodes.size() || mesh.nodes[next] >= first + count) continue;
      const auto points = file.read<double>("/mesh/points", first, count);
      for (; next < mesh.nodes.size() && mesh.nodes[next] < first + count; ++next)
        for (std::size_t a = 0; a < 3; ++a) {
          const double x = points[as_size(3 * (mesh.nodes[next] - first)) + a];
          if (!std::isfinite(x))
            throw Error(text("file %s: /mesh/points(%lld, %zu) = %g must be finite",
                             file.path().c_str(),
                             static_cast<long long>(mesh.nodes[next]), a, x));
          mesh.coordinates[next][a] = x;
        }
    }
  });
  return mesh;
}

} // namespace flexgram
