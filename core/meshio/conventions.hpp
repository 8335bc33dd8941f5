// SPDX-License-Identifier: Apache-2.0
#pragma once
// Units and axes of a file that assimp has read: what it says of them, what assimp made of that.

#include <assimp/scene.h>

#include <string>
#include <string_view>

#include "scene_mesh.hpp"

namespace nearmesh::meshio {

struct ReadConvention {
  FileConvention file;
  /// The root's transform is left out: assimp's own, a turn or a scale, where the file has none, or
  /// the turn of our own glTF.
  bool leaves_out_root = false;
};

/// `importer`: assimp's name of the reader. `path`: what it read, looked into where assimp hides
/// what the file says. Errors, the message without the path: kCorrupt (a unit that the format does
/// not have), kUnsupported (one that it has, and that is not known here).
[[nodiscard]] Result<ReadConvention> find_convention(std::string_view importer,
                                                     const aiScene& scene, const std::string& path);

}  // namespace nearmesh::meshio
