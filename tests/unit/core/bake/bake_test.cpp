// SPDX-License-Identifier: Apache-2.0
#include "nearmesh/core/bake/bake.hpp"

#include "brute_force.hpp"
#include "rounds.hpp"

namespace nearmesh {
namespace {

class Bake : public ::testing::TestWithParam<std::string> {};
INSTANTIATE_TEST_SUITE_P(Models, Bake, ::testing::ValuesIn(test::mesh_names()),
                         [](const auto& model) { return model.param; });

TEST_P(Bake, GivesEveryInputFaceToOneSplit) {
  const Result<CleanResult> cleaned = clean_mesh(test::make_mesh(GetParam()));
  ASSERT_TRUE(cleaned.is_ok());
  const Result<BakedModel> model = bake(cleaned.value().mesh, 0, {.base_faces = 16});
  ASSERT_TRUE(model.is_ok());
  std::vector<FaceId> numbers;
  for (const FaceNumber& number : model.value().numbers) numbers.push_back(number.face);
  std::sort(numbers.begin(), numbers.end());
  EXPECT_EQ(numbers, cleaned.value().mesh.face_ids);
  EXPECT_EQ(test::all_faces(model.value().store).size(), numbers.size());
}

TEST_P(Bake, SplitPartsTwoCornersAndTheThirdLiesOutside) {
  const BakedModel model = test::bake_named(GetParam());
  for (const test::KeyedFace& keyed : test::all_faces(model.store)) {
    if (!keyed.key.split.is_valid()) continue;
    const NodeSpan node = model.store.node_of(keyed.key.split);
    EXPECT_TRUE(node.contains(keyed.face.left) && keyed.face.left < keyed.key.split);
    EXPECT_TRUE(node.contains(keyed.face.right) && keyed.face.right >= keyed.key.split);
    EXPECT_FALSE(node.contains(keyed.face.outside));
  }
}

TEST_P(Bake, BaseFacesHaveCornersInThreeRoots) {
  const BakedModel model = test::bake_named(GetParam());
  for (const SplitFace& face : model.header.base_faces) {
    const std::size_t a = model.store.root_index(face.left), b = model.store.root_index(face.right),
                      c = model.store.root_index(face.outside);
    EXPECT_TRUE(a != b && b != c && c != a);
  }
}

TEST_P(Bake, BoxOfEveryNodeEnclosesAllFacesThatTouchIt) {
  const BakedModel model = test::bake_named(GetParam());
  const test::TrueBoxes boxes(model.store);
  const auto expect_enclosed = [&](NodeSpan node) {
    EXPECT_TRUE(model.store.box(node).contains(boxes.of(node)))
        << "node [" << node.begin() << ", " << node.end() << ")";
  };
  for (const BaseRoot& root : model.header.roots) expect_enclosed(root.node);
  for (const VertexId u : test::all_splits(model.store)) {
    const NodeSpan node = model.store.node_of(u);
    expect_enclosed(node.left_of(u));
    expect_enclosed(node.right_of(u));
  }
}

TEST_P(Bake, EveryNodeOfTwoOrMoreHasItsOwnBox) {
  const BakedModel model = test::bake_named(GetParam());
  for (const VertexId u : test::all_splits(model.store)) {
    const NodeSpan node = model.store.node_of(u);
    EXPECT_NE(model.store.box_code(node), kNoBox);
  }
}

TEST_P(Bake, RootsCoverAllVerticesInOrder) {
  const BakedModel model = test::bake_named(GetParam());
  std::uint32_t next = 0;
  for (const BaseRoot& root : model.header.roots) {
    EXPECT_EQ(root.node.begin(), next);
    next = root.node.end();
  }
  EXPECT_EQ(next, model.header.vertex_count);
}

TEST_P(Bake, BaseIsNoLargerThanAskedFor) {
  EXPECT_LE(test::bake_named(GetParam()).header.base_faces.size(), 16U);
}

TEST_P(Bake, LatticeShiftDividesEveryCoordinateAndIsTheGreatest) {
  const BakedModel model = test::bake_named(GetParam());
  std::array<std::uint32_t, 3> any{};
  for (std::uint32_t v = 0; v < model.header.vertex_count; ++v)
    for (int k = 0; k < 3; ++k)
      any[static_cast<std::size_t>(k)] |= static_cast<std::uint32_t>(model.store.position({v})[k]);
  for (std::size_t k = 0; k < 3; ++k) {
    const std::uint32_t cell = 1U << model.header.lattice_shift[k];
    EXPECT_EQ(any[k] % cell, 0U);
    if (any[k] != 0) {
      EXPECT_NE(any[k] & cell, 0U);
    }
  }
}

TEST_P(Bake, IsDeterministic) {
  const BakedModel one = test::bake_named(GetParam()), two = test::bake_named(GetParam());
  EXPECT_EQ(test::write_model(one)->read(), test::write_model(two)->read());
}

void expect_same_bytes_on_threads(const IndexedMesh& mesh) {
  const Result<CleanResult> clean = clean_mesh(mesh);
  ASSERT_TRUE(clean.is_ok());
  std::vector<std::uint8_t> alone;
  for (const unsigned threads : {1U, 2U, 3U, 8U}) {
    if (test::kSanitized && threads != 1 && threads != 8) continue;
    const Result<BakedModel> model = bake(clean.value().mesh, clean.value().report.rounding_error_m,
                                          {.base_faces = 16, .threads = threads});
    ASSERT_TRUE(model.is_ok());
    const auto& [header, store, numbers, log] = model.value();
    const test::TempFile file;
    ASSERT_TRUE(write_model_file(header, store, numbers, file.path(), threads).is_ok());
    if (threads == 1)
      alone = file.read();
    else
      EXPECT_EQ(file.read(), alone) << threads << " threads";
  }
}
TEST_P(Bake, GivesTheSameFileOnAnyNumberOfThreads) {
  expect_same_bytes_on_threads(test::make_mesh(GetParam()));
}
// Large enough for everything that is cut into pieces to have several.
TEST(BakeLarge, GivesTheSameFileOnAnyNumberOfThreads) {
  expect_same_bytes_on_threads(generate_terrain(260, 7));
}
TEST(BakeLarge, GivesTheSameFileOnAnyNumberOfThreadsOfParts) {
  expect_same_bytes_on_threads(test::make_components(2500, 7));
}

TEST_P(Bake, NamesTheLowestVertexOfEachPart) {
  const BakedModel model = test::bake_named(GetParam());
  // By spreading over the faces until nothing changes.
  std::vector<std::uint32_t> lowest(model.header.vertex_count);
  for (std::uint32_t v = 0; v < lowest.size(); ++v) lowest[v] = v;
  const auto faces = test::all_faces(model.store);
  for (bool changed = true; changed;) {
    changed = false;
    for (const test::KeyedFace& keyed : faces) {
      const auto [a, b, c] = keyed.face.corners();
      const std::uint32_t least = std::min({lowest[a.value], lowest[b.value], lowest[c.value]});
      for (const VertexId corner : {a, b, c}) {
        changed = changed || lowest[corner.value] != least;
        lowest[corner.value] = least;
      }
    }
  }
  std::vector<GridPoint> seeds;
  for (std::uint32_t v = 0; v < lowest.size(); ++v)
    if (lowest[v] == v) seeds.push_back(model.store.position({v}));
  EXPECT_EQ(model.header.surface.component_count, seeds.size());
  EXPECT_EQ(model.header.surface.component_seeds, seeds);
  EXPECT_EQ(model.store.surface(), model.header.surface);
}

TEST_P(Bake, CountsOpenEdgesAsCleaningDid) {
  const Result<CleanResult> cleaned = clean_mesh(test::make_mesh(GetParam()));
  const SurfaceFacts facts = test::bake_named(GetParam()).header.surface;
  EXPECT_EQ(facts.boundary_edges, cleaned.value().report.edges_boundary);
  EXPECT_EQ(facts.disagreeing_edges, cleaned.value().report.edges_disagreeing);
  EXPECT_EQ(facts.component_count, cleaned.value().report.components);
  const bool closed =
      GetParam() == "aircraft" || GetParam() == "sphere" || GetParam() == "components";
  EXPECT_EQ(facts.is_closed(), closed);
}

}  // namespace
}  // namespace nearmesh
