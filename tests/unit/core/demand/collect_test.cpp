// SPDX-License-Identifier: Apache-2.0
#include "core/demand/collect.hpp"

#include "brute_force.hpp"

namespace nearmesh {
namespace {

RegionRequest request_for_all(const BakedModel& model) {
  RegionRequest request{.region = {}, .max_splits = kMaxRequestSplits};
  for (const BaseRoot& root : model.header.roots)
    if (root.node.size > 1) request.attach.push_back(root.node);
  return request;
}

GridBox random_box(const BakedModel& model, Random& random) {
  GridBox box;
  const std::int32_t radius = model.store.grid_max() >> (2 + random.below(10));
  const bool at_vertex = random.below(2) == 0;
  const GridPoint& v = model.store.position({random.below(model.header.vertex_count)});
  for (int k = 0; k < 3; ++k) {
    const auto at = at_vertex ? v[k]
                              : static_cast<std::int32_t>(random.below(
                                    static_cast<std::uint32_t>(model.store.grid_max())));
    box.lo[k] = at - radius;
    box.hi[k] = at + radius;
  }
  return box;
}

class Collect : public ::testing::TestWithParam<std::string> {};
INSTANTIATE_TEST_SUITE_P(Models, Collect, ::testing::ValuesIn(test::mesh_names()),
                         [](const auto& model) { return model.param; });

// A child's box may stand out of its parent's, and then meet parts that the parent's does not.
TEST_P(Collect, SplitsEveryNodeBelowASplitOneWhoseBoxMeetsTheRegion) {
  const BakedModel model = test::bake_named(GetParam());
  Random random(75);
  for (int i = 0; i < 20; ++i) {
    RegionRequest request = request_for_all(model);
    if (request.attach.empty()) GTEST_SKIP() << "nothing to refine";
    for (int part = 0; part < 20; ++part) request.region.push_back(random_box(model, random));
    std::set<VertexId> split;
    for (const TreeletSplit& s : collect(model.store, request, nullptr).value().treelet)
      split.insert(s.split);
    for (const VertexId u : split)
      for (const NodeSpan& child :
           {model.store.node_of(u).left_of(u), model.store.node_of(u).right_of(u)}) {
        if (child.size < 2) continue;
        const GridBox box = model.store.box(child);
        const bool meets = std::any_of(request.region.begin(), request.region.end(),
                                       [&](const RegionPart& part) { return part.meets(box); });
        EXPECT_EQ(split.contains(model.store.split_of(child)), meets);
      }
  }
}

// Brute force over all faces, whether or not they have a vertex in the region.
TEST_P(Collect, EveryFaceWhoseBoxMeetsTheRegionBecomesExact) {
  const BakedModel model = test::bake_named(GetParam());
  const std::vector<test::KeyedFace> all = test::all_faces(model.store);
  for (std::uint64_t seed = 0; seed < 20; ++seed) {
    SCOPED_TRACE(seed);
    Random random(seed);
    RegionRequest request = request_for_all(model);
    if (request.attach.empty()) GTEST_SKIP() << "nothing to refine";
    for (std::uint32_t n = 1 + random.below(4); n > 0; --n)
      request.region.push_back(random_box(model, random));
    const Result<Demand> demand = collect(model.store, request, nullptr);
    ASSERT_TRUE(demand.is_ok());
    ASSERT_FALSE(demand.value().truncated);
    ActiveMesh mesh(model.store);
    RefineDelta delta;
    for (const TreeletSplit& split : demand.value().treelet)
      ASSERT_TRUE(mesh.split(split.split, delta));
    EXPECT_EQ(delta.split.size(), demand.value().treelet.size());  // nothing but what was listed
    for (const test::KeyedFace& keyed : all) {
      GridBox box;
      for (const VertexId corner : keyed.face.corners()) box.add(model.store.position(corner));
      if (std::any_of(request.region.begin(), request.region.end(),
                      [&](const RegionPart& part) { return part.meets(box); })) {
        EXPECT_TRUE(mesh.is_exact(keyed.face));
      }
    }
  }
}

TEST_P(Collect, SplitsOnlyNodesWhoseBoxMeetsTheRegion) {
  const BakedModel model = test::bake_named(GetParam());
  Random random(71);
  RegionRequest request = request_for_all(model);
  request.region = {random_box(model, random)};
  const Result<Demand> demand = collect(model.store, request, nullptr);
  for (const TreeletSplit& split : demand.value().treelet)
    EXPECT_TRUE(request.region[0].meets(model.store.box(split.node)));
}

TEST_P(Collect, TruncatedTreeletKeepsParents) {
  const BakedModel model = test::bake_named(GetParam());
  const auto everything = GridBox{{0, 0, 0}, {0x7fffffff, 0x7fffffff, 0x7fffffff}};
  for (std::uint32_t limit = 1; limit < std::min(60U, model.header.split_count()); ++limit) {
    RegionRequest request = request_for_all(model);
    request.region = {everything};
    request.max_splits = limit;
    const Result<Demand> demand = collect(model.store, request, nullptr);
    ASSERT_EQ(demand.value().treelet.size(), limit);
    EXPECT_TRUE(demand.value().truncated);
    ActiveMesh mesh(model.store);
    RefineDelta delta;
    for (const TreeletSplit& split : demand.value().treelet) {
      EXPECT_TRUE(mesh.is_current(split.node));
      ASSERT_TRUE(mesh.split(split.split, delta));
    }
  }
}

TEST_P(Collect, TruncationTakesTheLargestNodes) {
  const BakedModel model = test::bake_named(GetParam());
  if (model.header.split_count() < 10) GTEST_SKIP() << "too small";
  RegionRequest request = request_for_all(model);
  request.region = {GridBox{{0, 0, 0}, {0x7fffffff, 0x7fffffff, 0x7fffffff}}};
  request.max_splits = model.header.split_count() / 2;
  std::vector<VertexId> found;
  const Result<Demand> demand = collect(model.store, request, nullptr);
  for (const TreeletSplit& split : demand.value().treelet) found.push_back(split.split);
  std::vector<VertexId> expected = global_order(model.store, request.max_splits);
  std::sort(found.begin(), found.end());
  std::sort(expected.begin(), expected.end());
  EXPECT_EQ(found, expected);
}

TEST_P(Collect, PublisherAndPeerGetTheSameTreelet) {
  const BakedModel model = test::bake_named(GetParam());
  const auto path = test::write_model(model);
  Random random(72);
  for (int i = 0; i < 10; ++i) {
    Result<ModelFile> file = ModelFile::open(path->path());  // nothing decoded
    ASSERT_TRUE(file.is_ok());
    RegionRequest request = request_for_all(model);
    request.region = {random_box(model, random)};
    request.max_splits = 1 + random.below(500);
    const Result<Demand> peer = collect(model.store, request, nullptr);
    const Result<Demand> publisher = collect(
        file.value().store(), request, [&](NodeSpan node) { return file.value().require(node); });
    ASSERT_TRUE(publisher.is_ok()) << publisher.status().message();
    EXPECT_EQ(publisher.value().truncated, peer.value().truncated);
    EXPECT_TRUE(publisher.value().missing.empty());
    ASSERT_EQ(publisher.value().treelet.size(), peer.value().treelet.size());
    for (std::size_t j = 0; j < peer.value().treelet.size(); ++j) {
      const TreeletSplit &x = publisher.value().treelet[j], &y = peer.value().treelet[j];
      EXPECT_EQ(x.node, y.node);
      EXPECT_EQ(x.split, y.split);
      EXPECT_EQ(x.left_included, y.left_included);
      EXPECT_EQ(x.right_included, y.right_included);
    }
  }
}

// Three small spheres far apart and one face between them: the paper's coverage by vertex would
// miss it.
TEST(CollectCoverage, BringsALargeFaceThatHasNoVertexInTheRegion) {
  IndexedMesh mesh;
  const IndexedMesh sphere = generate_sphere(16, 0);
  const auto count = static_cast<std::uint32_t>(sphere.positions_m.size());
  for (const auto& [x, y] : {std::pair{-50., -50.}, {50., -50.}, {0., 50.}}) {
    const auto first = static_cast<std::uint32_t>(mesh.positions_m.size());
    for (const auto& p : sphere.positions_m) mesh.positions_m.push_back({p[0] + x, p[1] + y, p[2]});
    for (const auto& f : sphere.faces)
      mesh.faces.push_back({f[0] + first, f[1] + first, f[2] + first});
  }
  mesh.faces.push_back({50, count + 51, 2 * count + 52});
  const BakedModel model = test::bake_mesh(mesh, 4);  // a larger base holds the large face
  const auto all = test::all_faces(model.store);
  const auto box_of = [&](const SplitFace& face) {
    GridBox box;
    for (const VertexId corner : face.corners()) box.add(model.store.position(corner));
    return box;
  };
  const auto large = std::max_element(all.begin(), all.end(), [&](const auto& x, const auto& y) {
    const GridBox a = box_of(x.face), b = box_of(y.face);
    return a.hi[0] - a.lo[0] < b.hi[0] - b.lo[0];
  });
  RegionRequest request = request_for_all(model);
  GridBox middle;
  for (int k = 0; k < 3; ++k) {
    std::int64_t sum = 0;
    for (const VertexId corner : large->face.corners()) sum += model.store.position(corner)[k];
    middle.lo[k] = static_cast<std::int32_t>(sum / 3 - 10);
    middle.hi[k] = static_cast<std::int32_t>(sum / 3 + 10);
  }
  request.region = {middle};
  const Result<Demand> demand = collect(model.store, request, nullptr);
  ActiveMesh active(model.store);
  ASSERT_FALSE(active.is_exact(large->face));
  RefineDelta delta;
  for (const TreeletSplit& split : demand.value().treelet)
    ASSERT_TRUE(active.split(split.split, delta));
  EXPECT_TRUE(active.is_exact(large->face));
  EXPECT_LT(demand.value().treelet.size(), model.header.split_count() / 2);
}

TEST(CollectMissing, NamesNodesWhoseSplitThePeerLacks) {
  const BakedModel model = test::bake_named("aircraft");
  const SplitStore empty(model.header);
  Random random(73);
  RegionRequest request = request_for_all(model);
  request.region = {random_box(model, random)};
  const Result<Demand> demand = collect(empty, request, nullptr);
  EXPECT_TRUE(demand.value().treelet.empty());
  std::vector<NodeSpan> expected;
  for (const NodeSpan& node : request.attach)
    if (request.region[0].meets(empty.box(node))) expected.push_back(node);
  EXPECT_EQ(demand.value().missing, expected);
}

TEST(CollectAttach, BelowAGivenNodeOnly) {
  const BakedModel model = test::bake_named("terrain");
  const NodeSpan node = model.store.node_of(test::all_splits(model.store)[20]);
  RegionRequest request{.attach = {node},
                        .region = {GridBox{{0, 0, 0}, {0x7fffffff, 0x7fffffff, 0x7fffffff}}},
                        .max_splits = kMaxRequestSplits};
  const Result<Demand> demand = collect(model.store, request, nullptr);
  EXPECT_EQ(demand.value().treelet.size(), node.size - 1);
  for (const TreeletSplit& split : demand.value().treelet) EXPECT_TRUE(node.contains(split.split));
}

TEST(CollectAttach, OutsideTheRegionIsSplitOnlyWhereTheRuleSaysAlways) {
  const BakedModel model = test::bake_named("terrain");
  const NodeSpan node = model.store.node_of(test::all_splits(model.store).back());
  const std::int32_t beyond = model.store.grid_max() + 10;
  const RegionRequest request{
      .attach = {node}, .region = {GridBox{{beyond, beyond, beyond}, {beyond, beyond, beyond}}}};
  const Result<Demand> in_region = collect(model.store, request, nullptr, AttachRule::kInRegion);
  const Result<Demand> always = collect(model.store, request, nullptr, AttachRule::kAlways);
  EXPECT_TRUE(in_region.value().treelet.empty());
  ASSERT_EQ(always.value().treelet.size(), 1U);
  EXPECT_EQ(always.value().treelet[0].node, node);
}

class AttachNodesThatAreNone : public ::testing::TestWithParam<NodeSpan> {};
INSTANTIATE_TEST_SUITE_P(Spans, AttachNodesThatAreNone,
                         ::testing::Values(NodeSpan{{1}, 3}, NodeSpan{{3}, 50}, NodeSpan{{0}, 600},
                                           NodeSpan{{100}, 333}));

TEST_P(AttachNodesThatAreNone, AreRefusedByAPublisher) {
  const BakedModel model = test::bake_named("terrain");
  ASSERT_FALSE(model.store.is_node(GetParam())) << "choose another";
  const auto path = test::write_model(model);
  Result<ModelFile> file = ModelFile::open(path->path());
  const RegionRequest request{.attach = {GetParam()}, .region = {GridBox{{0, 0, 0}, {9, 9, 9}}}};
  const Result<Demand> demand = collect(file.value().store(), request,
                                        [&](NodeSpan node) { return file.value().require(node); });
  ASSERT_FALSE(demand.is_ok());
  EXPECT_EQ(demand.status().code(), StatusCode::kInvalidArgument);
  EXPECT_NE(demand.status().message().find(std::to_string(GetParam().begin())), std::string::npos);
}

TEST_P(AttachNodesThatAreNone, AreSkippedByAPeer) {
  const BakedModel model = test::bake_named("terrain");
  const RegionRequest request{.attach = {GetParam()}, .region = {GridBox{{0, 0, 0}, {9, 9, 9}}}};
  const Result<Demand> demand = collect(model.store, request, nullptr);
  ASSERT_TRUE(demand.is_ok());
  EXPECT_TRUE(demand.value().treelet.empty());
}

TEST(CollectErrors, PassesOnWhatRequireReports) {
  const BakedModel model = test::bake_named("terrain");
  const SplitStore empty(model.header);
  RegionRequest request = request_for_all(model);
  request.region = {GridBox{{0, 0, 0}, {0x7fffffff, 0x7fffffff, 0x7fffffff}}};
  const Result<Demand> demand = collect(empty, request, [](NodeSpan) {
    return Status{StatusCode::kIo, "gone"};
  });
  ASSERT_FALSE(demand.is_ok());
  EXPECT_EQ(demand.status().code(), StatusCode::kIo);
}

TEST_P(Collect, FrontierIsWhatIsKnownAndUnsplitAndMeetsTheRegion) {
  const BakedModel model = test::bake_named(GetParam());
  Random random(74);
  SplitStore peer(model.header);
  std::vector<NodeSpan> nodes;  // of the peer: roots, and children of what it knows
  for (const BaseRoot& root : model.header.roots) nodes.push_back(root.node);
  for (const VertexId u : test::all_splits(model.store)) {
    SplitRecord record{.node = model.store.node_of(u), .split = u};
    if (random.below(3) == 0 || !peer.is_node(record.node)) continue;
    for (int k = 0; k < 3; ++k)
      record.offset[static_cast<std::size_t>(k)] =
          model.store.position(u)[k] - model.store.position(record.node.first)[k];
    if (record.left().size > 1) record.left_box = model.store.box_code(record.left());
    if (record.right().size > 1) record.right_box = model.store.box_code(record.right());
    ASSERT_TRUE(peer.insert(record, model.store.faces(u).span()).is_ok());
    nodes.push_back(record.left());
    nodes.push_back(record.right());
  }
  for (int i = 0; i < 20; ++i) {
    const std::vector<RegionPart> region{random_box(model, random), random_box(model, random)};
    std::vector<NodeSpan> expected;
    for (const NodeSpan& node : nodes) {
      const bool meets = region[0].meets(peer.box(node)) || region[1].meets(peer.box(node));
      if (node.size > 1 && meets && !peer.split_of(node).is_valid()) expected.push_back(node);
    }
    std::sort(expected.begin(), expected.end(), [](const NodeSpan& x, const NodeSpan& y) {
      return x.size != y.size ? x.size > y.size : x.first < y.first;
    });
    EXPECT_EQ(unresolved_in(peer, region, expected.size() + 1), expected);
    expected.resize(expected.size() / 2);
    EXPECT_EQ(unresolved_in(peer, region, expected.size()), expected);
  }
}

// ---- parts of a region --------------------------------------------------------------------------

RegionPart random_part(Random& random) {
  const auto at = [&](std::int32_t range) {
    return static_cast<std::int32_t>(random.below(static_cast<std::uint32_t>(range)));
  };
  RegionPart part;
  for (int k = 0; k < 3; ++k) {
    part.box.lo[k] = at(400);
    part.box.hi[k] = part.box.lo[k] + at(200);
    part.normal[static_cast<std::size_t>(k)] = static_cast<std::int8_t>(at(85) - 42);
  }
  part.radius = random.below(2) == 0 ? 0 : at(100);
  part.slab_lo = at(300) - 150;
  part.slab_hi = part.slab_lo + at(50);
  return part;
}

bool holds(const RegionPart& part, const GridPoint& p) {
  std::int64_t square = 0, along = 0;
  for (int k = 0; k < 3; ++k) {
    const std::int64_t gap = std::max({0, part.box.lo[k] - p[k], p[k] - part.box.hi[k]});
    square += gap * gap;
    along += std::int64_t{part.normal[static_cast<std::size_t>(k)]} * p[k];
  }
  return square <= std::int64_t{part.radius} * part.radius && along >= 128 * part.slab_lo &&
         along <= 128 * part.slab_hi;
}

TEST(RegionPart, MeetsEveryBoxWithAPointOfIt) {
  Random random(76);
  int held = 0, apart = 0;
  for (int i = 0; i < 60000; ++i) {
    const RegionPart part = random_part(random);
    ASSERT_EQ(fault_of(part), nullptr);
    GridBox box;
    for (int n = 0; n < 2; ++n) {
      GridPoint p;
      for (int k = 0; k < 3; ++k) p[k] = static_cast<std::int32_t>(random.below(700)) - 50;
      box.add(p);
    }
    if (!part.meets(box)) ++apart;
    for (int n = 0; n < 20; ++n) {
      GridPoint p;
      for (int k = 0; k < 3; ++k)
        p[k] = box.lo[k] + static_cast<std::int32_t>(
                               random.below(static_cast<std::uint32_t>(box.hi[k] - box.lo[k] + 1)));
      if (!holds(part, p)) continue;
      ++held;
      ASSERT_TRUE(part.meets(box));
    }
  }
  EXPECT_GT(held, 1000);
  EXPECT_GT(apart, 1000);
}

TEST(RegionPart, ThatIsABoxMeetsWhatTheBoxMeets) {
  Random random(77);
  for (int i = 0; i < 1000; ++i) {
    const GridBox a = random_part(random).box, b = random_part(random).box;
    EXPECT_EQ(RegionPart(a).meets(b), a.meets(b));
  }
}

TEST(RegionPart, IsRoundAtItsCorners) {
  RegionPart part(GridBox{{0, 0, 0}, {10, 10, 10}});
  part.radius = 5;
  EXPECT_TRUE(part.meets({{13, 14, 0}, {20, 20, 10}}));
  EXPECT_FALSE(part.meets({{14, 14, 0}, {20, 20, 10}}));
  EXPECT_TRUE(part.meets({{15, 0, 0}, {20, 20, 10}}));
}

TEST(RegionPart, EndsAtItsSlab) {
  RegionPart part(GridBox{{0, 0, 0}, {1000, 1000, 1000}});
  part.normal = {64, 64, 0};  // (x + y) / 2, in [100, 200]
  part.slab_lo = 100;
  part.slab_hi = 200;
  EXPECT_TRUE(part.meets({{200, 200, 0}, {300, 300, 0}}));
  EXPECT_FALSE(part.meets({{201, 200, 0}, {300, 300, 0}}));
  EXPECT_TRUE(part.meets({{0, 0, 0}, {100, 100, 0}}));
  EXPECT_FALSE(part.meets({{0, 0, 0}, {100, 99, 0}}));
}

TEST(RegionPart, TakesTheGreatestNumbers) {
  constexpr std::int32_t kLeast = std::numeric_limits<std::int32_t>::min(),
                         kMost = std::numeric_limits<std::int32_t>::max();
  RegionPart part(GridBox{{kLeast, kLeast, kLeast}, {kLeast, kLeast, kMost}});
  part.radius = kMaxRegionRadius;
  part.normal = {0, 0, 127};
  part.slab_lo = kLeast;
  part.slab_hi = kMost;
  EXPECT_EQ(fault_of(part), nullptr);
  EXPECT_FALSE(part.meets({{0, 0, 0}, {kMost, kMost, kMost}}));
  part.box.hi = {kMost, kMost, kMost};
  EXPECT_TRUE(part.meets({{0, 0, 0}, {kMost, kMost, kMost}}));
}

TEST(RegionPart, AsksForNodesAboveItsLeastExtent) {
  RegionPart part(GridBox{{0, 0, 0}, {10, 10, 10}});
  part.min_extent = 12;
  EXPECT_FALSE(part.asks_for({{2, 2, 2}, {6, 6, 6}}));
  EXPECT_TRUE(part.asks_for({{2, 2, 2}, {7, 6, 6}}));
  EXPECT_FALSE(part.asks_for({{11, 11, 11}, {27, 26, 26}}));
}

// A part that is itself not known better than so asks for no finer detail, but where a node is
// named.
TEST(CollectRegion, StopsAtTheLeastExtent) {
  const BakedModel model = test::bake_named("terrain");
  RegionRequest request = request_for_all(model);
  request.region = {
      GridBox{{0, 0, 0}, {model.store.grid_max(), model.store.grid_max(), model.store.grid_max()}}};
  const Demand all = collect(model.store, request, nullptr).value();
  std::size_t finer = all.treelet.size() + 1;
  for (const std::int32_t extent : {1 << 16, 1 << 18, 1 << 20}) {
    request.region[0].min_extent = extent;
    const Demand some = collect(model.store, request, nullptr).value();
    EXPECT_LT(some.treelet.size(), finer);
    finer = some.treelet.size();
    for (const TreeletSplit& split : some.treelet)
      EXPECT_GT(model.store.box(split.node).extent(), extent);
    std::size_t expected = 0;  // boxes need not nest: what hangs below a small node stays away too
    for (const TreeletSplit& split : all.treelet)
      expected += model.store.box(split.node).extent() > extent ? 1 : 0;
    EXPECT_LE(some.treelet.size(), expected);
    EXPECT_GT(some.treelet.size(), expected / 2);
    const std::vector<NodeSpan> missing =
        unresolved_in(SplitStore(model.header), request.region, 10000);
    for (const NodeSpan& node : missing) EXPECT_GT(model.store.box(node).extent(), extent);
  }
  request.region[0].min_extent = std::numeric_limits<std::int32_t>::max();
  EXPECT_EQ(collect(model.store, request, nullptr, AttachRule::kAlways).value().treelet.size(),
            request.attach.size());
}

// ---- requests from outside ----------------------------------------------------------------------

class CheckRequest : public ::testing::Test {
 protected:
  void SetUp() override {
    request_ = request_for_all(model_);
    request_.region = {GridBox{{0, 0, 0}, {10, 10, 10}}};
  }
  void expect_refused(const char* what) {
    const Status status = check_request(model_.store, request_);
    EXPECT_EQ(status.code(), StatusCode::kInvalidArgument);
    EXPECT_NE(status.message().find(what), std::string::npos) << status.message();
  }
  BakedModel model_ = test::bake_named("terrain");
  RegionRequest request_;
};

TEST_F(CheckRequest, AcceptsAGoodOne) {
  EXPECT_TRUE(check_request(model_.store, request_).is_ok());
}

TEST_F(CheckRequest, AcceptsTheGreatestCounts) {
  request_.attach.clear();
  for (std::uint32_t i = 0; i < kMaxAttachNodes; ++i)
    if (2 * i + 2 <= model_.header.vertex_count) request_.attach.push_back({{2 * i}, 2});
  request_.region.resize(kMaxRegionBoxes, request_.region[0]);
  request_.max_splits = kMaxRequestSplits;
  EXPECT_TRUE(check_request(model_.store, request_).is_ok());
}

TEST_F(CheckRequest, RefusesNoAttachNode) {
  request_.attach.clear();
  expect_refused("attach");
}

TEST_F(CheckRequest, RefusesTooManyAttachNodes) {
  request_.attach.clear();
  for (std::uint32_t i = 0; i <= kMaxAttachNodes; ++i) request_.attach.push_back({{i}, 2});
  expect_refused("512");
}

TEST_F(CheckRequest, RefusesNoRegion) {
  request_.region.clear();
  expect_refused("region box");
}

TEST_F(CheckRequest, RefusesTooManyBoxes) {
  request_.region.resize(kMaxRegionBoxes + 1, request_.region[0]);
  expect_refused("256");
}

TEST_F(CheckRequest, RefusesAnEmptyBox) {
  request_.region.emplace_back(GridBox{});
  expect_refused("empty");
}

TEST_F(CheckRequest, RefusesABoxEmptyAlongOneAxis) {
  request_.region.push_back(GridBox{{0, 5, 0}, {10, 4, 10}});
  expect_refused("empty");
}

TEST_F(CheckRequest, RefusesARadiusBelowZero) {
  request_.region[0].radius = -1;
  expect_refused("radius");
}

TEST_F(CheckRequest, RefusesARadiusWhoseSquareOverflows) {
  request_.region[0].radius = kMaxRegionRadius + 1;
  expect_refused("radius");
}

TEST_F(CheckRequest, RefusesASteepNormal) {
  request_.region[0].normal = {-128, 0, 0};
  expect_refused("normal");
}

TEST_F(CheckRequest, RefusesAnEmptySlab) {
  request_.region[0].normal = {1, 0, 0};
  request_.region[0].slab_lo = 1;
  expect_refused("slab");
}

TEST_F(CheckRequest, RefusesZeroSplits) {
  request_.max_splits = 0;
  expect_refused("max_splits");
}

TEST_F(CheckRequest, RefusesTooManySplits) {
  request_.max_splits = kMaxRequestSplits + 1;
  expect_refused("16384");
}

TEST_F(CheckRequest, RefusesALeaf) {
  request_.attach = {{{0}, 1}};
  expect_refused("leaf");
}

TEST_F(CheckRequest, RefusesANodeBeyondTheModel) {
  request_.attach = {{{model_.header.vertex_count - 1}, 2}};
  expect_refused("outside");
}

TEST_F(CheckRequest, RefusesANodeWhoseEndWraps) {
  request_.attach = {{{16}, 0xfffffff8U}};
  expect_refused("outside");
}

TEST_F(CheckRequest, RefusesNodesThatOverlap) {
  request_.attach = {{{0}, 4}, {{2}, 4}};
  expect_refused("overlap");
}

TEST_F(CheckRequest, RefusesNodesThatDescend) {
  request_.attach = {{{8}, 4}, {{0}, 4}};
  expect_refused("ascend");
}

}  // namespace
}  // namespace nearmesh
