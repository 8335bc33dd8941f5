// SPDX-License-Identifier: Apache-2.0
#include "core/world/near_tiles.hpp"

#include <deque>
#include <limits>
#include <map>
#include <set>

#include "brute_force.hpp"
#include "core/world/pages.hpp"

namespace nearmesh {
namespace {

constexpr CommonLattice kGround{.origin_m = {40, -8, 0.5}, .exponent = -7};
constexpr int kSide = 8, kCells = 3;

/// Terrain in 64 tiles of 18 faces, in memory.
struct TiledGround {
  TiledGround() {
    IndexedMesh mesh = generate_terrain(kSide * kCells, 5);
    for (auto& p : mesh.positions_m) {
      for (double& x : p) x = x * 0.01 + 7.7;
      p[2] *= 0.3;
    }
    posts = mesh.positions_m;
    std::vector<PlacedTile> placed;
    for (int j = 0; j < kSide; ++j)
      for (int i = 0; i < kSide; ++i) placed.push_back(add_tile(mesh, i, j));
    Result<WorldPages> made = make_pages(kGround, 21, placed);
    EXPECT_TRUE(made.is_ok()) << made.status().message();
    pages = std::move(made).value();
    for (const auto& [content, bytes] : pages.pages)
      by_content[content] = decode_page(bytes).value();
  }

  PlacedTile add_tile(const IndexedMesh& mesh, int i, int j) {
    IndexedMesh part{mesh.positions_m, {}};
    for (std::size_t f = 0; f < mesh.faces.size(); ++f) {
      const auto cell = static_cast<int>(f / 2);
      if (cell % (kSide * kCells) / kCells == i && cell / (kSide * kCells) / kCells == j)
        part.faces.push_back(mesh.faces[f]);
    }
    EXPECT_EQ(part.faces.size(), 2U * kCells * kCells);
    CleanResult clean = clean_mesh(part, {.lattice = kGround}).value();
    const std::array<std::int64_t, 3> place = clean.mesh.grid.lattice_cells;
    clean.mesh.grid = {.exponent = kGround.exponent};
    PlacedTile tile{.place = place, .faces = clean.mesh.faces.size()};
    for (const GridPoint& p : clean.mesh.positions)
      for (std::size_t k = 0; k < 3; ++k)
        tile.extent[k] = std::max<std::int64_t>(tile.extent[k], p.v[k]);
    BakedModel model = bake(clean.mesh, 0, {.base_faces = 4}).value();
    tile.content = {tiles.size() + 1, 7};  // any name will do
    tiles.emplace(tile.content, std::move(model));
    return tile;
  }

  [[nodiscard]] const WorldPage& root() const { return by_content.at(pages.world.root); }
  /// All tiles below a page.
  void collect(const WorldPage& page, std::vector<WorldEntry>& out) const {
    for (const WorldEntry& entry : page.entries)
      if (page.level == 0) {
        out.push_back(entry);
      } else {
        collect(by_content.at(entry.content), out);
      }
  }

  /// The least of how far the boxes in a page are apart from a body, and of those below which it
  /// may meet.
  [[nodiscard]] double apart_m(const WorldPage& page, const RelativeFrame& body_in_world,
                               const GridBox& body) const {
    double least_m = std::numeric_limits<double>::infinity();
    for (const WorldEntry& entry : page.entries) {
      const double gap_m =
          boxes_gap_m(body_in_world, centered(as_grid_box(entry.box())), centered(body));
      if (gap_m > 0) {
        least_m = std::min(least_m, gap_m);
      } else if (page.level > 0) {
        least_m = std::min(least_m, apart_m(by_content.at(entry.content), body_in_world, body));
      }
    }
    return least_m;
  }

