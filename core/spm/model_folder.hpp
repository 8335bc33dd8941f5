// SPDX-License-Identifier: Apache-2.0
#pragma once
// The model files of a folder, by content: from them a peer's replica is made where the recording
// lacks its batches. Takes a folder, lends files.

#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <vector>

#include "nearmesh/core/spm/model_file.hpp"

namespace nearmesh {

/// Threads: any; one file is lent at a time.
class ModelFolder {
 public:
  /// All files of the folder, not of folders in it, whose names end with .spm.
  /// Errors: kNotFound where there is no such folder; kIo.
  [[nodiscard]] static Result<std::unique_ptr<ModelFolder>> open(const std::string& folder);

  /// Calls use(file) with the one that has this content. Out: false where there is none.
  [[nodiscard]] bool lend(const ContentHash& content_hash,
                          const std::function<void(ModelFile&)>& use);
  /// Where the file with this content is; none: no file has it. Where several have it, the first by
  /// name.
  [[nodiscard]] std::optional<std::string> path_of(const ContentHash& content_hash) const;
  /// One line each: files that cannot be read.
  [[nodiscard]] const std::vector<std::string>& complaints() const { return complaints_; }

 private:
  ModelFolder() = default;

  std::mutex mutex_;
  std::map<ContentHash, ModelFile> files_;
  std::vector<std::string> complaints_;
};

}  // namespace nearmesh
