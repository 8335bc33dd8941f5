// SPDX-License-Identifier: Apache-2.0
#pragma once
// The answer about a world and a body from those about its tiles (takes one for each tile that may
// be near, gives one for all). A peer's session and the proof of its recording both add here, so
// what is proved is what was answered.
//
// Why the sum is right: every face of the world is in one tile. A tile is apart by a box of a page
// that is here, or below a page that is not, or its trees were asked, or nothing is known of it.
// The first touches nothing (find_near_tiles); where there is one of the second or last kind
// nothing is certified. Tiles are posed to the points that one mesh of them all would be posed to
// (Grid::lattice_cells), and none has a face of another's.

#include <cstdint>
#include <vector>

#include "near_tiles.hpp"
#include "nearmesh/core/query/query.hpp"

namespace nearmesh {

struct TileSumOptions {
  bool world_is_a = false;
  Clearance clearance = Clearance::kBound;  ///< these three as in QueryOptions
  bool any = false;
  std::size_t max_pairs = kAllPairs;
};

class TileSum {
 public:
  /// In: the world's content; what else is near it, but for its tiles, which are added in their
  /// order.
  TileSum(const TileSumOptions& options, const ContentHash& world, const TilesAround& around);

  /// One of which nothing is known: it is not here, or its turn did not come.
  void add_unknown(const WorldEntry& tile);
  /// One that was asked. Out: so many of its pairs are among the sum's.
  std::size_t add(const WorldEntry& tile, const Answer& answer);
  /// The sum misses nodes of the other body alone: those of tiles have names in their models.
  [[nodiscard]] Answer finish();
  /// Of the answer that finish() gave, and of what tiles miss and have: as digest(Answer).
  [[nodiscard]] std::uint64_t digest() const { return digest_; }

 private:
  void note(const WorldEntry& tile, std::size_t pairs, const std::vector<NodeSpan>& missing);

  TileSumOptions options_;
  Answer sum_;
  bool is_all_certified_ = true;  // so far
  int contained_ = 0;
  std::vector<std::uint64_t> words_;  // of tiles that are not free
  std::uint64_t digest_ = 0;
};

/// Ascending, each once.
void add_sorted(std::vector<NodeSpan>& nodes, const std::vector<NodeSpan>& more);

}  // namespace nearmesh
