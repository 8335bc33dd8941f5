// SPDX-License-Identifier: Apache-2.0
#include "core/world/pages.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <map>
#include <set>

#include "core/base/digest.hpp"
#include "core/base/random.hpp"

namespace nearmesh {
namespace {

constexpr CommonLattice kLattice{.origin_m = {-1000, 512, 0.25}, .exponent = -7};

ContentHash some_content(Random& random) { return {random.next(), random.next() | 1}; }

/// A square of tiles that border on each other, of different heights.
std::vector<PlacedTile> square(std::int64_t side, std::uint64_t seed) {
  Random random(seed);
  std::vector<PlacedTile> tiles;
  for (std::int64_t x = 0; x < side; ++x)
    for (std::int64_t y = 0; y < side; ++y)
      tiles.push_back({some_content(random),
                       {(x - side / 2) << 20, (y - side / 2) << 20, random.below(1000)},
                       {1 << 20, 1 << 20, 100 + random.below(50'000)},
                       1'000'000 + random.below(1000)});
  return tiles;
}

WorldPages pages_of(const std::vector<PlacedTile>& tiles) {
  Result<WorldPages> pages = make_pages(kLattice, 21, tiles);
  EXPECT_TRUE(pages.is_ok()) << pages.status().message();
  return std::move(pages).value();
}

std::map<ContentHash, WorldPage> decoded(const WorldPages& pages) {
  std::map<ContentHash, WorldPage> out;
  for (const auto& [content, bytes] : pages.pages) {
    EXPECT_EQ(digest_of(bytes), content);
    const Result<WorldPage> page = decode_page(bytes);
    EXPECT_TRUE(page.is_ok()) << page.status().message();
    EXPECT_EQ(encode_page(page.value()), bytes);
    out[content] = page.value();
  }
  return out;
}

void collect_tiles(const std::map<ContentHash, WorldPage>& pages, const WorldPage& page,
                   std::vector<WorldEntry>& tiles) {
  for (const WorldEntry& entry : page.entries) {
    if (page.level == 0) {
      tiles.push_back(entry);
      continue;
    }
    const WorldPage& below = pages.at(entry.content);
    EXPECT_TRUE(check_page(below, entry, page.level - 1).is_ok());
    collect_tiles(pages, below, tiles);
  }
}

TEST(MakePages, ListsEachTileOnceInABoxThatHoldsIt) {
  for (const std::int64_t side : {1, 2, 6, 7, 40}) {
    const std::vector<PlacedTile> tiles = square(side, 3);
    const WorldPages world = pages_of(tiles);
    const auto pages = decoded(world);
    EXPECT_EQ(world.world.tiles, tiles.size());
    EXPECT_EQ(world.pages.front().first, world.world.root);
    std::vector<WorldEntry> found;
    collect_tiles(pages, pages.at(world.world.root), found);
    ASSERT_EQ(found.size(), tiles.size());
    std::map<ContentHash, PlacedTile> by_content;
    for (const PlacedTile& tile : tiles) by_content[tile.content] = tile;
    for (const WorldEntry& entry : found) {
      const PlacedTile& tile = by_content.at(entry.content);
      CellBox box;
      for (std::size_t k = 0; k < 3; ++k) {
        EXPECT_EQ(entry.place[k], tile.place[k]);
        box.lo[k] = tile.place[k];
        box.hi[k] = tile.place[k] + tile.extent[k];
      }
      EXPECT_TRUE(entry.box().contains(box));
      EXPECT_EQ(entry.log2_faces, 19);
      const Grid grid = world.world.grid_at(entry);
      EXPECT_EQ(grid.lattice_origin_m(), kLattice.origin_m);
    }
  }
}

TEST(MakePages, OfTenThousandTilesTakeADatagramEach) {
  const WorldPages world = pages_of(square(100, 5));
  std::size_t bytes = 0;
  for (const auto& page : world.pages) {
    EXPECT_LE(page.second.size(), 1180U);
    bytes += page.second.size();
  }
  EXPECT_EQ(world.world.root_level, 2);
  EXPECT_LE(world.pages.size(), 300U);
  EXPECT_LE(bytes, 332'000U);
  std::printf("10,000 tiles: %zu pages, %zu bytes, root %zu bytes\n", world.pages.size(), bytes,
              world.pages.front().second.size());
}

TEST(MakePages, FollowFromTheSetAlone) {
  std::vector<PlacedTile> tiles = square(12, 7);
  const WorldPages once = pages_of(tiles);
  Random random(1);
  for (std::size_t i = tiles.size(); i > 1; --i)
    std::swap(tiles[i - 1], tiles[random.below(static_cast<std::uint32_t>(i))]);
  const WorldPages again = pages_of(tiles);
  EXPECT_EQ(once.pages, again.pages);
  EXPECT_EQ(once.name, again.name);
  EXPECT_EQ(digest_of(encode_world(once.world)), once.name);
}

// A crater.
TEST(MakePages, ATileThatIsExchangedGivesNewPagesOnItsWayToTheRootAlone) {
  std::vector<PlacedTile> tiles = square(40, 9);
  const WorldPages before = pages_of(tiles);
  tiles[777].content.low ^= 2;
  tiles[777].extent[2] += 9000;
  const WorldPages after = pages_of(tiles);
  std::set<ContentHash> old;
  for (const auto& page : before.pages) old.insert(page.first);
  std::size_t fresh = 0;
  for (const auto& page : after.pages) fresh += old.contains(page.first) ? 0 : 1;
  EXPECT_EQ(fresh, before.world.root_level + 1U);
  EXPECT_NE(before.name, after.name);
}

TEST(MakePages, OneContentMayStandInManyPlaces) {
  std::vector<PlacedTile> tiles = square(20, 4);
  for (PlacedTile& tile : tiles) tile.content = tiles.front().content;
  std::vector<WorldEntry> found;
  const WorldPages world = pages_of(tiles);
  const auto pages = decoded(world);
  collect_tiles(pages, pages.at(world.world.root), found);
  EXPECT_EQ(found.size(), 400U);
  tiles.push_back(tiles.front());
  EXPECT_EQ(make_pages(kLattice, 21, tiles).status().code(), StatusCode::kInvalidArgument);
}

TEST(MakePages, ReachToTheEndsOfTheLattice) {
  Random random(2);
  std::vector<PlacedTile> tiles = square(9, 2);
  const std::int64_t end = kWorldCells;
  tiles.push_back({some_content(random), {-end, -end, -end}, {2 * end - 1, 1, 2 * end - 1}, 1});
  tiles.push_back({some_content(random), {end - 1, end - 1, end - 1}, {0, 0, 0}, 1});
  const WorldPages world = pages_of(tiles);
  std::vector<WorldEntry> found;
  const auto pages = decoded(world);
  collect_tiles(pages, pages.at(world.world.root), found);
  EXPECT_EQ(found.size(), tiles.size());
  tiles.back().extent[1] = 1;
  EXPECT_EQ(make_pages(kLattice, 21, tiles).status().code(), StatusCode::kUnsupported);
  EXPECT_EQ(make_pages(kLattice, 21, {}).status().code(), StatusCode::kInvalidArgument);
}

TEST(DecodePage, RefusesBytesThatAreNoPage) {
  const WorldPages world = pages_of(square(6, 1));
  const std::vector<std::uint8_t> good = world.pages.front().second;
  ASSERT_TRUE(decode_page(good).is_ok());
  const auto refused = [](std::vector<std::uint8_t> bytes) { return !decode_page(bytes).is_ok(); };
  for (std::size_t size = 0; size < good.size(); ++size)
    EXPECT_TRUE(refused({good.begin(), good.begin() + static_cast<std::ptrdiff_t>(size)}));
  std::vector<std::uint8_t> bytes = good;
  bytes.push_back(0);
  EXPECT_TRUE(refused(bytes));
  const auto with = [&](std::size_t at, std::uint8_t value) {
    std::vector<std::uint8_t> changed = good;
    changed[at] = value;
    return changed;
  };
  EXPECT_TRUE(refused(with(0, 'X')));
  EXPECT_TRUE(refused(with(4, 2)));         // version
  EXPECT_TRUE(refused(with(5, 8)));         // level
  EXPECT_TRUE(refused(with(6, 0)));         // count
  EXPECT_TRUE(refused(with(7, 1)));         // count
  EXPECT_TRUE(refused(with(8 + 3, 0x40)));  // place
  EXPECT_TRUE(refused(with(8 + 12, 125)));  // extent
  EXPECT_TRUE(refused(with(8 + 15, 64)));   // faces
  std::vector<std::uint8_t> swapped = good;
  std::swap_ranges(swapped.begin() + 8, swapped.begin() + 40, swapped.begin() + 40);
  EXPECT_TRUE(refused(swapped));
  std::vector<std::uint8_t> unnamed = good;
  std::fill_n(unnamed.begin() + 8 + 16, 16, std::uint8_t{0});
  EXPECT_TRUE(refused(unnamed));
}

TEST(DecodePage, WhatItTakesItGivesAgain) {
  const std::vector<std::uint8_t> good = pages_of(square(6, 1)).pages.front().second;
  Random random(6);
  std::size_t taken = 0;
  for (int round = 0; round < 20'000; ++round) {
    std::vector<std::uint8_t> bytes = good;
    for (std::uint32_t n = 1 + random.below(3); n > 0; --n)
      bytes[random.below(static_cast<std::uint32_t>(bytes.size()))] =
          static_cast<std::uint8_t>(random.next());
    const Result<WorldPage> page = decode_page(bytes);
    if (!page.is_ok()) continue;
    ++taken;
    EXPECT_EQ(encode_page(page.value()), bytes);
  }
  EXPECT_GT(taken, 5000U);
}

TEST(CheckPage, RefusesAPageThatIsNotWhatWasAnnounced) {
  const WorldPages world = pages_of(square(40, 9));
  const auto pages = decoded(world);
  const WorldPage& root = pages.at(world.world.root);
  const WorldEntry& entry = root.entries.front();
  const WorldPage& below = pages.at(entry.content);
  EXPECT_TRUE(check_page(below, entry, root.level - 1).is_ok());
  EXPECT_FALSE(check_page(below, entry, root.level).is_ok());
  EXPECT_FALSE(check_page(pages.at(root.entries.back().content), entry, root.level - 1).is_ok());
  WorldEntry other = entry;
  other.extent[0] -= 2;
  EXPECT_FALSE(check_page(below, other, root.level - 1).is_ok());
  other = entry;
  other.log2_faces = 18;
  EXPECT_FALSE(check_page(below, other, root.level - 1).is_ok());
}

TEST(DecodeWorld, GivesWhatWasEncodedAndRefusesAllElse) {
  const WorldRecord world = pages_of(square(7, 1)).world;
  const std::vector<std::uint8_t> good = encode_world(world);
  ASSERT_EQ(good.size(), kWorldRecordBytes);
  ASSERT_TRUE(decode_world(good).is_ok());
  EXPECT_EQ(decode_world(good).value(), world);
  for (std::size_t size = 0; size < good.size(); ++size)
    EXPECT_FALSE(decode_world({good.data(), size}).is_ok());
  Random random(8);
  for (int round = 0; round < 20'000; ++round) {
    std::vector<std::uint8_t> bytes = good;
    bytes[random.below(80)] = static_cast<std::uint8_t>(random.next());
    const Result<WorldRecord> found = decode_world(bytes);
    if (found.is_ok()) {
      EXPECT_EQ(encode_world(found.value()), bytes);
    }
  }
}

TEST(CheckTileGrid, TakesWhatBeginsAtZeroOnTheWorldsCell) {
  const WorldRecord world{.lattice = kLattice, .bits = 21, .tiles = 1, .faces = 1};
  EXPECT_TRUE(check_tile_grid({.exponent = -7, .bits = 21}, world).is_ok());
  for (const Grid& other : {Grid{.exponent = -8, .bits = 21}, Grid{.exponent = -7, .bits = 20},
                            Grid{.origin_m = {1, 0, 0}, .exponent = -7, .bits = 21},
                            Grid{.exponent = -7, .bits = 21, .lattice_cells = {0, 0, 1}}})
    EXPECT_EQ(check_tile_grid(other, world).code(), StatusCode::kConflict);
}

}  // namespace
}  // namespace nearmesh
