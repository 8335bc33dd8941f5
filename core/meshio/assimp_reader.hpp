// SPDX-License-Identifier: Apache-2.0
#pragma once
// The one place that calls assimp. Runs in the child process (child.hpp); may crash, hang or throw
// on hostile files, and nobody minds.

#include <string>

#include "scene_mesh.hpp"

namespace nearmesh::meshio {

/// All triangles of the file, node after node, each in its node's frame, in the file's units. What
/// assimp's reader turns or scales of its own accord is undone where it is known (formats.hpp).
/// In: node: only the nodes of this name and what hangs on them; empty: all. Errors, the message
/// without the path: kUnsupported (no reader; an extension of glTF that assimp would skip; a unit
/// that is not known here), kCorrupt (assimp refuses, or gives indices out of range; a unit that is
/// none), kNotFound (no such node).
[[nodiscard]] Result<SceneMesh> read_with_assimp(const std::string& path, const std::string& node);

}  // namespace nearmesh::meshio
