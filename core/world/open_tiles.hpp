// SPDX-License-Identifier: Apache-2.0
#pragma once
// Tiles that are open: the least recently used is closed where there are too many. A tile at rest costs nothing.

#include <list>
#include <map>

#include "nearmesh/core/spm/model_file.hpp"
#include "world_folder.hpp"

namespace nearmesh {

/// Errors: those of opening, kConflict (another content than its name says, or no tile of this world), naming the file.
[[nodiscard]] Result<ModelFile> open_tile(const WorldFolder& folder, const ContentHash& content);

class OpenTiles {
 public:
  /// Holds at most so many, one at least. The folder must outlive it.
  OpenTiles(const WorldFolder& folder, std::size_t most) : folder_(folder), most_(most) {}

  /// Until the next call. Errors: those of open_tile().
  [[nodiscard]] Result<ModelFile*> open(const ContentHash& content);
  [[nodiscard]] std::size_t count() const { return by_content_.size(); }

 private:
  const WorldFolder& folder_;
  std::size_t most_;
  std::list<std::pair<ContentHash, ModelFile>> tiles_;  // the last used first
  std::map<ContentHash, std::list<std::pair<ContentHash, ModelFile>>::iterator> by_content_;
};

}  // namespace nearmesh
