// SPDX-License-Identifier: Apache-2.0
#pragma once
// What whoever serves a world answers from: its pages, and tiles that are opened when they are
// asked for.

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
  /// A page, or a tile's header, in pieces (content_bytes.hpp). Errors: kNotFound; kIo, kCorrupt,
  /// kConflict, naming the file.
  [[nodiscard]] Result<std::vector<std::vector<std::uint8_t>>> pieces(const ContentHash& content);
  /// `let_go`: is called for each tile that would be closed by now if nobody held it
  /// (OpenTiles::held()); who has no work for it is to let go. Errors: those of OpenTiles::open().
  template <class LetGo>
  [[nodiscard]] Result<std::shared_ptr<ModelFile>> tile(const ContentHash& content,
                                                        const LetGo& let_go) {
    auto tile = tiles_.open(content);
    for (const ContentHash& held : tiles_.held()) let_go(held);
    return tile;
  }

 private:
  explicit WorldSource(WorldFolder folder) : folder_(std::move(folder)), tiles_(folder_) {}

  const WorldFolder folder_;
  OpenTiles tiles_;
};

}  // namespace nearmesh
