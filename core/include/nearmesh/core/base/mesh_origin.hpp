// SPDX-License-Identifier: Apache-2.0
#pragma once
// API (docs/api.md).
// Where a model's metres and its axes come from: import says it, the .spm file keeps it beside the
// model, `info` prints it.

#include <cstdint>

namespace nearmesh {

/// Who said how long the file's unit is, or which of its axes is up.
enum class OriginSource : std::uint8_t {
  kNobody,  ///< nothing says it
  kFile,    ///< this file states it
  kFormat,  ///< the format fixes it or has it as default
  kOption,  ///< the caller said it
};

enum class UpAxis : std::uint8_t { kUnknown, kX, kY, kZ };

struct MeshOrigin {
  double unit_m = 1;  ///< one unit of the file; a metre where nobody says
  double scale = 1;   ///< asked for on top
  OriginSource unit_source = OriginSource::kNobody;
  UpAxis up = UpAxis::kUnknown;  ///< in the file
  OriginSource up_source = OriginSource::kNobody;
  /// The caller said which axis is up, so z is up in the model. Otherwise nothing was turned.
  bool z_up = false;

  friend bool operator==(const MeshOrigin&, const MeshOrigin&) = default;
};

}  // namespace nearmesh
