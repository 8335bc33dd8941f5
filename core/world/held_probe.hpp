// SPDX-License-Identifier: Apache-2.0
#pragma once
// Probes of a world as far as it is held: what pages, tiles and nodes are missing leaves an answer
// uncertain, and is named. WorldProbe (world_probe.hpp) reads what is missing instead.

#include <functional>
#include <map>
#include <optional>
#include <set>
#include <span>

#include "near_tiles.hpp"
#include "nearmesh/core/world/world_probe.hpp"

namespace nearmesh {

/// What is here of a world. All of it stays as it is while it is probed.
struct HeldWorld {
  const WorldRecord& record;
  const WorldPage& root;
  PageOf page_of;  ///< null: it is not here
  /// The tree of a tile, in whatever place; none: it is not here.
  std::function<std::optional<TreeView>(const WorldEntry& tile)> tile_of;
};

/// What the answers of a batch lack together.
struct WorldNeeds {
  std::set<ContentHash> pages;
  std::set<WorldEntry> tiles;                         ///< that are not here
  std::map<WorldEntry, std::vector<NodeSpan>> nodes;  ///< of tiles that are, ascending
  /// The parts of these that matter, as in ProbeNeeds.
  std::map<WorldEntry, std::vector<GridBox>> where;

  [[nodiscard]] bool is_nothing() const { return pages.empty() && tiles.empty() && nodes.empty(); }
  [[nodiscard]] std::uint64_t count() const;
};

/// Answers a batch as WorldProbe::probe() does where all that matters is held; else it is
/// uncertain, and what it says of what is held is so. `missing` of an answer counts pages, tiles
/// and nodes. Preconditions (asserted): as many answers as probes. Errors: as WorldProbe::probe();
/// those of page_of.
[[nodiscard]] Result<WorldNeeds> probe(const HeldWorld& world, const Pose& pose,
                                       std::span<const RayProbe> rays,
                                       std::span<WorldRayAnswer> answers);
[[nodiscard]] Result<WorldNeeds> probe(const HeldWorld& world, const Pose& pose,
                                       std::span<const BallProbe> balls,
                                       std::span<WorldShapeAnswer> answers);
[[nodiscard]] Result<WorldNeeds> probe(const HeldWorld& world, const Pose& pose,
                                       std::span<const BoxProbe> boxes,
                                       std::span<WorldShapeAnswer> answers);

}  // namespace nearmesh
