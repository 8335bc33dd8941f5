// SPDX-License-Identifier: Apache-2.0
// Why boxes in the world's grid prove it: pose_point of a tile's point is that of the world's point
// in exact arithmetic, the tile's `translation` and `remainder` being the way from the one origin
// to the other in the same fixed-point rotation. So the slack of box_overlap.cpp, half a cell about
// the affine image, is that of the world's frame too. It covers int32 points, which a world's are.
#include "near_tiles.hpp"

#include <algorithm>
#include <cmath>
#include <string>

namespace nearmesh {
namespace {

class Search {
 public:
  Search(const WorldRecord& world, const PageOf& page_of, const RelativeFrame& body_in_world,
         const GridBox& body)
      : met_(world),
        page_of_(page_of),
        frame_(body_in_world),
        body_(centered(body)),
        extent_(extent_in_a(frame_, body_)) {}

  Status walk(const WorldPage& page, NearTiles& out) {
    ++out.pages;
    for (const WorldEntry& entry : page.entries) {
      if (is_farther(entry, out.apart_m)) continue;
      const CenteredBox box = centered(as_grid_box(entry.box()));
      if (const double gap_m = boxes_gap_m(frame_, box, body_, out.apart_m); gap_m > 0) {
        out.apart_m = std::min(out.apart_m, gap_m);
        continue;
      }
      if (page.level == 0) {
        out.tiles.push_back(entry);
        continue;
      }
      NEARMESH_RETURN_IF_ERROR(met_.meet(entry.content));
      const auto below = page_of_(entry, page.level - 1);
      NEARMESH_RETURN_IF_ERROR(below);
      if (below.value() == nullptr) {
        out.missing.push_back({entry, page.level - 1});
        continue;
      }
      NEARMESH_RETURN_IF_ERROR(walk(*below.value(), out));
    }
    return Status::ok();
  }

 private:
  /// Of most entries it is enough to know that others are nearer. An entry's box may be less than
  /// its code says.
  [[nodiscard]] bool is_farther(const WorldEntry& entry, double apart_m) const {
    const auto is_beyond = [&](double gap) { return gap * extent_.metres_per_unit > apart_m; };
    for (std::size_t k = 0; k < 3; ++k) {
      const double lo = entry.place[k];
      if (is_beyond(lo - extent_.hi[k]) ||
          is_beyond(extent_.lo[k] - (lo + static_cast<double>(box_extent(entry.extent[k])))))
        return true;
    }
    return false;
  }

  MetPages met_;
  const PageOf& page_of_;
  const RelativeFrame& frame_;
  CenteredBox body_;
  Extent extent_;
};

}  // namespace

GridBox as_grid_box(const CellBox& box) {
  GridBox out;
  for (std::size_t k = 0; k < 3; ++k) {
    out.lo.v[k] = static_cast<std::int32_t>(box.lo[k]);
    out.hi.v[k] = static_cast<std::int32_t>(box.hi[k]);
  }
  return out;
}

Grid world_grid(const WorldRecord& world) { return world.lattice.grid_at({}, world.bits); }

Result<NearTiles> find_near_tiles(const WorldRecord& world, const WorldPage& root,
                                  const PageOf& page_of, const RelativeFrame& body_in_world,
                                  const GridBox& body) {
  NearTiles out;
  NEARMESH_RETURN_IF_ERROR(Search(world, page_of, body_in_world, body).walk(root, out));
  NEARMESH_RETURN_IF_ERROR(check_each_once(world, out.tiles));
  std::ranges::sort(out.tiles);
  std::ranges::sort(out.missing, {}, &MissingPage::entry);
  return out;
}

namespace {

/// On each side by so many cells, as far as there are cells.
GridBox grown(const GridBox& box, std::uint32_t cells) {
  constexpr std::int64_t kLeast = std::numeric_limits<std::int32_t>::min(),
                         kMost = std::numeric_limits<std::int32_t>::max();
  GridBox out;
  for (int k = 0; k < 3; ++k) {
    out.lo[k] = static_cast<std::int32_t>(std::max(kLeast, std::int64_t{box.lo[k]} - cells));
    out.hi[k] = static_cast<std::int32_t>(std::min(kMost, std::int64_t{box.hi[k]} + cells));
  }
  return out;
}

/// By how many cells it did grow, at least.
double growth(const GridBox& box, const GridBox& larger) {
  double least = std::numeric_limits<double>::infinity();
  for (int k = 0; k < 3; ++k)
    least = std::min({least, static_cast<double>(box.lo[k]) - larger.lo[k],
                      static_cast<double>(larger.hi[k]) - box.hi[k]});
  return least;
}

}  // namespace

Result<TilesAround> find_tiles_around(const WorldRecord& world, const WorldPage& root,
                                      const PageOf& page_of, const RelativeFrame& body_in_world,
                                      const GridBox& body, std::uint32_t reach_cells) {
  const GridBox reach = grown(body, reach_cells);
  Result<NearTiles> near = find_near_tiles(world, root, page_of, body_in_world, reach);
  NEARMESH_RETURN_IF_ERROR(near);
  // A point so near the body that growing takes it in would not be apart. Four cells of each cover
  // what posing rounds. A pose from the bus is a rotation but for 1e-5, and what the body grew by
  // shrinks with it.
  const double apart_m = near.value().apart_m;
  const double grown_m = std::max(
      0.0, (growth(body, reach) - 4) * body_in_world.least_metres_per_b_unit * (1 - 0x1p-30) -
               4 * std::ldexp(1.0, world.lattice.exponent));
  return TilesAround{std::move(near).value(), apart_m + grown_m};
}

}  // namespace nearmesh
