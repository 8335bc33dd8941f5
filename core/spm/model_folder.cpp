// SPDX-License-Identifier: Apache-2.0
#include "model_folder.hpp"

#include <algorithm>
#include <filesystem>
#include <system_error>

namespace nearmesh {

Result<std::unique_ptr<ModelFolder>> ModelFolder::open(const std::string& folder) {
  std::error_code error;
  if (!std::filesystem::is_directory(folder, error))
    return Status{StatusCode::kNotFound, folder + ": expected a folder with .spm files"};
  std::vector<std::string> paths;
  for (std::filesystem::directory_iterator at(folder, error), end; !error && at != end;
       at.increment(error))
    if (at->path().extension() == ".spm") paths.push_back(at->path().string());
  if (error) return Status{StatusCode::kIo, folder + ": cannot read: " + error.message()};
  std::sort(paths.begin(), paths.end());
  std::unique_ptr<ModelFolder> models(new ModelFolder);
  for (const std::string& path : paths) {
    Result<ModelFile> file = ModelFile::open(path);
    if (file.is_ok()) {
      const ContentHash content_hash = file.value().content_hash();
      models->files_.emplace(content_hash, std::move(file).value());
    } else {
      models->complaints_.push_back(file.status().message());
    }
  }
  return models;
}

bool ModelFolder::lend(const ContentHash& content_hash,
                       const std::function<void(ModelFile&)>& use) {
  const std::lock_guard lock(mutex_);
  const auto at = files_.find(content_hash);
  if (at == files_.end()) return false;
  use(at->second);
  return true;
}

std::optional<std::string> ModelFolder::path_of(const ContentHash& content_hash) const {
  const auto at = files_.find(content_hash);
  if (at == files_.end()) return std::nullopt;
  return at->second.path();
}

}  // namespace nearmesh
