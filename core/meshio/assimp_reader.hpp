// SPDX-License-Identifier: Apache-2.0
#pragma once
// The one place that calls assimp. Runs in the child process (child.hpp); may crash, hang or throw
// on hostile files, and nobody minds.

#include <string>

#include "nearmesh/core/mesh/detail/indexed_mesh.hpp"

namespace nearmesh::meshio {

/// All triangles of the file, node after node, transformed into the file's frame.
/// Errors, the message without the path: kUnsupported (no reader), kCorrupt (assimp refuses, or
/// gives indices out of range), kInvalidArgument (no faces, or a face's corner not finite).
[[nodiscard]] Result<IndexedMesh> read_with_assimp(const std::string& path);

}  // namespace nearmesh::meshio
