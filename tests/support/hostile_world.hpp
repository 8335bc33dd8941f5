// SPDX-License-Identifier: Apache-2.0
#pragma once
// A world that is small on disk and endless to whoever follows each entry.

#include <algorithm>
#include <utility>

#include "core/base/digest.hpp"
#include "core/world/pages.hpp"

namespace nearmesh::test {

/// A page of each level below `levels`, at most 8, which lists the one of the level below (level 0:
/// a tile that is nowhere) as often as it may: in boxes of one corner, each wider than the one
/// before. Each page is what its parent announces, and the record has room for all that they list.
inline WorldPages world_that_repeats_its_pages(int levels) {
  WorldPages out{.world = {.tiles = std::uint64_t{1} << 62,
                           .faces = std::uint64_t{1} << 63,
                           .root_level = static_cast<std::uint8_t>(levels - 1)}};
  ContentHash below{1, 1};
  for (int level = 0; level < levels; ++level) {
    WorldPage page{.level = static_cast<std::uint8_t>(level)};
    for (int i = 0; i < static_cast<int>(kMaxPageEntries); ++i) {
      constexpr int kWidest = 107;  // codes of extents
      const int wide = static_cast<int>(kMaxPageEntries) * level + i;
      WorldEntry entry{.log2_faces = 10, .content = below};
      for (int k = 0; k < 3; ++k)
        entry.extent[static_cast<std::size_t>(k)] =
            static_cast<std::uint8_t>(std::clamp(wide - kWidest * k, 0, kWidest));
      page.entries.push_back(entry);
    }
    auto bytes = encode_page(page);
    below = digest_of(bytes);
    out.pages.emplace(out.pages.begin(), below, std::move(bytes));
  }
  out.world.root = below;
  out.name = digest_of(encode_world(out.world));
  return out;
}

}  // namespace nearmesh::test
