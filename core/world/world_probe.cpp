// SPDX-License-Identifier: Apache-2.0
// Why tiles answer as one mesh would: a ray is put on the lattice of the world once, for all tiles,
// and a tile's faces are posed on that lattice to the same points as the world's (near_tiles.cpp).
// Which tiles a ray may meet is told by boxes, grown as those of a tree are
// (core/query/ray_walk.cpp).
#include "nearmesh/core/world/world_probe.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <list>
#include <map>
#include <optional>
#include <utility>
#include <vector>

#include "core/base/float_guard.hpp"
#include "core/query/probe_needs.hpp"
#include "near_tiles.hpp"
#include "open_tiles.hpp"
#include "world_reach.hpp"

namespace nearmesh {
namespace {

/// Some 5 MB of pages.
constexpr std::size_t kMostPages = 4096;

struct TileOnRay {
  WorldEntry tile;
  double enter = 0;
};

WorldTile told(const WorldEntry& tile) { return {tile.content, tile.place}; }

}  // namespace

struct WorldProbe::Impl {
  Impl(WorldFolder world, WorldPage top, std::size_t most)
      : folder(std::move(world)),
        root(std::move(top)),
        most_tiles(std::max<std::size_t>(most, 1)) {}

  /// A tile with what was read of it.
  struct Tile {
    explicit Tile(ModelFile opened)
        : file(std::move(opened)), held(file.store(), file.header().grid) {}
    ModelFile file;
    LocalModel held;
  };

  WorldFolder folder;
  WorldPage root;
  std::size_t most_tiles;
  std::map<ContentHash, WorldPage> pages;
  std::list<std::pair<ContentHash, Tile>> tiles;  // the last used first
  std::map<ContentHash, decltype(tiles)::iterator> by_content;
  SharedTables tables;

  Result<const WorldPage*> page(const WorldEntry& entry, int level) {
    // Another walk may have come to it by another entry, not all of which need be true: whatever is
    // announced is checked.
    if (const auto at = pages.find(entry.content); at != pages.end()) {
      NEARMESH_RETURN_IF_ERROR(check_page(at->second, entry, level));
      return &at->second;
    }
    Result<WorldPage> read = folder.page(entry, level);
    NEARMESH_RETURN_IF_ERROR(read);
    return &pages.emplace(entry.content, std::move(read).value()).first->second;
  }

  /// Calls visit(tile) for each tile whose box, and those of the pages above it, `meets` accepts.
  template <class Meets, class Visit>
  Status walk(const WorldPage& from, const Meets& accepts, const Visit& visit, MetPages& met) {
    for (const WorldEntry& entry : from.entries) {
      if (!accepts(entry.box())) continue;
      if (from.level == 0) {
        visit(entry);
        continue;
      }
      NEARMESH_RETURN_IF_ERROR(met.meet(entry.content));
      const Result<const WorldPage*> below = page(entry, from.level - 1);
      NEARMESH_RETURN_IF_ERROR(below);
      NEARMESH_RETURN_IF_ERROR(walk(*below.value(), accepts, visit, met));
    }
    return Status::ok();
  }
  template <class Meets, class Visit>
  Status walk(const Meets& accepts, const Visit& visit) {
    if (pages.size() > kMostPages) pages.clear();
    MetPages met(folder.world());
    return walk(root, accepts, visit, met);
  }

  Result<Tile*> open(const ContentHash& content) {
    if (const auto at = by_content.find(content); at != by_content.end()) {
      tiles.splice(tiles.begin(), tiles, at->second);
      return &tiles.front().second;
    }
    Result<ModelFile> file = open_tile(folder, content, &tables);
    NEARMESH_RETURN_IF_ERROR(file);
    while (tiles.size() >= most_tiles) {
      by_content.erase(tiles.back().first);
      tiles.pop_back();
    }
    tiles.emplace_front(std::piecewise_construct, std::forward_as_tuple(content),
                        std::forward_as_tuple(std::move(file).value()));
    by_content[content] = tiles.begin();
    return &tiles.front().second;
  }
  /// A tile that could not be read to the end is forgotten, also where memory ran out: mesh and
  /// tree may have parted.
  Status split(Tile& tile, const std::vector<NodeSpan>& missing) {
    Status status;
    try {
      status = split_missing(tile.held, missing,
                             [&tile](NodeSpan node) { return tile.file.require(node); });
    } catch (...) {
      forget_tiles();
      throw;
    }
    if (!status.is_ok()) forget_tiles();
    return status;
  }
  void forget_tiles() {
    by_content.clear();
    tiles.clear();
  }

