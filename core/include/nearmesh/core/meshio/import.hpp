// SPDX-License-Identifier: Apache-2.0
#pragma once
// API (docs/api.md).
// Reads any mesh file: PLY, STL, OFF and OBJ with readers of our own, every other format through
// assimp. The only room that knows assimp. Gives the IndexedMesh that clean_mesh takes.

#include <string>

#include "nearmesh/core/mesh/indexed_mesh.hpp"

namespace nearmesh {

/// Reads a mesh file into triangles in file order. Polygons are cut into corners - 2 triangles each
/// (a fan where convex, ears where concave); points and edges are left out. PLY, STL, OFF, OBJ:
/// coordinates as the file has them, in double; vertices in file order, nothing merged (STL: three
/// a facet). Others: assimp's scene, node after node, transforms applied, mirrored nodes turned
/// outward again; coordinates pass through its single precision. Truncated, inconsistent or hostile
/// files are refused, naming file, place, expected, found: kIo (cannot be read or held in memory),
/// kCorrupt (bytes contradict their header or their format; a reader that crashed or took too
/// long), kUnsupported (no reader), kInvalidArgument (no faces; a coordinate not finite, in text
/// any, in binary one that a face uses). No exception leaves. Assimp runs in a forked child process
/// under a limit of memory (200 times the file and 512 MiB, at most 8 GiB) and of time (60 s and 2
/// s a MiB), so that a crash inside it is an error message here. Cost: linear; the file is held
/// beside the mesh while it is read. Threads: any, also at once.
[[nodiscard]] Result<IndexedMesh> import_mesh(const std::string& path);

}  // namespace nearmesh
