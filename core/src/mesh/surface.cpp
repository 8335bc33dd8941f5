// SPDX-License-Identifier: Apache-2.0
#include "nearmesh/core/mesh/surface.hpp"

#include <algorithm>
#include <numeric>

namespace nearmesh {
namespace {

// An edge of one face: its ends as lesser and greater, and which way the face passes it.
struct HalfEdge {
  std::uint32_t lo, hi;
  bool upward;
  [[nodiscard]] bool same_edge(const HalfEdge& other) const {
    return lo == other.lo && hi == other.hi;
  }
};

}  // namespace

OpenEdges count_open_edges(const GridMesh& mesh) {
  std::vector<HalfEdge> edges;
  edges.reserve(mesh.faces.size() * 3);
  for (const auto& face : mesh.faces) {
    const GridPoint &p = mesh.positions[face[0]], &q = mesh.positions[face[1]],
                    &r = mesh.positions[face[2]];
    if (p == q || q == r || r == p) continue;
    for (std::size_t k = 0; k < 3; ++k) {
      const std::uint32_t a = face[k], b = face[(k + 1) % 3];
      edges.push_back({std::min(a, b), std::max(a, b), a < b});
    }
  }
  std::sort(edges.begin(), edges.end(), [](const HalfEdge& a, const HalfEdge& b) {
    return a.lo != b.lo ? a.lo < b.lo : a.hi < b.hi;
  });
  OpenEdges open;
  for (std::size_t i = 0; i < edges.size();) {
    std::size_t next = i;
    std::int64_t balance = 0;
    for (; next < edges.size() && edges[next].same_edge(edges[i]); ++next)
      balance += edges[next].upward ? 1 : -1;
    if (next - i == 1) {
      ++open.boundary;
    } else if (balance != 0) {
      ++open.disagreeing;
    }
    i = next;
  }
  return open;
}

std::vector<std::uint32_t> find_components(const GridMesh& mesh) {
  std::vector<std::uint32_t> lowest(mesh.positions.size());
  std::iota(lowest.begin(), lowest.end(), 0U);
  const auto root = [&lowest](std::uint32_t v) {
    while (lowest[v] != v) v = lowest[v] = lowest[lowest[v]];
    return v;
  };
  for (const auto& face : mesh.faces) {
    for (std::size_t k = 1; k < 3; ++k) {
      const std::uint32_t a = root(face[0]), b = root(face[k]);
      lowest[std::max(a, b)] = std::min(a, b);
    }
  }
  for (std::uint32_t v = 0; v < lowest.size(); ++v) lowest[v] = root(v);
  return lowest;
}

}  // namespace nearmesh