  /// Of each of some rays the first hit of one tile, certified.
  Status walk_tile(const WorldEntry& entry, const Pose& pose, std::span<const CutRay> rays,
                   std::span<RayFound> found) {
    const Result<Tile*> tile = open(entry.content);
    NEARMESH_RETURN_IF_ERROR(tile);
    const Result<PosedFrame> frame = probe_frame(folder.world().grid_at(entry), pose);
    NEARMESH_RETURN_IF_ERROR(frame);
    QueryStats stats;
    while (true) {
      const TreeView view = tile.value()->held.view();
      std::vector<NodeOnRay> nodes;
      walk_rays(view, frame.value(), rays, found, nodes, stats);
      if (nodes.empty()) return Status::ok();
      std::vector<NodeSpan> missing;
      for (const NodeOnRay& node : nodes)
        missing.push_back(
            view.nodes[node.place / kLanes].entry(node.place % kLanes).unresolved_node());
      std::sort(missing.begin(), missing.end());
      missing.erase(std::unique(missing.begin(), missing.end()), missing.end());
      NEARMESH_RETURN_IF_ERROR(split(*tile.value(), missing));
    }
  }

  Status probe_rays(const Pose& pose, const PosedFrame& frame, const GridView& view,
                    std::span<const RayProbe> rays, std::span<WorldRayAnswer> answers) {
    const LatticeBox bounds = pose_box(frame, as_grid_box(root.box()));
    std::vector<CutRay> cuts;
    std::vector<std::vector<TileOnRay>> on_ray(rays.size());
    std::vector<RayFound> best(rays.size());
    for (std::size_t i = 0; i < rays.size(); ++i) {
      cuts.push_back(cut_ray(rays[i], bounds, frame.lattice_exp));
      answers[i] = {};
      if (cuts[i].is_empty) continue;
      const SeenRay seen(view, cuts[i].ray);
      NEARMESH_RETURN_IF_ERROR(
          walk([&](const CellBox& box) { return seen.enters(box).has_value(); },
               [&](const WorldEntry& tile) {
                 on_ray[i].push_back({tile, seen.enters(tile.box()).value_or(0)});
               }));
      std::sort(on_ray[i].begin(), on_ray[i].end(), [](const TileOnRay& a, const TileOnRay& b) {
        return std::tie(a.enter, a.tile) < std::tie(b.enter, b.tile);
      });
    }
    // Each ray's nearest tile first, then its next, as long as it has not met anything before that.
    for (std::size_t round = 0;; ++round) {
      std::map<WorldEntry, std::vector<std::size_t>> due;
      for (std::size_t i = 0; i < rays.size(); ++i)
        if (round < on_ray[i].size() && on_ray[i][round].enter <= best[i].limit())
          due[on_ray[i][round].tile].push_back(i);
      if (due.empty()) break;
      for (const auto& [tile, places] : due) {
        std::vector<CutRay> its;
        for (const std::size_t i : places) its.push_back(cuts[i]);
        std::vector<RayFound> found(its.size());
        NEARMESH_RETURN_IF_ERROR(walk_tile(tile, pose, its, found));
        for (std::size_t n = 0; n < its.size(); ++n) {
          const std::size_t i = places[n];
          if (!found[n].has_face ||
              (best[i].has_face && !comes_before(cuts[i].ray, found[n], best[i])))
            continue;
          best[i] = found[n];
          answers[i].tile = told(tile);
        }
      }
    }
    for (std::size_t i = 0; i < rays.size(); ++i) {
      RayAnswer& answer = answers[i].ray;
      answer.status = best[i].has_face ? ProbeStatus::kHit : ProbeStatus::kMiss;
      answer.at_least_m = std::numeric_limits<double>::infinity();
      if (best[i].has_face) tell_hit(cuts[i], best[i], frame.lattice_exp, answer);
    }
    return Status::ok();
  }

