// SPDX-License-Identifier: Apache-2.0
#include "world_source.hpp"

#include <filesystem>

#include "content_bytes.hpp"

namespace nearmesh {

Result<std::unique_ptr<WorldSource>> WorldSource::open(const std::string& folder) {
  Result<WorldFolder> opened = WorldFolder::open(folder);
  NEARMESH_RETURN_IF_ERROR(opened);
  NEARMESH_RETURN_IF_ERROR(opened.value().root());
  return std::unique_ptr<WorldSource>(new WorldSource(std::move(opened).value()));
}

bool WorldSource::has(const ContentHash& content) const {
  std::error_code error;
  return std::filesystem::exists(folder_.page_path(content), error) ||
         std::filesystem::exists(folder_.tile_path(content), error);
}

Result<std::vector<std::vector<std::uint8_t>>> WorldSource::pieces(const ContentHash& content) {
  const auto page = folder_.page_bytes(content);
  if (page.is_ok()) return content_pieces(page.value());
  if (page.status().code() != StatusCode::kNotFound) return page.status();
  const auto tile = tiles_.open(content);
  NEARMESH_RETURN_IF_ERROR(tile);
  return content_pieces(tile.value()->header_bytes());
}

}  // namespace nearmesh
