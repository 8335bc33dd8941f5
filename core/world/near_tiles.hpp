// SPDX-License-Identifier: Apache-2.0
#pragma once
// Which tiles of a posed world a posed body may meet, by the boxes of pages. A page that is not at
// hand is an unresolved node of the world: it is named, and nothing is said of what is below it.

#include <functional>
#include <limits>

#include "nearmesh/core/geometry/detail/box_overlap.hpp"
#include "nearmesh/core/spm/detail/split_store.hpp"
#include "page.hpp"

namespace nearmesh {

/// A page that is not at hand.
struct MissingPage {
  WorldEntry entry;
  int level = 0;
  bool operator==(const MissingPage&) const = default;
};

struct NearTiles {
  std::vector<WorldEntry> tiles;     ///< not proved apart from the body, ascending
  std::vector<MissingPage> missing;  ///< the same, of pages
  /// A lower bound of the distance from the body to all else, metres.
  double apart_m = std::numeric_limits<double>::infinity();
  std::uint64_t pages = 0;  ///< looked at
};

/// The page of an entry at a level, checked (check_page); null where it is not at hand. It stays
/// where it is until the search has ended.
using PageOf = std::function<Result<const WorldPage*>(const WorldEntry& entry, int level)>;

/// In: a box of a world's, which fits.
[[nodiscard]] GridBox as_grid_box(const CellBox& box);

/// The grid in whose cells pages have their boxes. Posed, it places each point of the lattice where
/// the tiles' own grids place it.
[[nodiscard]] Grid world_grid(const WorldRecord& world);

/// In: the root page; body_in_world maps the body's grid into world_grid. No posed face of a tile
/// that is neither listed nor below a missing page meets a posed triangle with its corners in
/// `body`. Errors: those of page_of, of MetPages, so a walk is no longer than there are pages, and
/// of check_each_once(). Cost: some 0.1 us an entry of the pages near the body.
[[nodiscard]] Result<NearTiles> find_near_tiles(const WorldRecord& world, const WorldPage& root,
                                                const PageOf& page_of,
                                                const RelativeFrame& body_in_world,
                                                const GridBox& body);

/// The tiles that stand for a world in an answer about it and a body.
struct TilesAround {
  NearTiles near;
  double rest_m = 0;  ///< all else is so far from the body, at least
};

/// As find_near_tiles(), of the body's box grown by so many cells of its grid on each side: what
/// must not be met is listed early, and all else is farther. The same on whoever holds the same
/// pages. In: SplitStore::whole_box(); body_in_world maps the body's grid into world_grid.
[[nodiscard]] Result<TilesAround> find_tiles_around(const WorldRecord& world, const WorldPage& root,
                                                    const PageOf& page_of,
                                                    const RelativeFrame& body_in_world,
                                                    const GridBox& body, std::uint32_t reach_cells);

}  // namespace nearmesh
