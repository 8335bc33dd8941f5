// SPDX-License-Identifier: Apache-2.0
#pragma once
// Reads any format assimp reads. The only room that knows assimp.

#include <string>

#include "nearmesh/core/mesh/indexed_mesh.hpp"

namespace nearmesh {

/// Reads a mesh file into triangles in file order (polygons fan into triangles; nodes' transforms are
/// applied; several meshes follow one another). Coordinates pass through assimp's single precision.
/// Truncated, inconsistent or hostile files are refused: kIo (cannot be read), kCorrupt (bytes and
/// header disagree), kUnsupported (no reader), kInvalidArgument (no faces, not finite), each naming file, place, expected, found.
/// The reader runs in a child process under a memory and time limit, so that a crash inside it is an error message
/// here. Cost: the file is held twice while it is read.
[[nodiscard]] Result<IndexedMesh> import_mesh(const std::string& path);

}  // namespace nearmesh
