// SPDX-License-Identifier: Apache-2.0
#pragma once
// What whoever serves a world answers from: its pages, and tiles that are opened when they are asked for.

#include <memory>
#include <string>
#include <vector>

#include "open_tiles.hpp"

namespace nearmesh {

class WorldSource {
 public:
  /// Errors: those of WorldFolder::open(), and of its root page.
  [[nodiscard]] static Result<std::unique_ptr<WorldSource>> open(const std::string& folder);

  [[nodiscard]] const WorldFolder& folder() const { return folder_; }
  /// Whether a page or tile of that content lies there. Cost: a look at the disk.
  [[nodiscard]] bool has(const ContentHash& content) const;
  /// A page, or a tile's header, in pieces (content_bytes.hpp). Errors: kNotFound; kIo, kCorrupt, kConflict, naming the file.
  [[nodiscard]] Result<std::vector<std::vector<std::uint8_t>>> pieces(const ContentHash& content);
  /// Errors: those of OpenTiles::open().
  [[nodiscard]] Result<std::shared_ptr<ModelFile>> tile(const ContentHash& content) {
    return tiles_.open(content);
  }
  /// Those that whoever has no work for them is to let go of (OpenTiles::held()).
  [[nodiscard]] std::vector<ContentHash> held_tiles() const { return tiles_.held(); }

 private:
  explicit WorldSource(WorldFolder folder) : folder_(std::move(folder)), tiles_(folder_) {}

  const WorldFolder folder_;
  OpenTiles tiles_;
};

}  // namespace nearmesh
