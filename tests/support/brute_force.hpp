// SPDX-License-Identifier: Apache-2.0
#pragma once
// What the fast code must agree with, by trying everything.

#include <algorithm>
#include <iterator>
#include <set>

#include "core/geometry/triangle_overlap.hpp"
#include "test_models.hpp"

namespace nearmesh::test {

struct KeyedFace {
  FaceKey key;
  SplitFace face;
};

/// All faces of a complete store in canonical order.
inline std::vector<KeyedFace> all_faces(const SplitStore& store) {
  std::vector<KeyedFace> faces;
  for (std::uint32_t i = 0; i < store.base_faces().size(); ++i)
    faces.push_back({{{}, i}, store.base_faces()[i]});
  for (std::uint32_t v = 0; v < store.vertex_count(); ++v) {
    if (!store.is_known({v}) || store.is_root({v})) continue;
    for (std::uint32_t i = 0; i < store.faces({v}).size(); ++i)
      faces.push_back({{{v}, i}, store.faces({v})[i]});
  }
  return faces;
}

/// Boxes of original faces: by vertex, and of any interval of vertices. From a complete store.
class TrueBoxes {
 public:
  explicit TrueBoxes(const SplitStore& store)
      : of_vertex_(store.vertex_count()), corners_(store.vertex_count()) {
    for (const KeyedFace& keyed : all_faces(store)) {
      GridBox box;
      for (const VertexId corner : keyed.face.corners()) box.add(store.position(corner));
      for (const VertexId corner : keyed.face.corners()) {
        of_vertex_[corner.value].add(box);
        for (const VertexId other : keyed.face.corners())
          corners_[corner.value].push_back(store.position(other));
      }
    }
  }
  /// Of all faces that touch a vertex of the node.
  template <class Visit>
  void for_each_corner(NodeSpan node, const Visit& visit) const {
    for (std::uint32_t v = node.begin(); v < node.end(); ++v)
      for (const GridPoint& p : corners_[v]) visit(p);
  }
  [[nodiscard]] GridBox of(NodeSpan node) const {
    GridBox box;
    for (std::uint32_t v = node.begin(); v < node.end(); ++v)
      if (!of_vertex_[v].is_empty()) box.add(of_vertex_[v]);
    return box;
  }

