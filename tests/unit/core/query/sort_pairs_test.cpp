// SPDX-License-Identifier: Apache-2.0
#include "core/query/sort_pairs.hpp"

#include <gtest/gtest.h>

#include <algorithm>

#include "core/base/random.hpp"

namespace nearmesh::test {
namespace {

// Few and many; the same, alike, and with all bits of all numbers differing.
TEST(SortPairs, IsTheOrderOfPairs) {
  Random random(1);
  for (const std::size_t count : {0U, 1U, 63U, 64U, 400U, 3000U})
    for (const std::uint32_t splits : {1U, 2U, 200U, 70'000U, 0x7fffffffU})
      for (const std::uint32_t indices : {1U, 3U, 0x7fffffffU}) {
        const std::uint32_t from = random.below(0x7fffffff);
        const auto key = [&] {
          return FaceKey{{from + random.below(splits)}, random.below(indices)};
        };
        std::vector<FacePair> pairs(count);
        for (FacePair& pair : pairs) pair = {key(), key()};
        std::vector<FacePair> expected = pairs;
        std::sort(expected.begin(), expected.end());
        sort_pairs(pairs);
        ASSERT_EQ(pairs, expected) << count << " pairs, " << splits << " splits";
      }
}

}  // namespace
}  // namespace nearmesh::test
