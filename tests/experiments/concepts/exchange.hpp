// SPDX-License-Identifier: Apache-2.0
#pragma once
// What the pictures of docs/concepts.md show: two small bodies, baked, served from files and held
// by a peer, who was sent what a publisher chose for one pose. Everything is the project's own;
// nothing here knows how a forest, a box or an answer comes about.

#include <memory>
#include <string>
#include <vector>

#include "core/replica/replica.hpp"
#include "nearmesh/core/bake/bake.hpp"
#include "nearmesh/core/geometry/motion.hpp"
#include "nearmesh/core/query/contacts.hpp"

namespace nearmesh::concepts {

using Place = std::array<double, 3>;  ///< metres, world

/// One body: its full model, and what the peer holds of it. Bodies are moved, never turned.
struct Body {
  Body(std::string its_name, BakedModel model, const Place& at_m);

  std::string name;
  BakedModel full;
  Motion motion;
  std::unique_ptr<Replica> held;  ///< by exchange()

  [[nodiscard]] const Grid& grid() const { return full.header.grid; }
  [[nodiscard]] Place place(const std::array<double, 3>& grid_units) const;
  [[nodiscard]] Place place(const GridPoint& p) const {
    return place(std::array<double, 3>{double(p[0]), double(p[1]), double(p[2])});
  }
  [[nodiscard]] Place place(VertexId v) const { return place(full.store.position(v)); }
};

struct Face {
  FaceKey key;
  std::array<VertexId, 3> corners;
  bool is_exact = true;
};
/// All faces of the full mesh, as SplitFace::corners() has them.
[[nodiscard]] std::vector<Face> full_faces(const SplitStore& store);
/// The faces that the peer holds now.
[[nodiscard]] std::vector<Face> faces_now(const ActiveMesh& mesh);

/// A node of the front, and what the peer knows of where its faces are.
struct Unresolved {
  NodeSpan node;
  GridBox box;
  std::vector<HalfSpace> half_spaces;
};
[[nodiscard]] std::vector<Unresolved> unresolved_nodes(const ActiveMesh& mesh);

/// Two bodies and the peer's answer about them.
struct Exchange {
  Body ground, other;
  Answer first;                ///< with what the peer had at the start: the base meshes
  Answer answer;               ///< with what was sent
  Answer truth;                ///< of the full meshes
  Contacts contacts;           ///< of the answer
  std::size_t sent_bytes = 0;  ///< batches
};
/// The publisher chooses, the peer takes and answers. Bodies rest. Errors: those of files;
/// kNotFound where the publisher does not serve.
[[nodiscard]] Result<Exchange> exchange(Body ground, Body other);

/// Ground of size x size cells of 32 m, its heights multiplied, baked down to so many faces.
[[nodiscard]] Body make_ground(std::uint32_t size, std::uint64_t seed, std::uint32_t base_faces,
                               double steepness);
/// A ball of so many slices.
[[nodiscard]] Body make_ball(std::uint32_t slices, double radius_m, const Place& centre_m);

/// A hill, and a ball that lies on it: most pictures show it.
[[nodiscard]] Result<Exchange> ball_on_hill();
/// So few vertices that all of the forest can be drawn, and a ball of this radius.
inline constexpr double kPatchBall_m = 12;
[[nodiscard]] Result<Exchange> ball_on_patch();

}  // namespace nearmesh::concepts