 private:
  std::vector<GridBox> of_vertex_;
  std::vector<std::vector<GridPoint>> corners_;
};

/// The active ids, by asking each.
inline std::set<std::uint32_t> active_ids(const ActiveMesh& mesh) {
  std::set<std::uint32_t> ids;
  for (std::uint32_t v = 0; v < mesh.store().vertex_count(); ++v)
    if (mesh.is_active({v})) ids.insert(v);
  return ids;
}

/// The largest active id <= v.
inline VertexId stand_in(const std::set<std::uint32_t>& active, VertexId v) {
  return {*std::prev(active.upper_bound(v.value))};
}

/// Nodes of two or more vertices that active vertices stand for.
inline std::vector<NodeSpan> unresolved_nodes(const ActiveMesh& mesh) {
  std::vector<NodeSpan> nodes;
  const std::set<std::uint32_t> active = active_ids(mesh);
  for (auto at = active.begin(); at != active.end(); ++at) {
    const auto next = std::next(at);
    const std::uint32_t end = next == active.end() ? mesh.store().vertex_count() : *next;
    if (end - *at > 1) nodes.push_back({{*at}, end - *at});
  }
  return nodes;
}

/// Faces whose three corners stand for themselves alone. `faces` are those of the complete model.
inline std::vector<KeyedFace> exact_faces(const ActiveMesh& mesh,
                                          const std::vector<KeyedFace>& faces) {
  const std::set<std::uint32_t> active = active_ids(mesh);
  std::vector<KeyedFace> exact;
  const auto is_resolved = [&](VertexId v) {
    return active.contains(v.value) &&
           (active.contains(v.value + 1) || v.value + 1 == mesh.store().vertex_count());
  };
  for (const KeyedFace& keyed : faces) {
    const auto corners = keyed.face.corners();
    if (std::all_of(corners.begin(), corners.end(), is_resolved)) exact.push_back(keyed);
  }
  return exact;
}

inline LatticeTriangle posed(const SplitStore& store, const PosedFrame& frame,
                             const SplitFace& face) {
  LatticeTriangle triangle;
  for (std::size_t k = 0; k < 3; ++k)
    triangle[k] = pose_point(frame, store.position(face.corners()[k]));
  return triangle;
}

/// Every touching pair, ascending.
inline std::vector<FacePair> touching_pairs(const SplitStore& a, const PosedFrame& frame_a,
                                            const std::vector<KeyedFace>& faces_a,
                                            const SplitStore& b, const PosedFrame& frame_b,
                                            const std::vector<KeyedFace>& faces_b) {
  std::vector<LatticeTriangle> posed_b;
  for (const KeyedFace& face : faces_b) posed_b.push_back(posed(b, frame_b, face.face));
  std::vector<FacePair> pairs;
  for (const KeyedFace& face : faces_a) {
    const LatticeTriangle posed_a = posed(a, frame_a, face.face);
    for (std::size_t j = 0; j < faces_b.size(); ++j)
      if (triangles_overlap(posed_a, posed_b[j])) pairs.push_back({face.key, faces_b[j].key});
  }
  std::sort(pairs.begin(), pairs.end());
  return pairs;
}

/// The full mesh as a tree over fixed triangles: the reference where brute force is too slow.
struct FullModel {
  explicit FullModel(const BakedModel& model) {
    std::optional<TriangleTree> built = build_full_tree(model.header, model.store);
    EXPECT_TRUE(built.has_value());
    if (built) tree = *std::move(built);
  }
  TriangleTree tree;
};

/// What a tree holds, by walking all of it.
struct TreeContent {
  std::vector<FaceKey> faces;
  std::vector<NodeSpan> unresolved;
};

/// Whether the entry's slab, where it has one, holds the point.
inline bool slab_holds(const TreeEntry& entry, const GridPoint& p) {
  std::int64_t twice_along = 0;
  for (int k = 0; k < 3; ++k)
    twice_along += entry.slab.normal[static_cast<std::size_t>(k)] *
                   (2 * std::int64_t{p[k]} - entry.box.lo[k] - entry.box.hi[k]);
  const double along = 0.5 * static_cast<double>(twice_along);
  return static_cast<double>(entry.slab.from) <= along &&
         along <= static_cast<double>(entry.slab.to);
}

/// Checks on the way that every entry's box and slab enclose the faces below it and all original
/// faces that touch a vertex below its unresolved nodes.
inline TreeContent walk_tree(const TreeView& view, const TrueBoxes& boxes) {
  TreeContent content;
  struct Step {
    TreeEntry part;
    std::vector<TreeEntry> above;
  };
  std::vector<Step> stack{{view.root(), {}}};
  while (!stack.empty()) {
    Step step = std::move(stack.back());
    stack.pop_back();
    const TreeEntry& part = step.part;
    step.above.push_back(part);
    const auto expect_inside = [&](const GridBox& box) {
      for (const TreeEntry& outer : step.above) EXPECT_TRUE(outer.box.contains(box));
    };
    if (part.kind() != TreeEntry::Kind::kEmpty) expect_inside(part.box);
    switch (part.kind()) {
      case TreeEntry::Kind::kInner:
        view.for_each_child(part, [&](const TreeEntry& child) {
          stack.push_back({child, step.above});
        });
        break;
      case TreeEntry::Kind::kFaces:
        view.for_each_face(part, [&](const TreeFace& face) {
          GridBox box;
          for (const GridPoint& corner : face.corners) {
            box.add(corner);
            for (const TreeEntry& outer : step.above) EXPECT_TRUE(slab_holds(outer, corner));
          }
          expect_inside(box);
          content.faces.push_back(face.key);
        });
        break;
      case TreeEntry::Kind::kUnresolved:
        expect_inside(boxes.of(part.unresolved_node()));
        for (int corner = 0; corner < 8; ++corner) {
          GridPoint p;
          for (int k = 0; k < 3; ++k)
            p[k] = (corner >> k & 1) != 0 ? part.box.hi[k] : part.box.lo[k];
          if (!slab_holds(part, p)) continue;  // nothing of the node is there
          for (const TreeEntry& outer : step.above) EXPECT_TRUE(slab_holds(outer, p));
        }
        boxes.for_each_corner(part.unresolved_node(), [&](const GridPoint& p) {
          for (const TreeEntry& outer : step.above) EXPECT_TRUE(slab_holds(outer, p));
        });
        content.unresolved.push_back(part.unresolved_node());
        break;
      case TreeEntry::Kind::kEmpty:
        break;
    }
  }
  std::sort(content.faces.begin(), content.faces.end());
  std::sort(content.unresolved.begin(), content.unresolved.end());
  return content;
}

/// Keys of faces, ascending (invalid, i.e. base faces, last).
inline std::vector<FaceKey> keys_of(const std::vector<KeyedFace>& faces) {
  std::vector<FaceKey> keys;
  for (const KeyedFace& keyed : faces) keys.push_back(keyed.key);
  std::sort(keys.begin(), keys.end());
  return keys;
}

}  // namespace nearmesh::test
