// SPDX-License-Identifier: Apache-2.0
#include "detail_folder.hpp"

#include <algorithm>
#include <filesystem>
#include <system_error>

#include "core/world/open_tiles.hpp"

namespace nearmesh::subscriber {

Result<std::unique_ptr<DetailFolder>> DetailFolder::open(const std::string& folder) {
  Result<std::unique_ptr<ModelFolder>> models = ModelFolder::open(folder);
  NEARMESH_RETURN_IF_ERROR(models);
  std::unique_ptr<DetailFolder> detail(new DetailFolder);
  detail->models_ = std::move(models).value();
  detail->complaints_ = detail->models_->complaints();
  std::vector<std::string> folders{folder};
  std::error_code error;
  for (std::filesystem::directory_iterator at(folder, error), end; !error && at != end;
       at.increment(error))
    if (at->is_directory()) folders.push_back(at->path().string());
  if (error) return Status{StatusCode::kIo, folder + ": cannot read: " + error.message()};
  std::sort(folders.begin(), folders.end());
  for (const std::string& one : folders) {
    Result<WorldFolder> world = WorldFolder::open(one);
    if (world.is_ok()) {
      detail->worlds_.push_back(std::move(world).value());
    } else if (world.status().code() != StatusCode::kNotFound) {
      detail->complaints_.push_back(world.status().message());
    }
  }
  return detail;
}

bool DetailFolder::lend(const ContentHash& content_hash,
                        const std::function<void(ModelFile&)>& use) {
  if (models_->lend(content_hash, use)) return true;
  for (const WorldFolder& world : worlds_) {
    Result<ModelFile> tile = open_tile(world, content_hash, &tables_);
    if (!tile.is_ok()) continue;
    use(tile.value());
    return true;
  }
  return false;
}

const WorldRecord* DetailFolder::world(const ContentHash& name) const {
  for (const WorldFolder& world : worlds_)
    if (world.name() == name) return &world.world();
  return nullptr;
}

std::optional<WorldPage> DetailFolder::page(const ContentHash& content) const {
  for (const WorldFolder& world : worlds_) {
    const auto bytes = world.page_bytes(content);
    if (!bytes.is_ok()) continue;
    if (Result<WorldPage> page = decode_page(bytes.value()); page.is_ok())
      return std::move(page).value();
  }
  return std::nullopt;
}

}  // namespace nearmesh::subscriber
