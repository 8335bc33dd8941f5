// SPDX-License-Identifier: Apache-2.0
#pragma once
// From the parts of a file, each in its own frame, to meshes in metres: all in the file's frame, or
// node by node with the motions that place them.

#include <string>
#include <string_view>
#include <vector>

#include "nearmesh/core/meshio/import.hpp"
#include "scene_mesh.hpp"

namespace nearmesh::meshio {

/// From the file's frame and units to the model's.
[[nodiscard]] Transform to_model(const MeshOrigin& origin);

/// Moves positions, and turns the faces of a mirror outward again.
void transform_part(IndexedMesh& mesh, std::size_t position, std::size_t position_count,
                    std::size_t face, std::size_t face_count, const Transform& transform);

/// Each part with faces in its own frame; where that is squeezed or mirrored, so is the mesh.
/// Indices must be in range. `name`: of a file without parts.
[[nodiscard]] std::vector<ImportedNode> take_apart(const SceneMesh& scene,
                                                   const Transform& to_model,
                                                   const std::string& name);

/// An OBJ with a part for each object; those of one name are one. `wanted`: this object alone;
/// empty: all.
/// Errors: those of read_obj, and kNotFound.
[[nodiscard]] Result<SceneMesh> read_obj_objects(std::string_view bytes, const std::string& wanted);

}  // namespace nearmesh::meshio
