// SPDX-License-Identifier: Apache-2.0
// Vertices along a Morton curve, faces by their least corner, adjacency, clusters; and what is left
// at the end.
#include "simplifier.hpp"

namespace nearmesh::simplification {
namespace {

void place_vertices(const GridMesh& mesh, Patch& patch) {
  const std::size_t count = mesh.positions.size();
  std::int32_t greatest = 0;
  for (const GridPoint& p : mesh.positions) greatest = std::max({greatest, p[0], p[1], p[2]});
  patch.code_shift =
      std::max(0, static_cast<int>(std::bit_width(static_cast<std::uint32_t>(greatest))) - 21);

  std::vector<std::pair<std::uint64_t, std::uint32_t>> order(count);
  for (std::uint32_t i = 0; i < count; ++i)
    order[i] = {morton_code(mesh.positions[i].v, patch.code_shift), i};
  std::sort(order.begin(), order.end());

  patch.number.resize(count);
  patch.vertices.resize(count);
  for (std::size_t i = 0; i < count; ++i) {
    patch.number[i] = order[i].second;
    patch.vertices[i].p = mesh.positions[order[i].second].v;
  }
}

std::uint32_t pack_normal_of(const Patch& patch, const Face& f) {
  const auto side = [&](std::size_t k) {
    const auto &a = patch.vertices[f.corner[0]].p, &b = patch.vertices[f.corner[k]].p;
    return Vec3{static_cast<double>(b[0] - a[0]), static_cast<double>(b[1] - a[1]),
                static_cast<double>(b[2] - a[2])};
  };
  return pack_normal(cross(side(1), side(2)));
}

void place_faces(const GridMesh& mesh, Patch& patch) {
  std::vector<std::uint32_t> place(patch.number.size());
  for (std::uint32_t i = 0; i < place.size(); ++i) place[patch.number[i]] = i;
  // Counting sort by least corner; the input's order breaks ties.
  const auto least = [&](const std::array<std::uint32_t, 3>& f) {
    return std::min({place[f[0]], place[f[1]], place[f[2]]});
  };
  const auto is_proper = [](const std::array<std::uint32_t, 3>& f) {
    return f[0] != f[1] && f[1] != f[2] && f[2] != f[0];
  };
  std::vector<std::uint32_t> start(place.size() + 1, 0);
  for (const auto& f : mesh.faces)
    if (is_proper(f)) ++start[least(f) + 1];
  for (std::size_t i = 1; i < start.size(); ++i) start[i] += start[i - 1];
  patch.faces.resize(start.back());
  for (const auto& f : mesh.faces) {
    if (!is_proper(f)) continue;
    Face& face = patch.faces[start[least(f)]++];
    for (int k = 0; k < 3; ++k) face.corner[k] = place[f[k]];
    face.normal = pack_normal_of(patch, face);
  }
}

}  // namespace

Patch place_mesh(const GridMesh& mesh) {
  Patch patch;
  place_vertices(mesh, patch);
  place_faces(mesh, patch);
  return patch;
}

Simplifier::Simplifier(Patch patch, std::size_t own, std::uint64_t target_faces)
    : target_faces_(target_faces),
      code_shift_(patch.code_shift),
      input_number_(std::move(patch.number)),
      vertices_(patch.vertices.size()),
      faces_(std::move(patch.faces)),
      clusters_(std::move(patch.clusters)),
      queue_(static_cast<std::uint32_t>(vertices_.size())),
      choice_(vertices_.size(), kNone) {
  for (std::size_t i = 0; i < vertices_.size(); ++i) {
    vertices_[i].p = patch.vertices[i].p;
    vertices_[i].depth = patch.vertices[i].depth & Vertex::kMostDepth;
  }
  patch.vertices = {};
  faces_in_ = faces_left_ = faces_.size();
  link_faces();
  lock_border(own);
  if (clusters_.empty()) add_clusters(own);
  collapses_.reserve(vertices_.size());
}

void Simplifier::link_faces() {
  for (const Face& f : faces_)
    for (const std::uint32_t c : f.corner) ++vertices_[c].capacity;
  std::uint32_t first = 0;
  for (Vertex& v : vertices_) {
    v.first = first;
    v.is_crowded = v.capacity > kCrowd;
    first += v.capacity;
  }
  // Room for slices that outgrow their place before the pool is compacted. Places are of 32 bits,
  // and 3 * 2^30 are in use at most.
  pool_limit_ = std::min<std::size_t>(std::size_t{first} + first / 2 + 64, kNone);
  pool_.reserve(pool_limit_);
  pool_.resize(std::max<std::size_t>(first, 1));
  for (std::uint32_t i = 0; i < faces_.size(); ++i)
    for (const std::uint32_t c : faces_[i].corner) {
      Vertex& v = vertices_[c];
      pool_[v.first + v.count++] = i;
    }
}

void Simplifier::lock_border(std::size_t own) {
  if (own == vertices_.size()) return;
  for (const Face& f : faces_) {
    if (std::all_of(f.corner.begin(), f.corner.end(), [own](std::uint32_t c) { return c < own; }))
      continue;
    for (const std::uint32_t c : f.corner) vertices_[c].is_locked = 1;
  }
}

void Simplifier::add_clusters(std::size_t own) {
  clusters_.resize(vertices_.size());
  for (std::uint32_t u = 0; u < own; ++u) {
    Quadric& q = clusters_[u].quadric;
    GridBox& box = clusters_[u].box;
    const Vertex& v = vertices_[u];
    box.add(GridPoint{v.p});
    gather_ring(u, ring_);
    const std::uint32_t once = stamp_ + 1;
    for (const std::uint32_t* it = faces_begin(v); it != faces_end(v); ++it) {
      const Face& f = faces_[*it];
      const Vec3 n = normal_of(f);
      const double length = std::sqrt(dot(n, n));
      const Vec3 unit = length > 0 ? Vec3{n[0] / length, n[1] / length, n[2] / length} : Vec3{};
      q.add_plane(unit, length / 2);
      for (const std::uint32_t x : f.corner) {
        box.add(GridPoint{vertices_[x].p});
        if (x == u || vertices_[x].mark != once) continue;
        // A border edge: the plane through it that stands upright on its face.
        const Vec3 e = between(v, vertices_[x]);
        if (length > 0)
          q.add_plane(cross(unit, e), kBorderWeight);
        else
          q.add_line(e, kBorderWeight);
      }
    }
    clusters_[u].weigh();
  }
}

Patch Simplifier::take_rest(std::size_t own, std::vector<std::uint32_t>& place) {
  Patch rest;
  rest.code_shift = code_shift_;
  place.clear();
  for (std::uint32_t i = 0; i < own; ++i)
    if (vertices_[i].first != kNone) place.push_back(i);
  rest.vertices.reserve(place.size());
  rest.number.reserve(place.size());
  rest.clusters.reserve(place.size());
  for (const std::uint32_t i : place) {
    rest.vertices.push_back({vertices_[i].p, vertices_[i].depth});
    rest.number.push_back(input_number_[i]);
    rest.clusters.push_back(clusters_[i]);
  }
  rest.faces.reserve(faces_left_);
  for (const Face& f : faces_)
    if (f.corner[0] != kNone) rest.faces.push_back(f);
  return rest;
}

}  // namespace nearmesh::simplification