  std::vector<std::array<double, 3>> posts;
  std::map<ContentHash, BakedModel> tiles;
  WorldPages pages;
  std::map<ContentHash, WorldPage> by_content;
};

struct Scene {
  Pose world, body;
};
/// The body near one of the posts.
Scene random_scene(const TiledGround& ground, Random& random, int kind) {
  Scene scene;
  if (kind > 0) scene.world.rotation = test::random_rotation(random);
  const double far_m = kind == 2 ? 6.4e6 : 100;
  for (double& t : scene.world.translation_m) t = random.between(-far_m, far_m);
  scene.body = {test::random_rotation(random), scene.world.translation_m};
  std::array<double, 3> at =
      ground.posts[random.below(static_cast<std::uint32_t>(ground.posts.size()))];
  for (double& x : at) x += random.between(-0.5, 0.5);
  for (std::size_t k = 0; k < 3; ++k)
    for (std::size_t i = 0; i < 3; ++i)
      scene.body.translation_m[k] += scene.world.rotation[3 * k + i] * at[i];
  return scene;
}

bool touches(const TiledGround& world, const WorldEntry& entry, const Scene& scene,
             const BakedModel& body) {
  const BakedModel& tile = world.tiles.at(entry.content);
  const PosedPair posed = pose_pair(world.pages.world.grid_at(entry), scene.world, "tile",
                                    body.header.grid, scene.body, "body")
                              .value();
  return !test::touching_pairs(tile.store, posed.a, test::all_faces(tile.store), body.store,
                               posed.b, test::all_faces(body.store))
              .empty();
}

TEST(FindNearTiles, WhatIsNeitherListedNorBelowAMissingPageDoesNotTouch) {
  const TiledGround world;
  ASSERT_EQ(world.root().level, 1);
  IndexedMesh ball = generate_sphere(8, 0);
  for (auto& p : ball.positions_m)
    for (double& x : p) x *= 0.4;
  const BakedModel body = test::bake_mesh(ball, 16);
  GridBox box;
  for (std::uint32_t v = 0; v < body.header.vertex_count; ++v) box.add(body.store.position({v}));
  std::vector<WorldEntry> all;
  world.collect(world.root(), all);
  ASSERT_EQ(all.size(), 64U);
  Random random(3);
  std::size_t touching = 0, listed = 0, missing = 0, whole = 0;
  for (int round = 0; round < 150; ++round) {
    const Scene scene = random_scene(world, random, round % 3);
    const PosedPair posed = pose_pair(world_grid(world.pages.world), scene.world, "world",
                                      body.header.grid, scene.body, "body")
                                .value();
    const bool loses = round % 5 == 0;
    const PageOf page_of = [&](const WorldEntry& entry, int level) -> Result<const WorldPage*> {
      if (loses && random.below(2) == 0) return nullptr;
      const WorldPage& page = world.by_content.at(entry.content);
      EXPECT_TRUE(check_page(page, entry, level).is_ok());
      return &page;
    };
    const RelativeFrame body_in_world = make_relative_frame(posed.a, posed.b);
    const auto near = find_near_tiles(world.pages.world, world.root(), page_of, body_in_world, box);
    ASSERT_TRUE(near.is_ok()) << near.status().message();
    if (near.value().missing.empty()) {
      EXPECT_DOUBLE_EQ(near.value().apart_m, world.apart_m(world.root(), body_in_world, box));
      ++whole;
    }
    std::set<WorldEntry> known(near.value().tiles.begin(), near.value().tiles.end());
    listed += known.size();
    for (const MissingPage& page : near.value().missing) {
      std::vector<WorldEntry> below;
      world.collect(world.by_content.at(page.entry.content), below);
      known.insert(below.begin(), below.end());
      ++missing;
    }
    for (const WorldEntry& entry : all) {
      const bool does = touches(world, entry, scene, body);
      touching += does ? 1 : 0;
      if (!known.contains(entry)) {
        ASSERT_FALSE(does) << "round " << round;
      }
    }
  }
  EXPECT_GT(touching, 150U);
  EXPECT_LT(listed, 150U * 12) << "most tiles are far from a ball";
  EXPECT_GT(missing, 10U);
  EXPECT_GT(whole, 100U);
}

// Of a pose from the bus that makes the body smaller, as far as one may: what is told of the rest
// is told of the smaller body.
TEST(FindTilesAround, TheRestIsSoFarInAPoseThatShrinks) {
  constexpr double kShrink = 1 - 4.99e-6, kFar_m = 4096;
  const WorldRecord world{
      .lattice = {.exponent = -14}, .bits = 21, .tiles = 1, .faces = 1, .root = {1, 1}};
  // A tile that is a point.
  const WorldPage root{.level = 0, .entries = {{.place = {1 << 26, 0, 0}, .content = {2, 2}}}};
  const Grid grid{.exponent = -20};
  const GridBox body{{{0, 0, 0}}, {{(1 << 21) - 1, 0, 0}}};
  const Pose pose{.rotation = {kShrink, 0, 0, 0, kShrink, 0, 0, 0, kShrink}};
  const Result<PosedPair> posed = pose_pair(world_grid(world), {}, "world", grid, pose, "body");
  ASSERT_TRUE(posed.is_ok()) << posed.status().message();
  const PageOf no_page = [](const WorldEntry&, int) -> Result<const WorldPage*> { return nullptr; };
  const auto around =
      find_tiles_around(world, root, no_page, make_relative_frame(posed.value().a, posed.value().b),
                        body, std::numeric_limits<std::int32_t>::max());
  ASSERT_TRUE(around.is_ok()) << around.status().message();
  EXPECT_TRUE(around.value().near.tiles.empty());
  const double apart_m = kFar_m - kShrink * std::ldexp((1 << 21) - 1, -20);
  EXPECT_LE(around.value().rest_m, apart_m);
  EXPECT_GT(around.value().rest_m, apart_m - 0.1);
}

// Whoever asks tiles side by side would ask one twice at once, and count its faces twice.
TEST(FindNearTiles, ATileThatStandsTwiceInOnePlaceIsRefused) {
  const WorldRecord world{.tiles = 4, .faces = 4, .root_level = 1};
  const WorldEntry tile{.place = {2, 2, 2}, .extent = {9, 9, 9}, .content = {7, 7}},
      elsewhere{.place = {3, 2, 2}, .extent = {9, 9, 9}, .content = {7, 7}},
      another{.place = {2, 2, 2}, .extent = {9, 9, 9}, .content = {8, 8}};
  WorldEntry wider = tile;
  wider.extent[2] = 12;
  const PosedPair posed =
      pose_pair(world_grid(world), {}, "world", {.exponent = 0}, {}, "body").value();
  const auto search = [&](const std::vector<WorldEntry>& left,
                          const std::vector<WorldEntry>& right) {
    const std::array<WorldPage, 2> pages{
        {{.level = 0, .entries = left}, {.level = 0, .entries = right}}};
    WorldPage root{.level = 1};
    for (std::uint64_t i = 1; i <= 2; ++i)
      root.entries.push_back({.extent = {40, 40, 40}, .content = {i, i}});
    const PageOf page_of = [&](const WorldEntry& entry, int) -> Result<const WorldPage*> {
      return &pages.at(entry.content.low - 1);
    };
    return find_near_tiles(world, root, page_of, make_relative_frame(posed.a, posed.b),
                           {{{0, 0, 0}}, {{50, 50, 50}}});
  };
  const auto fine = search({tile, another}, {elsewhere});
  ASSERT_TRUE(fine.is_ok()) << fine.status().message();
  EXPECT_EQ(fine.value().tiles, (std::vector{tile, another, elsewhere}));
  for (const auto& twice : {search({tile}, {tile, elsewhere}), search({tile, another, wider}, {}),
                            search({tile, another}, {wider})}) {
    EXPECT_EQ(twice.status().code(), StatusCode::kCorrupt);
    EXPECT_NE(twice.status().message().find(to_hex(tile.content)), std::string::npos)
        << twice.status().message();
  }
}

TEST(FindNearTiles, AWorldThatListsItselfEnds) {
  WorldPage page{.level = 0};
  for (std::int32_t i = 0; i < 36; ++i)
    page.entries.push_back({.place = {i, 0, 0}, .extent = {40, 40, 40}, .content = {1, 1}});
  WorldPage above = page;
  above.level = 7;
  const WorldRecord world{.tiles = 3, .faces = 3};
  const PosedPair posed =
      pose_pair(world_grid(world), {}, "world", {.exponent = 0}, {}, "body").value();
  std::deque<WorldPage> pages;
  const PageOf page_of = [&](const WorldEntry&, int level) -> Result<const WorldPage*> {
    pages.push_back(page);
    pages.back().level = static_cast<std::uint8_t>(level);
    return &pages.back();
  };
  const auto near = find_near_tiles(world, above, page_of, make_relative_frame(posed.a, posed.b),
                                    {{{0, 0, 0}}, {{50, 50, 50}}});
  EXPECT_EQ(near.status().code(), StatusCode::kCorrupt);
}

}  // namespace
}  // namespace nearmesh
