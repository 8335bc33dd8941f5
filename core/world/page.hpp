// SPDX-License-Identifier: Apache-2.0
#pragma once
// A world: tiles of one lattice in their places, listed by a tree of pages of one datagram each.
// Layout: README.md.

#include <array>
#include <compare>
#include <cstdint>
#include <set>
#include <span>
#include <vector>

#include "nearmesh/core/base/content_hash.hpp"
#include "nearmesh/core/base/status.hpp"
#include "nearmesh/core/geometry/detail/grid.hpp"

namespace nearmesh {

/// All faces of a world lie in [-kWorldCells, kWorldCells) on each axis, in cells from its origin.
inline constexpr std::int64_t kWorldCells = std::int64_t{1} << 30;

/// Corners included, in cells from the world's origin.
struct CellBox {
  std::array<std::int64_t, 3> lo{}, hi{};

  [[nodiscard]] bool contains(const CellBox& other) const;
  void add(const CellBox& other);
  bool operator==(const CellBox&) const = default;
};

/// A child of a page: a page of the level below, or, at level 0, a tile. The same content may stand
/// in many places.
struct WorldEntry {
  /// Lower corner of a box that holds all faces below; of a tile, where its grid begins. In cells
  /// from the world's origin.
  std::array<std::int32_t, 3> place{};
  std::array<std::uint8_t, 3> extent{};  ///< of the box, as in a BoxCode
  std::uint8_t log2_faces = 0;           ///< rounded down
  ContentHash content;

  [[nodiscard]] CellBox box() const;
  auto operator<=>(const WorldEntry&) const = default;
};

/// A page's children fit a datagram.
inline constexpr std::size_t kMaxPageEntries = 36;
/// 36^8 tiles are more than a world has places for.
inline constexpr int kMaxPageLevel = 7;

struct WorldPage {
  std::uint8_t level = 0;  ///< 0: its children are tiles
  std::vector<WorldEntry> entries;

  [[nodiscard]] CellBox box() const;
  bool operator==(const WorldPage&) const = default;
};

/// In: 1 to kMaxPageEntries entries, ascending.
[[nodiscard]] std::vector<std::uint8_t> encode_page(const WorldPage& page);
/// Any bytes. Errors: kCorrupt, naming what was expected and found. What it accepts, encode_page
/// gives again.
[[nodiscard]] Result<WorldPage> decode_page(std::span<const std::uint8_t> bytes);
/// Whether a page is what its parent's entry announces, at a level: errors kCorrupt. Its digest is
/// the caller's to check.
[[nodiscard]] Status check_page(const WorldPage& page, const WorldEntry& announced, int level);

/// What names a world: its lattice and the root of its pages.
struct WorldRecord {
  CommonLattice lattice;
  int bits = 21;  ///< of each tile's grid
  std::uint64_t tiles = 0, faces = 0;
  std::uint8_t root_level = 0;
  ContentHash root;

  /// The tile's grid in its place.
  [[nodiscard]] Grid grid_at(const WorldEntry& tile) const {
    return lattice.grid_at({tile.place[0], tile.place[1], tile.place[2]}, bits);
  }
  bool operator==(const WorldRecord&) const = default;
};

inline constexpr std::size_t kWorldRecordBytes = 80;
[[nodiscard]] std::vector<std::uint8_t> encode_world(const WorldRecord& world);
/// Whether the bytes that came as a model's header begin as a world's record does, and are as many.
[[nodiscard]] bool is_world_record(std::span<const std::uint8_t> bytes);
/// Any bytes. Errors: kCorrupt, kUnsupported (another version).
[[nodiscard]] Result<WorldRecord> decode_world(std::span<const std::uint8_t> bytes);

/// The pages that one walk from a world's root to its tiles has met, below the root. In a world
/// that was made each stands once: pages hold absolute places, and no tile stands twice in one. A
/// hostile one that lists a page again and again would make a walk as long as 36^7, through eight
/// pages.
class MetPages {
 public:
  /// The record must outlive this.
  explicit MetPages(const WorldRecord& world) : world_(world) {}
  /// Before a page is looked at, whether or not it is at hand. Errors: kCorrupt, naming world and
  /// page: it was met before, or there are more pages than so many tiles need. Cost: some 50 ns
  /// among tens of pages.
  [[nodiscard]] Status meet(const ContentHash& page);

 private:
  const WorldRecord& world_;
  std::set<ContentHash> met_;  // no hash table: who makes pages could aim at its buckets
};

/// Whether no tile stands twice in one place, however its boxes are told: its faces would count
/// twice, and who asks tiles side by side would ask one twice. Errors: kCorrupt, naming world and
/// tile. Cost: O(n log n).
[[nodiscard]] Status check_each_once(const WorldRecord& world, std::span<const WorldEntry> tiles);

/// Whether a tile's header is fit for the world: a grid of the world's cell and bits that begins at
/// zero. Errors: kConflict.
[[nodiscard]] Status check_tile_grid(const Grid& grid, const WorldRecord& world);

}  // namespace nearmesh
