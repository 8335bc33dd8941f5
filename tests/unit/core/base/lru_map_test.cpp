// SPDX-License-Identifier: Apache-2.0
// A bounded map forgets what was used longest ago, never what is pinned, and no group displaces the
// others.
#include "core/base/lru_map.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cstddef>
#include <memory>
#include <random>
#include <string>
#include <vector>

namespace nearmesh {
namespace {

// Weeks bring more than is kept: those that are there now shall be.
TEST(LruMap, KeepsThoseThatWereUsedLast) {
  LruMap<int, int> map(4);
  map.put(1, 0);
  for (int key = 2; key <= 100; ++key) {
    map.put(key, 1);
    ++*map.use(1);
  }
  std::vector<int> keys;
  map.for_each([&](int key, int) { keys.push_back(key); });
  EXPECT_EQ(keys, (std::vector{1, 98, 99, 100}));
  EXPECT_EQ(*map.find(1), 99);
  EXPECT_EQ(map.use(97), nullptr);
}

TEST(LruMap, OfEachGroupTheLongestUnusedMakesRoomThenOfAll) {
  LruMap<std::string, int, int> map(2, 3);
  map.put("a", 11, 1);
  map.put("b", 12, 1);
  map.put("a", 21, 1);  // anew: the other has not been used for longer
  map.put("c", 13, 1);
  EXPECT_FALSE(map.extract("b"));
  map.put("d", 31, 2);
  EXPECT_EQ(map.size(), 3U);
  map.put("e", 41, 3);
  EXPECT_EQ(map.size(), 3U);
  EXPECT_FALSE(map.extract("a"));
  EXPECT_EQ(map.extract("c"), 13);
  EXPECT_EQ(map.extract("d"), 31);
  map.erase_group(3);
  EXPECT_EQ(map.size(), 0U);
}

TEST(LruMap, PinnedOnesStay) {
  LruMap<std::string, int, int> map(2, 3);
  for (const char* key : {"a", "b"}) {
    ASSERT_NE(map.put(key, 0, 1), nullptr);
    map.pin(key);
  }
  EXPECT_EQ(map.put("c", 0, 1), nullptr) << "its group is full";
  map.unpin("b");
  map.unpin("a");
  map.unpin("b");  // is not: it has not been used since
  map.put("c", 0, 1);
  EXPECT_EQ(map.find("b"), nullptr);
  map.pin("a");
  map.pin("c");
  ASSERT_NE(map.put("d", 0, 2), nullptr);
  map.pin("d");
  EXPECT_EQ(map.put("e", 0, 3), nullptr) << "all is full";
  EXPECT_EQ(*map.group_of("d"), 2);
  map.erase_group(1);
  EXPECT_EQ(map.size(), 1U);
}

// Against one that looks at all of them.
TEST(LruMap, IsWhatASearchOfAllGives) {
  struct Kept {
    int key, group;
    bool is_pinned;
  };
  constexpr std::size_t kMostOfGroup = 5, kMost = 12;
  std::vector<Kept> all;  // the least recently used first
  const auto at = [&](int key) {
    return std::find_if(all.begin(), all.end(), [&](const Kept& kept) { return kept.key == key; });
  };
  const auto move_to_end = [&](int key, bool is_pinned) {
    const Kept kept{key, at(key)->group, is_pinned};
    all.erase(at(key));
    all.push_back(kept);
  };
  LruMap<int, std::unique_ptr<int>, int> map(kMostOfGroup, kMost);
  std::mt19937 random(1);
  for (int i = 0; i < 20000; ++i) {
    const int key = static_cast<int>(random() % 30), group = static_cast<int>(random() % 4);
    switch (random() % 8) {
      case 0:
      case 1:
      case 2: {
        if (at(key) != all.end()) all.erase(at(key));
        const auto of_group = [&](const Kept& kept) { return kept.group == group; };
        const bool full =
            std::count_if(all.begin(), all.end(), of_group) == std::ptrdiff_t{kMostOfGroup};
        const auto first = std::find_if(all.begin(), all.end(), [&](const Kept& kept) {
          return !kept.is_pinned && (!full || of_group(kept));
        });
        const bool needs_room = full || all.size() == kMost;
        const bool fits = !needs_room || first != all.end();
        if (needs_room && fits) all.erase(first);
        if (fits) all.push_back({key, group, false});
        EXPECT_EQ(map.put(key, std::make_unique<int>(key), group) != nullptr, fits);
        break;
      }
      case 3:
        if (at(key) != all.end() && !at(key)->is_pinned) move_to_end(key, false);
        EXPECT_EQ(map.use(key) != nullptr, at(key) != all.end());
        break;
      case 4:
        if (at(key) != all.end()) at(key)->is_pinned = true;
        map.pin(key);
        break;
      case 5:
        if (at(key) != all.end() && at(key)->is_pinned) move_to_end(key, false);
        map.unpin(key);
        break;
      case 6:
        if (at(key) != all.end()) all.erase(at(key));
        map.erase(key);
        break;
      default:
        if (random() % 8 != 0) break;
        std::erase_if(all, [&](const Kept& kept) { return kept.group == group; });
        map.erase_group(group);
    }
    ASSERT_EQ(map.size(), all.size()) << "step " << i;
    for (const Kept& kept : all) {
      ASSERT_NE(map.find(kept.key), nullptr) << "step " << i;
      ASSERT_EQ(**map.find(kept.key), kept.key);
      ASSERT_EQ(*map.group_of(kept.key), kept.group);
    }
  }
}

}  // namespace
}  // namespace nearmesh
