// SPDX-License-Identifier: Apache-2.0
#include "open_tiles.hpp"

namespace nearmesh {

Result<ModelFile> open_tile(const WorldFolder& folder, const ContentHash& content) {
  const std::string path = folder.tile_path(content);
  Result<ModelFile> file = ModelFile::open(path);
  NEARMESH_RETURN_IF_ERROR(file);
  if (file.value().content_hash() != content)
    return Status(StatusCode::kConflict, path +
                                             ": expected the content that its name says, found " +
                                             to_hex(file.value().content_hash()));
  if (const Status grid = check_tile_grid(file.value().header().grid, folder.world());
      !grid.is_ok())
    return Status(grid.code(), path + ": " + grid.message());
  return file;
}

Result<std::shared_ptr<ModelFile>> OpenTiles::open(const ContentHash& content) {
  if (const auto at = by_content_.find(content); at != by_content_.end()) {
    tiles_.splice(tiles_.begin(), tiles_, at->second);
    return tiles_.front().second;
  }
  Result<ModelFile> file = open_tile(folder_, content);
  NEARMESH_RETURN_IF_ERROR(file);
  while (tiles_.size() >= most_) {
    by_content_.erase(tiles_.back().first);
    tiles_.pop_back();
  }
  tiles_.emplace_front(content, std::make_shared<ModelFile>(std::move(file).value()));
  by_content_[content] = tiles_.begin();
  return tiles_.front().second;
}

}  // namespace nearmesh
