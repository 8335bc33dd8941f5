// SPDX-License-Identifier: Apache-2.0
#pragma once
// What the full tiles of a world say: the reference for answers about bodies that are worlds.

#include <functional>
#include <list>
#include <memory>
#include <string>

#include "core/world/near_tiles.hpp"
#include "core/world/world_folder.hpp"
#include "nearmesh/core/query/query.hpp"

namespace nearmesh::program {

/// As find_near_tiles(), of a world on disk.
[[nodiscard]] Result<NearTiles> find_near_tiles(const WorldFolder& folder, const WorldPage& root,
                                                const PosedPair& world_and_body,
                                                const GridBox& body);

class FullWorld {
 public:
  [[nodiscard]] static Result<FullWorld> open(const std::string& folder);

  [[nodiscard]] const ContentHash& content() const { return folder_->name(); }

  /// Where the world and the other body are, and which of them comes first in the pairs of faces.
  struct Asked {
    Pose world_pose, pose;
    TreeView body;
    bool is_solid = false;  ///< the body; a world never is
    bool is_world_a = true;
    std::string world_name, name;  ///< for errors
  };
  /// Status, what is inside, and pairs: of the first tile by place, then of the second, and so on.
  /// Cost: building a tile's tree where it is not among the last kMostTrees.
  [[nodiscard]] Result<Answer> answer(const Asked& asked);

 private:
  static constexpr std::size_t kMostTrees = 8;
  struct Tile {
    ContentHash content;
    TriangleTree tree;
  };
  [[nodiscard]] Result<const TriangleTree*> tree_of(const ContentHash& content);

  std::unique_ptr<WorldFolder> folder_;
  WorldPage root_;
  std::list<Tile> tiles_;  // the last used first
};

}  // namespace nearmesh::program
