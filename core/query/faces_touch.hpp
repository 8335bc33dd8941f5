// SPDX-License-Identifier: Apache-2.0
#pragma once
// One pair of faces by name: for who checks what an answer lists.

#include "nearmesh/core/abtree/detail/ab_tree.hpp"
#include "nearmesh/core/query/query.hpp"

namespace nearmesh {

/// Whether both are exact faces of the meshes as they are, and touch where they are placed. Names
/// may be anything. Exact.
[[nodiscard]] bool faces_touch(const ActiveMesh& a, const PosedFrame& frame_a,
                               const FaceKey& face_a, const ActiveMesh& b,
                               const PosedFrame& frame_b, const FaceKey& face_b);

}  // namespace nearmesh
