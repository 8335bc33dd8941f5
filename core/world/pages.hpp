// SPDX-License-Identifier: Apache-2.0
#pragma once
// The pages of a set of tiles. They follow from the set alone: where a tile is exchanged for
// another in its place, all pages but those above it stay.

#include "page.hpp"

namespace nearmesh {

/// A tile in its place.
struct PlacedTile {
  ContentHash content;
  std::array<std::int64_t, 3> place{};  ///< where its grid begins, in cells from the world's origin
  std::array<std::int64_t, 3> extent{};  ///< its greatest coordinates
  std::uint64_t faces = 0;
};

struct WorldPages {
  WorldRecord world;
  ContentHash name;  ///< of the world: the digest of its record
  std::vector<std::pair<ContentHash, std::vector<std::uint8_t>>> pages;  ///< root first
};

/// In: tiles in any order, one content or several. Errors: kInvalidArgument (no tile, the same one
/// twice in one place), kUnsupported (a world that leaves kWorldCells). Cost: O(n log n).
[[nodiscard]] Result<WorldPages> make_pages(const CommonLattice& lattice, int bits,
                                            const std::vector<PlacedTile>& tiles);

}  // namespace nearmesh
