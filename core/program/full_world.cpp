// SPDX-License-Identifier: Apache-2.0
#include "full_world.hpp"

#include <algorithm>
#include <deque>
#include <utility>

#include "core/world/open_tiles.hpp"

namespace nearmesh::program {

Result<NearTiles> find_near_tiles(const WorldFolder& folder, const WorldPage& root,
                                  const PosedPair& world_and_body, const GridBox& body) {
  std::deque<WorldPage> pages;
  const PageOf page_of = [&](const WorldEntry& entry, int level) -> Result<const WorldPage*> {
    Result<WorldPage> page = folder.page(entry, level);
    NEARMESH_RETURN_IF_ERROR(page);
    return &pages.emplace_back(std::move(page).value());
  };
  return nearmesh::find_near_tiles(folder.world(), root, page_of,
                                   make_relative_frame(world_and_body.a, world_and_body.b), body);
}

Result<FullWorld> FullWorld::open(const std::string& folder) {
  Result<WorldFolder> opened = WorldFolder::open(folder);
  NEARMESH_RETURN_IF_ERROR(opened);
  Result<WorldPage> root = opened.value().root();
  NEARMESH_RETURN_IF_ERROR(root);
  FullWorld world;
  world.folder_ = std::make_unique<WorldFolder>(std::move(opened).value());
  world.root_ = std::move(root).value();
  return world;
}

Result<const TriangleTree*> FullWorld::tree_of(const ContentHash& content) {
  const auto at = std::find_if(tiles_.begin(), tiles_.end(),
                               [&](const Tile& tile) { return tile.content == content; });
  if (at != tiles_.end()) {
    tiles_.splice(tiles_.begin(), tiles_, at);
    return &tiles_.front().tree;
  }
  Result<ModelFile> file = open_tile(*folder_, content);
  NEARMESH_RETURN_IF_ERROR(file);
  NEARMESH_RETURN_IF_ERROR(file.value().require_all());
  std::optional<TriangleTree> tree = build_full_tree(file.value().header(), file.value().store());
  if (!tree) return Status{StatusCode::kCorrupt, file.value().path() + ": a split is missing"};
  if (tiles_.size() == kMostTrees) tiles_.pop_back();
  tiles_.push_front({content, *std::move(tree)});
  return &tiles_.front().tree;
}

Result<Answer> FullWorld::answer(const Asked& asked) {
  const auto pose_in = [&asked](const Grid& grid) {
    return pose_pair(grid, asked.world_pose, asked.world_name, *asked.body.grid, asked.pose,
                     asked.name);
  };
  const Result<PosedPair> posed = pose_in(world_grid(folder_->world()));
  NEARMESH_RETURN_IF_ERROR(posed);
  const Result<NearTiles> near =
      find_near_tiles(*folder_, root_, posed.value(), asked.body.root().box);
  NEARMESH_RETURN_IF_ERROR(near);
  Answer sum;
  int contained = 0;
  bool is_certified_all = true;
  for (const WorldEntry& entry : near.value().tiles) {
    const Grid grid = folder_->world().grid_at(entry);
    const Result<const TriangleTree*> tree = tree_of(entry.content);
    NEARMESH_RETURN_IF_ERROR(tree);
    TreeView tile = tree.value()->view();
    tile.grid = &grid;
    const Result<PosedPair> in_place = pose_in(grid);
    NEARMESH_RETURN_IF_ERROR(in_place);
    const QueryOptions options{.clearance = Clearance::kNone,
                               .solid_a = asked.is_solid && !asked.is_world_a,
                               .solid_b = asked.is_solid && asked.is_world_a};
    const Answer part =
        asked.is_world_a ? query(tile, in_place.value().a, asked.body, in_place.value().b, options)
                         : query(asked.body, in_place.value().b, tile, in_place.value().a, options);
    is_certified_all &= is_certified(part.status);
    contained |= static_cast<int>(part.contained);
    sum.pairs.insert(sum.pairs.end(), part.pairs.begin(), part.pairs.end());
  }
  sum.pair_total = sum.pairs.size();
  // As of one mesh: what touches is told first, and what is inside only where nothing touches.
  if (sum.pair_total > 0) {
    sum.status = AnswerStatus::kContact;
  } else if (!is_certified_all) {
    sum.status = AnswerStatus::kUncertain;
  } else {
    sum.status = contained != 0 ? AnswerStatus::kContained : AnswerStatus::kFree;
    sum.contained = static_cast<Containment>(contained);
  }
  return sum;
}

}  // namespace nearmesh::program
