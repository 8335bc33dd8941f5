// SPDX-License-Identifier: Apache-2.0
#pragma once
// What a glTF file demands of its reader. Assimp skips demands that it does not know, and gives
// what is left as a mesh.

#include <string>

#include "nearmesh/core/base/status.hpp"

namespace nearmesh::meshio {

/// Whether all that a glTF file demands (extensionsRequired) leaves its geometry alone. A file of
/// another format demands nothing.
/// Cost: linear; the file is held, its JSON is not. Errors, the message without the path:
/// kUnsupported (an extension that changes geometry, or may), kCorrupt (no JSON; demands that are
/// no list of names), kIo.
[[nodiscard]] Status check_gltf_demands(const std::string& path);

}  // namespace nearmesh::meshio
