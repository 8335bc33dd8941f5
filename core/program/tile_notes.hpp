// SPDX-License-Identifier: Apache-2.0
#pragma once
// What build-world remembers of the tiles that it has baked, and whether they are still there as
// they were (takes and gives notes, files of a world's folder).

#include <cstdint>
#include <nlohmann/json.hpp>
#include <optional>
#include <set>
#include <string>

#include "core/spm/coding_sets.hpp"
#include "core/world/world_folder.hpp"
#include "nearmesh/core/base/status.hpp"

namespace nearmesh::program {

/// What became of a tile.
struct TileNote {
  PlacedTile tile;  ///< no faces: nothing is there
  std::uint64_t bytes = 0;
  double seconds = 0;  ///< of its bake
};
[[nodiscard]] nlohmann::ordered_json as_json(const TileNote& note);

class TileNotes {
 public:
  explicit TileNotes(std::string world) : world_(std::move(world)) {}
  /// None where none is kept, or the tile that it names is not there, or not whole: a damaged one
  /// is told of on standard error.
  /// Cost: each tile's file is read once, however many notes name it.
  [[nodiscard]] std::optional<TileNote> read(const std::string& path);
  /// Of a tile that was just baked, or was read. Errors: kIo, naming the path.
  [[nodiscard]] Status write(const std::string& path, const TileNote& note);

 private:
  [[nodiscard]] bool is_whole(const TileNote& note);

  const std::string world_;
  std::set<ContentHash> whole_;  ///< what was found so
  SharedTables tables_;          ///< of the tiles that were looked at
};

}  // namespace nearmesh::program
