// SPDX-License-Identifier: Apache-2.0
#pragma once
// The bytes of a .spm file (layout: core/spm_format.md), for those who write files of many models,
// or name a file by its content.

#include <string>

#include "nearmesh/core/spm/write_model_file.hpp"

namespace nearmesh {

struct EncodedModel {
  std::string bytes;  ///< of all the file
  WrittenModel written;
};

/// As write_model_file(), which writes them.
[[nodiscard]] EncodedModel encode_model_file(const SpmHeader& header, const SplitStore& store,
                                             std::span<const FaceNumber> numbers, unsigned threads,
                                             const MeshOrigin& origin);

}  // namespace nearmesh
