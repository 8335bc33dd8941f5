// SPDX-License-Identifier: Apache-2.0
#pragma once
// API (docs/api.md).
// What an answer says of a body that is a world (docs/worlds.md): which tiles it is about, and
// which pages, tiles and nodes it misses.

#include <vector>

#include "nearmesh/core/query/query.hpp"
#include "nearmesh/core/world/world_probe.hpp"

namespace nearmesh::subscriber {

/// A tile that pages do not prove apart from the other body, now or within the look-ahead.
struct NearTile {
  WorldTile tile;
  bool is_here = false;  ///< its header is; else nothing is known of it but its box
  bool asked = false;    ///< its trees were asked; else its turn did not come, or it is not here
  AnswerStatus status = AnswerStatus::kUncertain;
  /// Of PairAnswer's pairs so many are of this tile: first come those of the first tile, and so on.
  /// Its faces are named as in the tile's model.
  std::size_t pairs = 0;
  std::vector<NodeSpan> missing;  ///< nodes of the tile's model that the answer misses, ascending
};

struct WorldAnswer {
  ContentHash world;            ///< what the answer is of: the digest of the world's record
  std::vector<NearTile> tiles;  ///< by place
  /// Pages that are not here and whose boxes are not apart from the other body, as boxes of the
  /// tiles below them are unknown.
  std::vector<ContentHash> missing_pages;
};

}  // namespace nearmesh::subscriber
