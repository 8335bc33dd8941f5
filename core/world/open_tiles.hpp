// SPDX-License-Identifier: Apache-2.0
#pragma once
// Tiles that are open: the least recently used is closed where there are too many. A tile at rest costs nothing.

#include <list>
#include <map>
#include <memory>

#include "nearmesh/core/spm/model_file.hpp"
#include "world_folder.hpp"

namespace nearmesh {

/// Errors: those of opening, kConflict (another content than its name says, or no tile of this world), naming the file.
[[nodiscard]] Result<ModelFile> open_tile(const WorldFolder& folder, const ContentHash& content);

class OpenTiles {
 public:
  /// Holds at most so many, one at least. The folder must outlive it.
  OpenTiles(const WorldFolder& folder, std::size_t most) : folder_(folder), most_(most) {}

  /// Closed when it is neither among those used last nor held by who asked for it. Errors: those of open_tile().
  [[nodiscard]] Result<std::shared_ptr<ModelFile>> open(const ContentHash& content);
  [[nodiscard]] std::size_t count() const { return by_content_.size(); }

 private:
  const WorldFolder& folder_;
  std::size_t most_;
  using Tiles = std::list<std::pair<ContentHash, std::shared_ptr<ModelFile>>>;
  Tiles tiles_;  // the last used first
  std::map<ContentHash, Tiles::iterator> by_content_;
};

}  // namespace nearmesh
