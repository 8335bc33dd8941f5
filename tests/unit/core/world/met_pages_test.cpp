// SPDX-License-Identifier: Apache-2.0
// Walks through pages end after as many steps as there are pages, whatever these list.
#include <filesystem>
#include <map>

#include "core/world/held_probe.hpp"
#include "core/world/near_tiles.hpp"
#include "core/world/world_folder.hpp"
#include "hostile_world.hpp"
#include "nearmesh/core/world/world_probe.hpp"
#include "test_models.hpp"

namespace nearmesh {
namespace {

/// Without a bound of its own a walk takes 36^3 pages, which is soon enough for a test that fails.
constexpr int kRepeatedLevels = 4;

/// In memory, counting which pages were asked for.
struct RepeatedWorld {
  RepeatedWorld() {
    for (const auto& [content, bytes] : world.pages)
      by_content[content] = decode_page(bytes).value();
  }
  [[nodiscard]] PageOf page_of() {
    return [this](const WorldEntry& entry, int level) -> Result<const WorldPage*> {
      ++asked;
      const WorldPage& page = by_content.at(entry.content);
      EXPECT_TRUE(check_page(page, entry, level).is_ok());
      return &page;
    };
  }
  [[nodiscard]] const WorldPage& root() const { return by_content.at(world.world.root); }

  WorldPages world = test::world_that_repeats_its_pages(kRepeatedLevels);
  std::map<ContentHash, WorldPage> by_content;
  int asked = 0;
};

void expect_repeated(const Status& status, const WorldPages& world) {
  EXPECT_EQ(status.code(), StatusCode::kCorrupt) << status.message();
  // What stands twice first is the tile's page, which the walk leaves once.
  for (const ContentHash& named : {world.name, world.pages.back().first})
    EXPECT_NE(status.message().find(to_hex(named)), std::string::npos) << status.message();
}

TEST(MetPages, TakesEachPageOnceAndNoMoreThanTheTilesNeed) {
  const WorldRecord world{.tiles = 2, .faces = 2};
  MetPages met(world);
  for (std::uint64_t i = 1; i <= 2 + kMaxPageLevel; ++i) EXPECT_TRUE(met.meet({i, 1}).is_ok()) << i;
  EXPECT_EQ(met.meet({3, 1}).code(), StatusCode::kCorrupt);
  EXPECT_EQ(met.meet({99, 1}).code(), StatusCode::kCorrupt);
  MetPages another(world);
  EXPECT_TRUE(another.meet({3, 1}).is_ok());
}

TEST(MetPages, EndTheSearchForTilesNearABody) {
  RepeatedWorld repeated;
  const WorldRecord& world = repeated.world.world;
  const PosedPair posed =
      pose_pair(world_grid(world), {}, "world", {.exponent = 0}, {}, "body").value();
  const auto near =
      find_near_tiles(world, repeated.root(), repeated.page_of(),
                      make_relative_frame(posed.a, posed.b), {{{0, 0, 0}}, {{50, 50, 50}}});
  expect_repeated(near.status(), repeated.world);
  EXPECT_LE(repeated.asked, kRepeatedLevels);
}

/// Along the edge that all boxes share.
constexpr RayProbe kRepeatedRay{.origin_m = {-5, 0, 0}, .direction = {1, 0, 0}};
constexpr BallProbe kRepeatedBall{.center_m = {0, 0, 0}, .radius_m = 2};

TEST(MetPages, EndProbesOfAWorldThatIsHeld) {
  RepeatedWorld repeated;
  const WorldPage& root = repeated.root();
  const HeldWorld held{repeated.world.world, root, repeated.page_of(),
                       [](const WorldEntry&) { return std::optional<TreeView>(); }};
  WorldRayAnswer on_ray;
  expect_repeated(probe(held, {}, std::span(&kRepeatedRay, 1), std::span(&on_ray, 1)).status(),
                  repeated.world);
  WorldShapeAnswer in_ball;
  expect_repeated(probe(held, {}, std::span(&kRepeatedBall, 1), std::span(&in_ball, 1)).status(),
                  repeated.world);
  EXPECT_LE(repeated.asked, 2 * kRepeatedLevels);
}

TEST(MetPages, EndProbesOfAWorldOnDisk) {
  const WorldPages world = test::world_that_repeats_its_pages(kRepeatedLevels);
  const std::string folder =
      ::testing::TempDir() + "nearmesh_repeated_" + std::to_string(::getpid());
  ASSERT_TRUE(write_world(world, folder).is_ok());
  Result<WorldProbe> opened = WorldProbe::open(folder);
  ASSERT_TRUE(opened.is_ok()) << opened.status().message();
  WorldRayAnswer on_ray;
  expect_repeated(opened.value().probe({}, std::span(&kRepeatedRay, 1), std::span(&on_ray, 1)),
                  world);
  WorldShapeAnswer in_ball;
  expect_repeated(opened.value().probe({}, std::span(&kRepeatedBall, 1), std::span(&in_ball, 1)),
                  world);
  std::filesystem::remove_all(folder);
}

}  // namespace
}  // namespace nearmesh
