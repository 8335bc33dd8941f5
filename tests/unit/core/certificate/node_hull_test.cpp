// SPDX-License-Identifier: Apache-2.0
#include "core/certificate/node_hull.hpp"

#include "brute_force.hpp"
#include "test_models.hpp"

namespace nearmesh {
namespace {

class HullOfNode : public ::testing::TestWithParam<std::string> {
 protected:
  /// Makes the node known to a file that was read as far as `file` was.
  static void reach(ModelFile& file, NodeSpan node) {
    const SplitStore& store = file.store();
    NodeSpan at = store.roots()[store.root_index(node.first)].node;
    while (at != node) {
      ASSERT_TRUE(file.require(at).is_ok());
      const VertexId split = store.split_of(at);
      const NodeSpan left = at.left_of(split);
      at = node.begin() >= split.value ? at.right_of(split) : left;
    }
  }
  static std::vector<NodeSpan> all_nodes(const SplitStore& store) {
    std::vector<NodeSpan> nodes;
    for (const BaseRoot& root : store.roots()) nodes.push_back(root.node);
    for (std::uint32_t v = 0; v < store.vertex_count(); ++v) {
      if (store.is_root({v})) continue;
      const NodeSpan node = store.node_of({v});
      nodes.push_back(node.left_of({v}));
      nodes.push_back(node.right_of({v}));
    }
    return nodes;
  }
};
INSTANTIATE_TEST_SUITE_P(Meshes, HullOfNode, ::testing::ValuesIn(test::mesh_names()));

TEST_P(HullOfNode, HoldsEveryFaceOfTheNodeWhateverHasBeenRead) {
  const BakedModel baked = test::bake_named(GetParam());
  const auto path = test::write_model(baked);
  const test::TrueBoxes truth(baked.store);
  std::vector<NodeSpan> nodes = all_nodes(baked.store);
  Random random(17);
  test::shuffle(nodes, random);
  std::optional<ModelFile> file;
  std::size_t small = 0, large = 0;
  for (std::size_t i = 0; i < nodes.size() && i < 1200; ++i) {
    SCOPED_TRACE(to_string(nodes[i]));
    if (i % 16 == 0) file.emplace(ModelFile::open(path->path()).value());
    reach(*file, nodes[i]);
    const Result<NodeHull> hull = hull_of_node(*file, nodes[i]),
                           below = hull_below(*file, nodes[i]);
    ASSERT_TRUE(hull.is_ok()) << hull.status().message();
    ASSERT_TRUE(below.is_ok()) << below.status().message();
    std::vector<GridPoint> points = hull.value().points(file->store());
    std::sort(points.begin(), points.end());
    points.erase(std::unique(points.begin(), points.end()), points.end());
    std::vector<GridPoint> some = below.value().points(file->store());
    std::sort(some.begin(), some.end());
    some.erase(std::unique(some.begin(), some.end()), some.end());
    std::vector<GridPoint> corners;
    truth.for_each_corner(nodes[i], [&](const GridPoint& p) { corners.push_back(p); });
    for (std::uint32_t v = nodes[i].begin(); v < nodes[i].end(); ++v)
      corners.push_back(baked.store.position({v}));
    std::sort(corners.begin(), corners.end());
    corners.erase(std::unique(corners.begin(), corners.end()), corners.end());
    if (nodes[i].size <= 256) {
      ++small;
      EXPECT_EQ(points, corners);
      EXPECT_GE(below.value().vertices.size(), nodes[i].size);
      EXPECT_TRUE(std::includes(points.begin(), points.end(), some.begin(), some.end()));
      continue;
    }
    ++large;
    const GridPoint origin{};
    for (std::uint32_t direction = 0; direction < 1U << kDirectionBits; direction += 5) {
      const auto& normal = half_space_normal(static_cast<std::uint16_t>(direction));
      const auto support = [&](const std::vector<GridPoint>& of) {
        std::int64_t most = way_along(normal, origin, of.front());
        for (const GridPoint& p : of) most = std::max(most, way_along(normal, origin, p));
        return most;
      };
      ASSERT_GE(support(points), support(corners)) << direction;
    }
  }
  EXPECT_GT(small, 0U);
  if (GetParam() == "soup") {
    EXPECT_GT(large, 0U);
  }
}

// A node's faces are those of its two parts.
TEST_P(HullOfNode, OfTwoPartsIsThatOfTheWhole) {
  const BakedModel baked = test::bake_named(GetParam());
  const auto path = test::write_model(baked);
  ModelFile file = ModelFile::open(path->path()).value();
  ASSERT_TRUE(file.require_all().is_ok());
  int count = 0;
  for (const NodeSpan& node : all_nodes(file.store())) {
    if (node.size < 2 || node.size > 256 || ++count > 200) continue;
    const VertexId split = file.store().split_of(node);
    NodeHull both = hull_of_node(file, node.left_of(split)).value();
    both.add(hull_of_node(file, node.right_of(split)).value());
    EXPECT_EQ(both.vertices, hull_of_node(file, node).value().vertices) << to_string(node);
  }
}

TEST(HullOfNodes, ReadsWhatIsNear) {
  const BakedModel baked = test::bake_mesh(generate_terrain(150, 3));
  const auto path = test::write_model(baked);
  ModelFile file = ModelFile::open(path->path()).value();
  NodeSpan node = file.store().roots().front().node;
  while (node.size > 60) {
    ASSERT_TRUE(file.require(node).is_ok());
    const VertexId split = file.store().split_of(node);
    const NodeSpan left = node.left_of(split), right = node.right_of(split);
    node = left.size > right.size ? left : right;
  }
  ASSERT_GT(node.size, 8U);
  ASSERT_TRUE(hull_of_node(file, node).is_ok());
  EXPECT_LT(file.store().known_splits(), baked.store.known_splits() / 5);
}

}  // namespace
}  // namespace nearmesh
