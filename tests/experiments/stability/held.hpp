// SPDX-License-Identifier: Apache-2.0
#pragma once
// What a library without progressive meshes is given of body a: where a part was streamed the triangles of what has
// come, else all.

#include "nearmesh_system.hpp"

namespace nearmesh::stability {

inline IndexedMesh held_of(const Case& asked) {
  if (!asked.model_a) return *asked.a.mesh;
  return held_mesh(*asked.model_a, asked.held_a);
}

}  // namespace nearmesh::stability
