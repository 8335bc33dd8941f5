// SPDX-License-Identifier: Apache-2.0
#include "open_tiles.hpp"

#include <sys/resource.h>

#include <algorithm>

#include "core/spm/open_sharing.hpp"

namespace nearmesh {
namespace {

std::size_t half_of_descriptors() {
  rlimit limit{};
  if (::getrlimit(RLIMIT_NOFILE, &limit) != 0) return 1;
  return static_cast<std::size_t>(limit.rlim_cur / 2);
}

}  // namespace

OpenTiles::OpenTiles(const WorldFolder& folder, std::size_t most_tiles, std::size_t most_splits)
    : folder_(folder),
      most_tiles_(std::min(most_tiles, half_of_descriptors())),
      most_splits_(most_splits) {}

Result<ModelFile> open_tile(const WorldFolder& folder, const ContentHash& content,
                            SharedTables* shared) {
  const std::string path = folder.tile_path(content);
  Result<ModelFile> file = open_sharing(path, shared);
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
  } else {
    std::shared_ptr<ModelFile> tile;
    if (const auto held = held_.extract(content)) tile = held.mapped().lock();
    if (tile == nullptr) {
      Result<ModelFile> file = open_tile(folder_, content, &tables_);
      NEARMESH_RETURN_IF_ERROR(file);
      tile = std::make_shared<ModelFile>(std::move(file).value());
    }
    tiles_.emplace_front(content, std::move(tile));
    by_content_[content] = tiles_.begin();
  }
  close_unused();
  return tiles_.front().second;
}

std::vector<ContentHash> OpenTiles::held() const {
  std::vector<ContentHash> contents;
  for (const auto& [content, file] : held_)
    if (!file.expired()) contents.push_back(content);
  return contents;
}

/// What they hold has grown since they were opened.
void OpenTiles::close_unused() {
  std::size_t splits = 0;
  for (const auto& [content, file] : tiles_) splits += file->store().known_splits();
  while (tiles_.size() > 1 && (tiles_.size() > most_tiles_ || splits > most_splits_)) {
    const auto& [content, file] = tiles_.back();
    splits -= file->store().known_splits();
    if (file.use_count() > 1) held_[content] = file;
    by_content_.erase(content);
    tiles_.pop_back();
  }
  std::erase_if(held_, [](const auto& held) { return held.second.expired(); });
}

}  // namespace nearmesh
