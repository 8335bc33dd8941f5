// SPDX-License-Identifier: Apache-2.0
#pragma once
// What a reader hands over: the parts of a file, each in its own frame, and what the file says of
// its units and axes.

#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "nearmesh/core/base/mesh_origin.hpp"
#include "nearmesh/core/mesh/indexed_mesh.hpp"
#include "nearmesh/core/meshio/terrain.hpp"

namespace nearmesh::meshio {

/// x' = m[.][0..2] x + m[.][3], in double: chains of nodes must not lose what the file kept.
struct Transform {
  double m[3][4] = {{1, 0, 0, 0}, {0, 1, 0, 0}, {0, 0, 1, 0}};

  [[nodiscard]] std::array<double, 3> apply(const std::array<double, 3>& p) const {
    std::array<double, 3> out{};
    for (std::size_t r = 0; r < 3; ++r)
      out[r] = m[r][0] * p[0] + m[r][1] * p[1] + m[r][2] * p[2] + m[r][3];
    return out;
  }
  [[nodiscard]] bool mirrors() const {
    return m[0][0] * (m[1][1] * m[2][2] - m[1][2] * m[2][1]) -
               m[0][1] * (m[1][0] * m[2][2] - m[1][2] * m[2][0]) +
               m[0][2] * (m[1][0] * m[2][1] - m[1][1] * m[2][0]) <
           0;
  }
  [[nodiscard]] bool is_identity() const {
    for (std::size_t r = 0; r < 3; ++r)
      for (std::size_t c = 0; c < 4; ++c)
        if (m[r][c] != (r == c ? 1.0 : 0.0)) return false;
    return true;
  }
};

inline Transform compose(const Transform& outer, const Transform& inner) {
  Transform result;
  for (std::size_t r = 0; r < 3; ++r) {
    for (std::size_t c = 0; c < 4; ++c) {
      result.m[r][c] = c == 3 ? outer.m[r][3] : 0.0;
      for (std::size_t k = 0; k < 3; ++k) result.m[r][c] += outer.m[r][k] * inner.m[k][c];
    }
  }
  return result;
}

/// Units and axes as the file or its format has them.
struct FileConvention {
  double unit_m = 1;
  OriginSource unit_source = OriginSource::kNobody;
  UpAxis up = UpAxis::kUnknown;
  OriginSource up_source = OriginSource::kNobody;
  bool is_known = true;        ///< what the reader does to coordinates is known and undone
  bool unit_is_fixed = false;  ///< stated, by the file or by a format that allows one unit alone
};

/// A node, or an object of an OBJ file. Its faces and positions follow those of the part before.
struct ScenePart {
  std::string name;
  Transform to_file;  ///< from the part's frame to the file's, both in units of the file
  std::uint64_t position_count = 0, face_count = 0;
};

struct SceneMesh {
  IndexedMesh mesh;  ///< positions in units of the file, each in the frame of its part
  /// Empty: the mesh is one part without a name, in the file's frame.
  std::vector<ScenePart> parts;
  FileConvention convention;
  std::optional<ImportedTerrain> terrain;  ///< it was a grid of heights
};

}  // namespace nearmesh::meshio
