// SPDX-License-Identifier: Apache-2.0
#pragma once
// Tiles that are open: the least recently used are closed where there are too many, or hold too
// much. A tile at rest costs nothing.

#include <list>
#include <map>
#include <memory>
#include <vector>

#include "core/spm/coding_sets.hpp"
#include "nearmesh/core/spm/model_file.hpp"
#include "world_folder.hpp"

namespace nearmesh {

/// Errors: those of opening, kConflict (another content than its name says, or no tile of this
/// world), naming the file.
[[nodiscard]] Result<ModelFile> open_tile(const WorldFolder& folder, const ContentHash& content,
                                          SharedTables* shared = nullptr);

class OpenTiles {
 public:
  /// So many at most, each of which takes a descriptor; where a process may have few of these, half
  /// of them. And so many splits that all of them have decoded: 0.1 kB each where a tile is whole,
  /// 0.8 below a flight, which needs a few of each page of memory.
  static constexpr std::size_t kMostTiles = 512, kMostSplits = 1'000'000;

  /// Holds one tile in any case. The folder must outlive it.
  explicit OpenTiles(const WorldFolder& folder, std::size_t most_tiles = kMostTiles,
                     std::size_t most_splits = kMostSplits);

  /// Closed when it is neither among those used last nor held by who asked for it. None is open
  /// twice. Errors: those of open_tile().
  [[nodiscard]] Result<std::shared_ptr<ModelFile>> open(const ContentHash& content);
  [[nodiscard]] std::size_t count() const { return by_content_.size(); }
  /// Those that would be closed by now, had nobody held them when others were opened.
  [[nodiscard]] std::vector<ContentHash> held() const;

 private:
  void close_unused();

  const WorldFolder& folder_;
  const std::size_t most_tiles_, most_splits_;
  using Tiles = std::list<std::pair<ContentHash, std::shared_ptr<ModelFile>>>;
  Tiles tiles_;  // the last used first
  std::map<ContentHash, Tiles::iterator> by_content_;
  SharedTables tables_;
  std::map<ContentHash, std::weak_ptr<ModelFile>> held_;  // no longer used here, but by others
};

}  // namespace nearmesh
