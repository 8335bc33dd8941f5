// SPDX-License-Identifier: Apache-2.0
#pragma once
// API (docs/api.md).
// A mesh as it came from a file: doubles, faces by vertex index, nothing cleaned.
// Stands between meshio (which makes it) and clean.hpp (which turns it into integer geometry).

#include <array>
#include <cstdint>
#include <string>
#include <vector>

#include "nearmesh/core/base/status.hpp"

namespace nearmesh {

/// Triangles in file order: the face's place in `faces` is its FaceId for ever after.
struct IndexedMesh {
  std::vector<std::array<double, 3>> positions_m;
  std::vector<std::array<std::uint32_t, 3>> faces;
};

/// Writes a binary little-endian PLY with double coordinates, over an existing PLY file, which a
/// failure leaves as it was. Errors: kIo with path and reason, kConflict where something else is
/// there.
[[nodiscard]] Status write_ply(const IndexedMesh& mesh, const std::string& path);

}  // namespace nearmesh
