// SPDX-License-Identifier: Apache-2.0
#include "surface.hpp"

#include <algorithm>
#include <numeric>

namespace nearmesh {

namespace {

/// As ==, which calls memcmp.
bool same_place(const GridPoint& p, const GridPoint& q) {
  return p[0] == q[0] && p[1] == q[1] && p[2] == q[2];
}

}  // namespace

UnclosedEdges count_unclosed_edges(std::span<const GridPoint> positions, SurfaceFaces faces) {
  // Counting sort of the sides of all faces by their lower end, then each (short) group by the
  // upper one. An item holds that end and, in its lowest bit, whether the face passes the edge
  // upward.
  const auto visit_sides = [&](const auto& visit) {
    for (const auto& face : faces) {
      const GridPoint &p = positions[face[0]], &q = positions[face[1]], &r = positions[face[2]];
      if (same_place(p, q) || same_place(q, r) || same_place(r, p)) continue;
      for (std::size_t k = 0; k < 3; ++k) visit(face[k], face[(k + 1) % 3]);
    }
  };
  const std::size_t vertices = positions.size();
  std::vector<std::uint32_t> begin(vertices + 1, 0);
  visit_sides([&](std::uint32_t a, std::uint32_t b) { ++begin[std::min(a, b)]; });
  // Each group is filled from its end, after which `begin` holds where it starts.
  std::partial_sum(begin.begin(), begin.end(), begin.begin());
  std::vector<std::uint32_t> items(begin.back());
  visit_sides([&](std::uint32_t a, std::uint32_t b) {
    items[--begin[std::min(a, b)]] = std::max(a, b) << 1 | (a < b ? 1U : 0U);
  });
  UnclosedEdges open;
  for (std::size_t v = 0; v < vertices; ++v) {
    const auto group = std::span(items).subspan(begin[v], begin[v + 1] - begin[v]);
    std::sort(group.begin(), group.end());
    for (std::size_t i = 0; i < group.size();) {
      std::size_t next = i;
      std::int64_t balance = 0;
      for (; next < group.size() && group[next] >> 1 == group[i] >> 1; ++next)
        balance += (group[next] & 1U) != 0 ? 1 : -1;
      if (next - i == 1) {
        ++open.boundary;
      } else if (balance != 0) {
        ++open.disagreeing;
      }
      i = next;
    }
  }
  return open;
}

std::vector<std::uint32_t> find_components(std::size_t vertices, SurfaceFaces faces) {
  std::vector<std::uint32_t> lowest(vertices);
  std::iota(lowest.begin(), lowest.end(), 0U);
  const auto root = [&lowest](std::uint32_t v) {
    while (lowest[v] != v) v = lowest[v] = lowest[lowest[v]];
    return v;
  };
  for (const auto& face : faces) {
    for (std::size_t k = 1; k < 3; ++k) {
      const std::uint32_t a = root(face[0]), b = root(face[k]);
      lowest[std::max(a, b)] = std::min(a, b);
    }
  }
  for (std::uint32_t v = 0; v < lowest.size(); ++v) lowest[v] = root(v);
  return lowest;
}

}  // namespace nearmesh
