// SPDX-License-Identifier: Apache-2.0
// Vertices along a Morton curve, faces by their least corner, adjacency, quadrics.
#include "simplifier.hpp"

namespace nearmesh::simplification {

void Simplifier::place_vertices(const GridMesh& mesh) {
  const std::size_t count = mesh.positions.size();
  std::int32_t greatest = 0;
  for (const GridPoint& p : mesh.positions) greatest = std::max({greatest, p[0], p[1], p[2]});
  code_shift_ =
      std::max(0, static_cast<int>(std::bit_width(static_cast<std::uint32_t>(greatest))) - 21);

  std::vector<std::pair<std::uint64_t, std::uint32_t>> order(count);
  for (std::uint32_t i = 0; i < count; ++i)
    order[i] = {morton_code(mesh.positions[i].v, code_shift_), i};
  std::sort(order.begin(), order.end());

  input_number_.resize(count);
  vertices_.resize(count);
  choice_.assign(count, kNone);
  for (std::size_t i = 0; i < count; ++i) {
    input_number_[i] = order[i].second;
    vertices_[i].p = mesh.positions[order[i].second].v;
  }
}

void Simplifier::place_faces(const GridMesh& mesh) {
  std::vector<std::uint32_t> place(vertices_.size());
  for (std::uint32_t i = 0; i < vertices_.size(); ++i) place[input_number_[i]] = i;
  // Counting sort by least corner; the input's order breaks ties.
  const auto least = [&](const std::array<std::uint32_t, 3>& f) {
    return std::min({place[f[0]], place[f[1]], place[f[2]]});
  };
  const auto is_proper = [](const std::array<std::uint32_t, 3>& f) {
    return f[0] != f[1] && f[1] != f[2] && f[2] != f[0];
  };
  std::vector<std::uint32_t> start(vertices_.size() + 1, 0);
  for (const auto& f : mesh.faces)
    if (is_proper(f)) ++start[least(f) + 1];
  for (std::size_t i = 1; i < start.size(); ++i) start[i] += start[i - 1];
  faces_.resize(start.back());
  for (const auto& f : mesh.faces) {
    if (!is_proper(f)) continue;
    Face& face = faces_[start[least(f)]++];
    for (int k = 0; k < 3; ++k) face.corner[k] = place[f[k]];
    face.normal = pack_normal(normal_of(face));
  }
  faces_in_ = faces_left_ = faces_.size();
}

void Simplifier::link_faces() {
  for (const Face& f : faces_)
    for (const std::uint32_t c : f.corner) ++vertices_[c].capacity;
  std::uint32_t first = 0;
  for (Vertex& v : vertices_) {
    v.first = first;
    first += v.capacity;
  }
  // Room for slices that outgrow their place before the pool is compacted.
  pool_limit_ = std::size_t{first} + first / 2 + 64;
  pool_.reserve(pool_limit_);
  pool_.resize(std::max<std::size_t>(first, 1));
  for (std::uint32_t i = 0; i < faces_.size(); ++i)
    for (const std::uint32_t c : faces_[i].corner) {
      Vertex& v = vertices_[c];
      pool_[v.first + v.count++] = i;
    }
}

void Simplifier::add_quadrics() {
  quadrics_.resize(vertices_.size());
  for (std::uint32_t u = 0; u < vertices_.size(); ++u) {
    Quadric& q = quadrics_[u];
    const Vertex& v = vertices_[u];
    gather_ring(u, ring_);
    const std::uint32_t once = stamp_ + 1;
    for (const std::uint32_t* it = faces_begin(v); it != faces_end(v); ++it) {
      const Face& f = faces_[*it];
      const Vec3 n = normal_of(f);
      const double length = std::sqrt(dot(n, n));
      const Vec3 unit = length > 0 ? Vec3{n[0] / length, n[1] / length, n[2] / length} : Vec3{};
      q.add_plane(unit, length / 2);
      for (const std::uint32_t x : f.corner) {
        if (x == u || vertices_[x].mark != once) continue;
        // A border edge: the plane through it that stands upright on its face.
        const Vec3 e = between(v, vertices_[x]);
        if (length > 0)
          q.add_plane(cross(unit, e), kBorderWeight);
        else
          q.add_line(e, kBorderWeight);
      }
    }
  }
}

}  // namespace nearmesh::simplification
