// SPDX-License-Identifier: Apache-2.0
#include "touching_faces.hpp"

#include <algorithm>

namespace nearmesh {

TouchingFaces collect_faces(const TreeView& tree, const PosedFrame& frame,
                            const std::vector<FacePair>& pairs, FaceKey FacePair::*side) {
  TouchingFaces faces;
  for (const FacePair& pair : pairs) faces.keys.push_back(pair.*side);
  std::sort(faces.keys.begin(), faces.keys.end());
  faces.keys.erase(std::unique(faces.keys.begin(), faces.keys.end()), faces.keys.end());
  const auto place_of = [&faces](const FaceKey& key) {
    return std::lower_bound(faces.keys.begin(), faces.keys.end(), key) - faces.keys.begin();
  };
  for (const FacePair& pair : pairs)
    faces.of_pair.push_back(static_cast<std::uint32_t>(place_of(pair.*side)));
  faces.corners.resize(faces.keys.size());
  if (tree.store != nullptr) {
    for (std::size_t i = 0; i < faces.keys.size(); ++i) {
      const std::array<VertexId, 3> corners = tree.store->face(faces.keys[i]).corners();
      for (std::size_t k = 0; k < 3; ++k) faces.corners[i][k] = tree.store->position(corners[k]);
    }
  } else {
    std::size_t found = 0;
    std::vector<TreeEntry> stack{tree.root()};
    while (!stack.empty()) {
      const TreeEntry part = stack.back();
      stack.pop_back();
      if (part.kind() == TreeEntry::Kind::kInner)
        tree.for_each_child(part, [&](const TreeEntry& child) { stack.push_back(child); });
      if (part.kind() != TreeEntry::Kind::kFaces) continue;
      tree.for_each_face(part, [&](const TreeFace& face) {
        const auto at = static_cast<std::size_t>(place_of(face.key));
        if (at == faces.keys.size() || faces.keys[at] != face.key) return;
        faces.corners[at] = face.corners;
        ++found;
      });
    }
    NEARMESH_ASSERT(found == faces.keys.size());
  }
  for (const auto& corners : faces.corners) faces.posed.push_back(pose_triangle(frame, corners));
  return faces;
}

}  // namespace nearmesh
