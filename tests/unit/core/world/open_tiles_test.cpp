// SPDX-License-Identifier: Apache-2.0
#include "core/world/open_tiles.hpp"

#include <array>
#include <map>
#include <set>
#include <utility>

#include "cut_world.hpp"

namespace nearmesh {
namespace {

/// Names of all tiles that lie there; some places may have the same.
std::vector<ContentHash> tiles_of(const WorldFolder& folder, const WorldPage& page) {
  std::set<ContentHash> tiles;
  for (const WorldEntry& entry : page.entries) {
    if (page.level == 0) {
      tiles.insert(entry.content);
    } else {
      for (const ContentHash& below : tiles_of(folder, folder.page(entry, page.level - 1).value()))
        tiles.insert(below);
    }
  }
  return {tiles.begin(), tiles.end()};
}

TEST(OpenTiles, StayOpenAsLongAsAllHaveRoom) {
  const test::CutTerrain terrain;
  const WorldFolder folder = WorldFolder::open(terrain.folder).value();
  const std::vector<ContentHash> all = tiles_of(folder, folder.root().value());
  ASSERT_GT(all.size(), 32U);

  OpenTiles tiles(folder);
  std::vector<std::shared_ptr<ModelFile>> first;
  for (const ContentHash& tile : all) first.push_back(tiles.open(tile).value());
  EXPECT_EQ(tiles.count(), all.size());
  for (std::size_t i = 0; i < all.size(); ++i)
    EXPECT_EQ(tiles.open(all[i]).value(), first[i]) << "tile " << i;
}

TEST(OpenTiles, ShareTheirCodingTables) {
  const test::CutTerrain terrain;
  const WorldFolder folder = WorldFolder::open(terrain.folder).value();
  OpenTiles tiles(folder);
  std::vector<std::shared_ptr<ModelFile>> open;
  std::map<std::pair<CodingSet, std::array<std::uint8_t, 3>>, std::set<const void*>> tables;
  for (const ContentHash& content : tiles_of(folder, folder.root().value())) {
    open.push_back(tiles.open(content).value());
    const SpmHeader& header = open.back()->header();
    ASSERT_NE(header.tables.set().number, 0U);
    tables[{header.tables.set(), header.lattice_shift}].insert(header.tables.fast());
  }
  EXPECT_LT(tables.size(), open.size());
  for (const auto& [set, places] : tables) EXPECT_EQ(places.size(), 1U);
}

TEST(OpenTiles, ThoseNotUsedForLongestAreClosedWhereThereAreTooMany) {
  const test::CutTerrain terrain;
  const WorldFolder folder = WorldFolder::open(terrain.folder).value();
  const std::vector<ContentHash> all = tiles_of(folder, folder.root().value());

  OpenTiles tiles(folder, 3);
  const auto kept = tiles.open(all[0]).value();
  for (std::size_t i = 1; i < all.size(); ++i) {
    const auto tile = tiles.open(all[i]).value();
    EXPECT_EQ(tiles.open(all[0]).value(), kept) << "used between any two others";
    EXPECT_EQ(tiles.open(all[i]).value(), tile);
    EXPECT_LE(tiles.count(), 3U);
  }
}

TEST(OpenTiles, OneThatSomebodyHoldsIsNotOpenedTwice) {
  const test::CutTerrain terrain;
  const WorldFolder folder = WorldFolder::open(terrain.folder).value();
  const std::vector<ContentHash> all = tiles_of(folder, folder.root().value());

  OpenTiles tiles(folder, 1);
  const std::shared_ptr<ModelFile> held = tiles.open(all[0]).value();
  std::weak_ptr<ModelFile> let_go = tiles.open(all[1]).value();
  EXPECT_EQ(tiles.count(), 1U);
  EXPECT_EQ(tiles.held(), std::vector{all[0]});
  EXPECT_EQ(tiles.open(all[0]).value(), held);
  EXPECT_TRUE(tiles.held().empty()) << "one is used again, and nobody holds the other";
  EXPECT_TRUE(let_go.expired());
  EXPECT_NE(tiles.open(all[1]).value(), nullptr);
}

TEST(OpenTiles, ThoseNotUsedForLongestAreClosedWhereAllHoldTooMuch) {
  const test::CutTerrain terrain;
  const WorldFolder folder = WorldFolder::open(terrain.folder).value();
  const std::vector<ContentHash> all = tiles_of(folder, folder.root().value());
  const std::uint64_t splits = open_tile(folder, all[0]).value().header().split_count();

  OpenTiles tiles(folder, OpenTiles::kMostTiles, 4 * splits);
  for (const ContentHash& content : all) {
    const auto tile = tiles.open(content).value();
    EXPECT_EQ(tile->store().known_splits(), 0U);
    ASSERT_TRUE(tile->require_all().is_ok());
  }
  const auto last = tiles.open(all.back()).value();
  EXPECT_LE(tiles.count(), 8U);
  EXPECT_GE(tiles.count(), 2U);
  EXPECT_GT(last->store().known_splits(), 0U) << "it was open all the time";

  OpenTiles none(folder, OpenTiles::kMostTiles, 0);
  const auto only = none.open(all[0]).value();
  ASSERT_TRUE(only->require_all().is_ok());
  EXPECT_EQ(none.open(all[0]).value(), only) << "one is open in any case";
}

}  // namespace
}  // namespace nearmesh
