// SPDX-License-Identifier: Apache-2.0
#pragma once
// API (docs/api.md).
// Writes the .spm file (layout: core/spm_format.md).

#include <span>
#include <string>

#include "nearmesh/core/spm/model_file.hpp"

namespace nearmesh {

struct WrittenModel {
  std::uint64_t file_bytes = 0, header_bytes = 0, block_bytes = 0, blocks = 0;
  ContentHash content_hash;
};

/// Writes a complete model. `numbers` in canonical order (FaceNumbering). The file appears under
/// its name only when it is whole, the same for any number of threads, 0 being one for each core
/// (written beside it and renamed). Errors: kIo with path and reason, kConflict where something is
/// there that is no model; what is there is then untouched.
[[nodiscard]] Result<WrittenModel> write_model_file(const SpmHeader& header,
                                                    const SplitStore& store,
                                                    std::span<const FaceNumber> numbers,
                                                    const std::string& path, unsigned threads = 0,
                                                    const MeshOrigin& origin = {});

}  // namespace nearmesh