  /// Balls and boxes: each tile near one answers by itself.
  template <class Shape>
  Status probe_shape(const Pose& pose, const Reach& reach, const Shape& shape,
                     WorldShapeAnswer& answer) {
    std::vector<WorldEntry> near;
    NEARMESH_RETURN_IF_ERROR(walk([&](const CellBox& box) { return meets(reach, box); },
                                  [&](const WorldEntry& tile) { near.push_back(tile); }));
    std::sort(near.begin(), near.end());
    answer = {};
    answer.shape.status = ProbeStatus::kMiss;
    for (const WorldEntry& entry : near) {
      const Result<Tile*> tile = open(entry.content);
      NEARMESH_RETURN_IF_ERROR(tile);
      const Grid grid = folder.world().grid_at(entry);
      ShapeAnswer here;
      while (true) {
        TreeView view = tile.value()->held.view();
        view.grid = &grid;
        const Result<ProbeNeeds> needs =
            nearmesh::probe(view, pose, std::span(&shape, 1), std::span(&here, 1));
        NEARMESH_RETURN_IF_ERROR(needs);
        if (needs.value().is_nothing()) break;
        NEARMESH_RETURN_IF_ERROR(split(*tile.value(), needs.value().missing));
      }
      if (here.status == ProbeStatus::kMiss) continue;
      answer = {here, told(entry)};
      if (here.status == ProbeStatus::kHit) break;
    }
    return Status::ok();
  }
};

WorldProbe::WorldProbe(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
WorldProbe::WorldProbe(WorldProbe&&) noexcept = default;
WorldProbe& WorldProbe::operator=(WorldProbe&&) noexcept = default;
WorldProbe::~WorldProbe() = default;

Result<WorldProbe> WorldProbe::open(const std::string& folder, std::size_t most_tiles) {
  Result<WorldFolder> opened = WorldFolder::open(folder);
  NEARMESH_RETURN_IF_ERROR(opened);
  Result<WorldPage> root = opened.value().root();
  NEARMESH_RETURN_IF_ERROR(root);
  return WorldProbe(
      std::make_unique<Impl>(std::move(opened).value(), std::move(root).value(), most_tiles));
}

std::size_t WorldProbe::open_tiles() const { return impl_->tiles.size(); }

Status WorldProbe::probe(const Pose& pose, std::span<const RayProbe> rays,
                         std::span<WorldRayAnswer> answers) {
  const FloatGuard guard;
  NEARMESH_ASSERT(rays.size() == answers.size());
  const Result<PosedFrame> frame = probe_frame(world_grid(impl_->folder.world()), pose);
  NEARMESH_RETURN_IF_ERROR(frame);
  for (std::size_t i = 0; i < rays.size(); ++i) NEARMESH_RETURN_IF_ERROR(check_ray(rays[i], i));
  const GridView view(frame.value());
  constexpr std::size_t kBatch = 4096;  // bounds what is held of rays
  for (std::size_t first = 0; first < rays.size(); first += kBatch) {
    const std::size_t count = std::min(kBatch, rays.size() - first);
    NEARMESH_RETURN_IF_ERROR(impl_->probe_rays(
        pose, frame.value(), view, rays.subspan(first, count), answers.subspan(first, count)));
  }
  return Status::ok();
}

Status WorldProbe::probe(const Pose& pose, std::span<const BallProbe> balls,
                         std::span<WorldShapeAnswer> answers) {
  const FloatGuard guard;
  NEARMESH_ASSERT(balls.size() == answers.size());
  const Result<PosedFrame> frame = probe_frame(world_grid(impl_->folder.world()), pose);
  NEARMESH_RETURN_IF_ERROR(frame);
  const GridView view(frame.value());
  for (std::size_t i = 0; i < balls.size(); ++i) {
    NEARMESH_RETURN_IF_ERROR(check_ball(balls[i], i, frame.value().lattice_exp));
    const Reach reach = reach_of(view, frame.value(), balls[i]);
    NEARMESH_RETURN_IF_ERROR(impl_->probe_shape(pose, reach, balls[i], answers[i]));
  }
  return Status::ok();
}

Status WorldProbe::probe(const Pose& pose, std::span<const BoxProbe> boxes,
                         std::span<WorldShapeAnswer> answers) {
  const FloatGuard guard;
  NEARMESH_ASSERT(boxes.size() == answers.size());
  const Result<PosedFrame> frame = probe_frame(world_grid(impl_->folder.world()), pose);
  NEARMESH_RETURN_IF_ERROR(frame);
  const GridView view(frame.value());
  for (std::size_t i = 0; i < boxes.size(); ++i) {
    const BoxProbe& box = boxes[i];
    NEARMESH_RETURN_IF_ERROR(check_box(box, i));
    const Reach reach = reach_of(view, frame.value(), box);
    NEARMESH_RETURN_IF_ERROR(impl_->probe_shape(pose, reach, box, answers[i]));
  }
  return Status::ok();
}

}  // namespace nearmesh
