// SPDX-License-Identifier: Apache-2.0
#include "faces_touch.hpp"

#include <optional>

#include "core/base/float_guard.hpp"
#include "core/geometry/triangle_overlap.hpp"

namespace nearmesh {
namespace {

/// None where no such face is held in its final place.
std::optional<LatticeTriangle> posed_face(const ActiveMesh& mesh, const PosedFrame& frame,
                                          const FaceKey& key) {
  const SplitStore& store = mesh.store();
  if (key.split.is_valid() &&
      (key.split.value >= store.vertex_count() || !store.is_known(key.split)))
    return std::nullopt;
  const std::size_t count =
      key.split.is_valid() ? store.faces(key.split).size() : store.base_faces().size();
  if (key.index >= count) return std::nullopt;
  const SplitFace face = store.face(key);
  if (!mesh.is_exact(face)) return std::nullopt;
  std::array<GridPoint, 3> corners;
  for (std::size_t k = 0; k < 3; ++k) corners[k] = store.position(face.corners()[k]);
  return pose_triangle(frame, corners);
}

}  // namespace

bool faces_touch(const ActiveMesh& a, const PosedFrame& frame_a, const FaceKey& face_a,
                 const ActiveMesh& b, const PosedFrame& frame_b, const FaceKey& face_b) {
  const FloatGuard guard;
  NEARMESH_ASSERT(frame_a.lattice_exp == frame_b.lattice_exp);
  const auto posed_a = posed_face(a, frame_a, face_a);
  const auto posed_b = posed_face(b, frame_b, face_b);
  return posed_a && posed_b && triangles_overlap(*posed_a, *posed_b);
}

}  // namespace nearmesh
