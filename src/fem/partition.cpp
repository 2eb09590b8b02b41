#include "base/index.hpp"
#include "base/text.hpp"
#include "fem/mesh.hpp"

#include <metis.h>

#include <algorithm>

namespace flexgram {
namespace {

/// Every connectivity of the file, one block after the other, as METIS wants it.
struct WholeMesh {
  std::vector<idx_t> start{0}, node;
};

WholeMesh read_whole_mesh(const Hdf5File& file, const BodyDescription& body) {
  WholeMesh mesh;
  for (const auto& block : body.blocks) {
    const auto nodes = file.read_all<std::int64_t>(block.path + "/connectivity");
    for (std::size_t k = 0; k < nodes.size(); ++k)
      if (nodes[k] < 0 || nodes[k] >= body.points)
        throw Error(text(
            "file %s: element %zu of %s has node %lld, the mesh has %lld points",
            file.path().c_str(), k / as_size(node_count(block.type)), block.path.c_str(),
            static_cast<long long>(nodes[k]), static_cast<long long>(body.points)));
    mesh.node.insert(mesh.node.end(), nodes.begin(), nodes.end());
    for (std::int64_t e = 0; e < block.elements; ++e)
      mesh.start.push_back(mesh.start.back() + node_count(block.type));
  }
  return mesh;
}

} // namespace

Partition partition_mesh(const Hdf5File& file, const BodyDescription& body) {
  const MPI_Comm comm = file.comm();
  const int size = comm_size(comm), rank = comm_rank(comm);
  std::int64_t elements = 0;
  for (const auto& block : body.blocks) elements += block.elements;
  std::vector<int> node_part(as_size(body.points), -1);
  std::vector<int> element_part(as_size(elements), 0);
  agree(comm, [&] {
    if (rank != 0) return;
    WholeMesh mesh = read_whole_mesh(file, body);
    std::vector<idx_t> nodes(node_part.size(), 0), parts(element_part.size(), 0);
    if (size > 1) {
      idx_t element_count = static_cast<idx_t>(elements);
      idx_t node_count_all = static_cast<idx_t>(body.points), part_count = size, cut = 0;
      idx_t options[METIS_NOPTIONS];
      METIS_SetDefaultOptions(options);
      options[METIS_OPTION_NUMBERING] = 0;
      if (METIS_PartMeshNodal(&element_count, &node_count_all, mesh.start.data(),
                              mesh.node.data(), nullptr, nullptr, &part_count, nullptr,
                              options, &cut, parts.data(), nodes.data()) != METIS_OK)
        throw Error("METIS could not partition the mesh");
    }
    std::copy(parts.begin(), parts.end(), element_part.begin());
    for (idx_t node : mesh.node)
      node_part[as_size(node)] = static_cast<int>(nodes[as_size(node)]);
  });
  MPI_Bcast(node_part.data(), static_cast<int>(node_part.size()), MPI_INT, 0, comm);
  MPI_Bcast(element_part.data(), static_cast<int>(element_part.size()), MPI_INT, 0, comm);
  Partition partition;
  partition.node_owner = std::move(node_part);
  auto first = element_part.begin();
  for (const auto& block : body.blocks) {
    partition.element_owner.emplace_back(first,
                                         first + static_cast<long>(block.elements));
    first += static_cast<long>(block.elements);
  }
  return partition;
}

} // namespace flexgram
