// SPDX-License-Identifier: Apache-2.0
#include "check_surface.hpp"

#include <array>
#include <string>
#include <vector>

#include "core/geometry/surface.hpp"

namespace nearmesh {
namespace {

Status contradiction(const std::string& what, std::uint64_t said, std::uint64_t found) {
  return {StatusCode::kCorrupt, "the header says " + std::to_string(said) + " " + what +
                                    ", the faces have " + std::to_string(found)};
}

}  // namespace

Status check_surface(const SplitStore& store) {
  NEARMESH_ASSERT(store.known_splits() + store.roots().size() == store.vertex_count());
  std::vector<GridPoint> positions(store.vertex_count());
  std::vector<std::array<std::uint32_t, 3>> faces;
  const auto add = [&faces](const SplitFace& face) {
    const auto corners = face.corners();
    faces.push_back({corners[0].value, corners[1].value, corners[2].value});
  };
  for (const SplitFace& face : store.base_faces()) add(face);
  for (VertexId v{0}; v.value < store.vertex_count(); ++v.value) {
    positions[v.value] = store.position(v);
    if (store.is_root(v)) continue;
    for (const SplitFace& face : store.faces(v)) add(face);
  }
  const SurfaceFacts& said = store.surface();
  const UnclosedEdges open = count_unclosed_edges(positions, faces);
  if (said.boundary_edges != open.boundary)
    return contradiction("edges with one face", said.boundary_edges, open.boundary);
  if (said.disagreeing_edges != open.disagreeing)
    return contradiction("edges whose faces disagree", said.disagreeing_edges, open.disagreeing);
  const std::vector<std::uint32_t> lowest = find_components(positions.size(), faces);
  std::vector<GridPoint> seeds;
  for (std::uint32_t v = 0; v < lowest.size(); ++v)
    if (lowest[v] == v) seeds.push_back(positions[v]);
  if (said.component_count != seeds.size())
    return contradiction("parts", said.component_count, seeds.size());
  if (said.has_seeds() && said.component_seeds != seeds)
    return {StatusCode::kCorrupt, "the header's seeds are not the lowest vertices of its parts"};
  return Status::ok();
}

}  // namespace nearmesh
