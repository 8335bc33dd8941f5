// SPDX-License-Identifier: Apache-2.0
#pragma once
// What a film tells of one model (takes meshes that peers hold, gives numbers of their faces and
// nodes): each once, however many hold it. For film.cpp alone.

#include <algorithm>
#include <array>
#include <cstdint>
#include <unordered_map>
#include <utility>
#include <vector>

#include "core/base/hash.hpp"
#include "core/replica/replica.hpp"
#include "film_stream.hpp"
#include "nearmesh/core/spm/detail/half_space.hpp"

namespace nearmesh::subscriber {

/// What was told of one model.
class FilmModel {
 public:
  FilmModel(FilmStream& out, std::uint32_t index) : out_(out), index_(index) {}

  /// The faces and nodes of a peer's mesh, by number, ascending.
  struct Mesh {
    std::vector<std::uint32_t> faces, nodes;
  };
  Mesh add(const ActiveMesh& mesh) {
    Mesh held;
    const SplitStore& store = mesh.store();
    for (VertexId v{0}; v.value < store.vertex_count();) {
      const NodeSpan node = mesh.current_node(v);
      held.nodes.push_back(add(mesh, node));
      v = {node.end()};
    }
    for (const ActiveFace& face : extract_faces(mesh)) {
      std::array<std::uint32_t, 3> corners{};
      for (std::size_t i = 0; i < 3; ++i) corners[i] = vertices_.at(face.corners[i].value);
      const auto [at, is_new] =
          faces_.try_emplace(corners, static_cast<std::uint32_t>(faces_.size()));
      if (is_new) new_faces_.push_back(corners);
      held.faces.push_back(at->second);
    }
    std::sort(held.faces.begin(), held.faces.end());
    std::sort(held.nodes.begin(), held.nodes.end());
    tell();
    return held;
  }
  /// The number of an unresolved node that is in the mesh.
  std::uint32_t number_of(const ActiveMesh& mesh, NodeSpan node) {
    const std::uint32_t number = add(mesh, node);
    tell();
    return number;
  }

 private:
  struct NewNode {
    std::uint32_t vertex = 0;
    bool is_exact = true;
    std::array<std::int64_t, 6> reach{};  // -x +x -y +y -z +z of the vertex
    std::vector<HalfSpace> half_spaces;
  };
  struct NodeName {
    std::uint32_t first = 0, size = 0;
    std::uint64_t told = 0;  // digest of its half-spaces
    auto operator<=>(const NodeName&) const = default;
  };
  struct Hash {
    std::size_t operator()(const std::array<std::uint32_t, 3>& c) const {
      return mix(mix(std::uint64_t{c[0]} << 32 | c[1]) ^ c[2]);
    }
    std::size_t operator()(const NodeName& n) const {
      return mix(mix(std::uint64_t{n.first} << 32 | n.size) ^ n.told);
    }
  };

  std::uint32_t add(const ActiveMesh& mesh, NodeSpan node) {
    const SplitStore& store = mesh.store();
    const auto half_spaces = mesh.half_spaces().of(node.first);
    NodeName name{node.begin(), node.size, 0};
    for (const HalfSpace& told : half_spaces)
      name.told = mix(name.told ^ (std::uint64_t{told.direction} << 8 | told.reach));
    const auto [at, is_new] = nodes_.try_emplace(name, static_cast<std::uint32_t>(nodes_.size()));
    if (!is_new) return at->second;
    const GridPoint& position = store.position(node.first);
    const auto [vertex, is_new_vertex] =
        vertices_.try_emplace(node.begin(), static_cast<std::uint32_t>(vertices_.size()));
    if (is_new_vertex) new_vertices_.push_back(position);
    NewNode told{.vertex = vertex->second, .is_exact = node.size == 1};
    if (!told.is_exact) {
      const GridBox box = store.box(node);
      for (int k = 0; k < 3; ++k) {
        const auto axis = static_cast<std::size_t>(2 * k);
        told.reach[axis] = std::max<std::int64_t>(0, std::int64_t{position[k]} - box.lo[k]);
        told.reach[axis + 1] = std::max<std::int64_t>(0, std::int64_t{box.hi[k]} - position[k]);
      }
      told.half_spaces.assign(half_spaces.begin(), half_spaces.end());
    }
    new_nodes_.push_back(std::move(told));
    return at->second;
  }

  /// Says what is new.
  void tell() {
    if (!new_vertices_.empty()) {
      out_.begin('V', index_, new_vertices_.size());
      for (int k = 0; k < 3; ++k)
        for (const GridPoint& point : new_vertices_)
          out_.difference(last_vertex_[static_cast<std::size_t>(k)], point[k]);
      new_vertices_.clear();
    }
    if (!new_nodes_.empty()) {
      out_.begin('N', index_, new_nodes_.size());
      for (const NewNode& node : new_nodes_) out_.difference(last_node_, node.vertex);
      for (const NewNode& node : new_nodes_)
        out_.number(node.is_exact ? 0 : 1 + node.half_spaces.size());
      for (const NewNode& node : new_nodes_)
        if (!node.is_exact)
          for (const std::int64_t reach : node.reach)
            out_.number(static_cast<std::uint64_t>(reach));
      for (const NewNode& node : new_nodes_)
        for (const HalfSpace& told : node.half_spaces) {
          for (const std::int8_t n : half_space_normal(told.direction)) out_.signed_number(n);
          out_.number(static_cast<std::uint64_t>(half_space_reach(told.reach)));
        }
      new_nodes_.clear();
    }
    if (!new_faces_.empty()) {
      out_.begin('F', index_, new_faces_.size());
      for (std::size_t i = 0; i < 3; ++i)
        for (const auto& corners : new_faces_)
          if (i == 0)
            out_.difference(last_corner_, corners[0]);
          else
            out_.signed_number(std::int64_t{corners[i]} - corners[0]);
      new_faces_.clear();
    }
  }

  FilmStream& out_;
  std::uint32_t index_;
  std::unordered_map<std::uint32_t, std::uint32_t> vertices_;  // numbers by id
  std::unordered_map<NodeName, std::uint32_t, Hash> nodes_;
  std::unordered_map<std::array<std::uint32_t, 3>, std::uint32_t, Hash> faces_;
  std::vector<GridPoint> new_vertices_;
  std::vector<NewNode> new_nodes_;
  std::vector<std::array<std::uint32_t, 3>> new_faces_;
  std::array<std::int64_t, 3> last_vertex_{};
  std::int64_t last_node_ = 0, last_corner_ = 0;
};

}  // namespace nearmesh::subscriber
