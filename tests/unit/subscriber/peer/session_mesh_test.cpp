// SPDX-License-Identifier: Apache-2.0
// What is held of a body, to be drawn.

#include <set>

#include "local_host.hpp"

namespace nearmesh::test {
namespace {

TEST(SessionMesh, IsCoarseThenExactWhereDetailCame) {
  LocalHost host;
  EXPECT_EQ(host.session->held_state(kGround), 0U);
  EXPECT_EQ(host.session->held_mesh(kGround).status().code(), StatusCode::kNotFound);
  host.update();
  const std::uint64_t coarse_state = host.session->held_state(kGround);
  EXPECT_NE(coarse_state, 0U);
  const auto coarse = host.session->held_mesh(kGround);
  ASSERT_TRUE(coarse.is_ok());
  EXPECT_EQ(coarse.value().exact_m.size() % 3, 0U);
  EXPECT_EQ(coarse.value().coarse_m.size(), 3 * terrain().model.header.base_faces.size());

  std::vector<RayAnswer> answers(1);
  RayProbe down;
  down.origin_m = {3, 4, 5000};
  down.direction = {0, 0, -1};
  for (int i = 0; i < 30; ++i) {
    ASSERT_TRUE(host.session->probe(kGround, std::span(&down, 1), answers).is_ok());
    host.update();
  }
  ASSERT_EQ(answers[0].status, ProbeStatus::kHit);
  EXPECT_NE(host.session->held_state(kGround), coarse_state);
  const auto held = host.session->held_mesh(kGround);
  ASSERT_TRUE(held.is_ok());
  // All corners are vertices of the model; each exact face is one of the full mesh.
  using Point = std::array<double, 3>;
  std::set<std::array<Point, 3>> full;
  const BakedModel& model = terrain().model;
  ActiveMesh mesh(model.store);
  RefineDelta delta;
  for (const VertexId split : global_order(model.store, model.header.split_count()))
    ASSERT_TRUE(mesh.split(split, delta));
  for (const ActiveFace& face : extract_faces(mesh)) {
    std::array<Point, 3> corners;
    for (std::size_t k = 0; k < 3; ++k)
      corners[k] = position_m(model.header, model.store, face.corners[k]);
    full.insert(corners);
  }
  ASSERT_FALSE(held.value().exact_m.empty());
  for (std::size_t i = 0; i < held.value().exact_m.size(); i += 3)
    EXPECT_TRUE(full.contains(
        {held.value().exact_m[i], held.value().exact_m[i + 1], held.value().exact_m[i + 2]}));
  EXPECT_FALSE(held.value().coarse_m.empty());
  EXPECT_EQ(host.session->held_mesh(BodyId{7}).status().code(), StatusCode::kNotFound);
}

}  // namespace
}  // namespace nearmesh::test
