// SPDX-License-Identifier: Apache-2.0
// Why boxes in the world's grid prove it: pose_point of a tile's point is that of the world's point in exact arithmetic, the tile's
// `translation` and `remainder` being the way from the one origin to the other in the same fixed-point rotation. So the slack of
// box_overlap.cpp, half a cell about the affine image, is that of the world's frame too. It covers int32 points, which a world's are.
#include "near_tiles.hpp"

#include <algorithm>
#include <string>

namespace nearmesh {
namespace {

GridBox as_grid_box(const CellBox& box) {
  GridBox out;
  for (std::size_t k = 0; k < 3; ++k) {
    out.lo.v[k] = static_cast<std::int32_t>(box.lo[k]);
    out.hi.v[k] = static_cast<std::int32_t>(box.hi[k]);
  }
  return out;
}

class Search {
 public:
  Search(const WorldRecord& world, const PageOf& page_of, const RelativeFrame& body_in_world,
         const GridBox& body)
      : most_pages_(world.tiles + kMaxPageLevel + 1),
        page_of_(page_of),
        frame_(body_in_world),
        body_(centered(body)) {}

  Status walk(const WorldPage& page, NearTiles& out) {
    // Each page of an honest world has a tile of its own below it, or is above such a page.
    if (++out.pages > most_pages_)
      return {StatusCode::kCorrupt, "its pages list more tiles than its record"};
    for (const WorldEntry& entry : page.entries) {
      const CenteredBox box = centered(as_grid_box(entry.box()));
      if (boxes_apart(frame_, box, body_)) {
        out.apart_m = std::min(out.apart_m, boxes_gap_m(frame_, box, body_));
        continue;
      }
      if (page.level == 0) {
        out.tiles.push_back(entry);
        continue;
      }
      const auto below = page_of_(entry, page.level - 1);
      NEARMESH_RETURN_IF_ERROR(below);
      if (!below.value()) {
        out.missing.push_back({entry, page.level - 1});
        continue;
      }
      NEARMESH_RETURN_IF_ERROR(walk(*below.value(), out));
    }
    return Status::ok();
  }

 private:
  std::uint64_t most_pages_;
  const PageOf& page_of_;
  const RelativeFrame& frame_;
  CenteredBox body_;
};

}  // namespace

Grid world_grid(const WorldRecord& world) { return world.lattice.grid_at({}, world.bits); }

Result<NearTiles> find_near_tiles(const WorldRecord& world, const WorldPage& root,
                                  const PageOf& page_of, const RelativeFrame& body_in_world,
                                  const GridBox& body) {
  NearTiles out;
  NEARMESH_RETURN_IF_ERROR(Search(world, page_of, body_in_world, body).walk(root, out));
  std::ranges::sort(out.tiles);
  std::ranges::sort(out.missing, {}, &MissingPage::entry);
  return out;
}

}  // namespace nearmesh
