// SPDX-License-Identifier: Apache-2.0
#pragma once
// The models and worlds of a folder, by content: from them a peer's replicas are made where the
// recording lacks its batches, and its pages found. Takes a folder, lends files.

#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "core/spm/coding_sets.hpp"
#include "core/spm/model_folder.hpp"
#include "core/world/world_folder.hpp"

namespace nearmesh::subscriber {

/// Threads: any; one file is lent at a time, and tiles of worlds are opened for as long as they are
/// lent.
class DetailFolder {
 public:
  /// All files of the folder whose names end with .spm, and all worlds in it: its own folders, or
  /// it is one itself.
  /// Errors: kNotFound where there is no such folder; kIo.
  [[nodiscard]] static Result<std::unique_ptr<DetailFolder>> open(const std::string& folder);

  /// Calls use(file) with the model or tile of this content. Out: false where there is none.
  [[nodiscard]] bool lend(const ContentHash& content_hash,
                          const std::function<void(ModelFile&)>& use);
  /// Null where no world has that name.
  [[nodiscard]] const WorldRecord* world(const ContentHash& name) const;
  [[nodiscard]] std::optional<WorldPage> page(const ContentHash& content) const;
  /// One line each: files that cannot be read.
  [[nodiscard]] const std::vector<std::string>& complaints() const { return complaints_; }

 private:
  DetailFolder() = default;

  std::unique_ptr<ModelFolder> models_;
  std::vector<WorldFolder> worlds_;
  SharedTables tables_;  // of their tiles
  std::vector<std::string> complaints_;
};

}  // namespace nearmesh::subscriber
