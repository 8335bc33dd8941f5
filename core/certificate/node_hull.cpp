// SPDX-License-Identifier: Apache-2.0
#include "node_hull.hpp"

#include <algorithm>

namespace nearmesh {
namespace {

/// Nodes up to this size are taken face by face. Larger ones are cut into parts first: their boxes,
/// and the faces of single vertices.
constexpr std::uint32_t kExact = 512;
constexpr std::size_t kParts = 48;

class Hull {
 public:
  explicit Hull(ModelFile& file) : file_(file), store_(file.store()) {}

  Status add(NodeSpan node) {
    if (node.size <= kExact) return add_faces(node);
    // The largest part first. A vertex has no box of its own.
    std::vector<Part> parts{part_of(node)};
    std::vector<NodeSpan> small;
    while (!parts.empty() && parts.size() + small.size() < kParts) {
      std::pop_heap(parts.begin(), parts.end());
      const NodeSpan largest = parts.back().node;
      parts.pop_back();
      NEARMESH_RETURN_IF_ERROR(file_.require(largest));
      const VertexId split = store_.split_of(largest);
      for (const NodeSpan child : {largest.left_of(split), largest.right_of(split)}) {
        if (child.size == 1) {
          small.push_back(child);
        } else {
          parts.push_back(part_of(child));
          std::push_heap(parts.begin(), parts.end());
        }
      }
    }
    for (const NodeSpan& part : small) NEARMESH_RETURN_IF_ERROR(add_faces(part));
    for (const Part& part : parts) add_box(store_.box(part.node));
    return Status::ok();
  }
  /// The node's vertices, and the faces of the splits below it.
  Status add_below(NodeSpan node) {
    own_ = node;
    hull_.vertices.push_back(node.first);
    around_ = {};
    around_.add(store_.position(node.first));
    stack_.assign(1, node);
    while (!stack_.empty()) {
      const NodeSpan at = stack_.back();
      stack_.pop_back();
      if (at.size < 2) continue;
      NEARMESH_RETURN_IF_ERROR(file_.require(at));
      const VertexId split = store_.split_of(at);
      hull_.vertices.push_back(split);
      around_.add(store_.position(split));
      NEARMESH_RETURN_IF_ERROR(add_faces_of(store_.faces(split)));
      stack_.push_back(at.right_of(split));
      stack_.push_back(at.left_of(split));
    }
    return Status::ok();
  }
  NodeHull take() && {
    std::sort(hull_.vertices.begin(), hull_.vertices.end());
    hull_.vertices.erase(std::unique(hull_.vertices.begin(), hull_.vertices.end()),
                         hull_.vertices.end());
    return std::move(hull_);
  }

 private:
  struct Part {
    std::int64_t extent;
    NodeSpan node;
    bool operator<(const Part& other) const {
      return extent != other.extent ? extent < other.extent : node < other.node;
    }
  };
  [[nodiscard]] Part part_of(NodeSpan node) const { return {store_.box(node).extent(), node}; }

  void add_box(const GridBox& box) {
    for (unsigned corner = 0; corner < 8; ++corner) {
      GridPoint p;
      for (int k = 0; k < 3; ++k) p[k] = (corner >> k & 1U) != 0 ? box.hi[k] : box.lo[k];
      hull_.corners.push_back(p);
    }
  }

  /// All faces that have a corner in the node. A face belongs to the deepest split that parts two
  /// of its corners: one below the node, or above it. Only where its third corner alone is in the
  /// node does it belong to a split elsewhere, and then the node of that split has a box around the
  /// face.
  Status add_faces(NodeSpan node) {
    NEARMESH_RETURN_IF_ERROR(add_below(node));
    NEARMESH_RETURN_IF_ERROR(add_faces_of(store_.base_faces()));
    for (NodeSpan at = node, above = store_.parent_of(at); above.size != 0;
         at = above, above = store_.parent_of(at)) {
      const VertexId split = store_.split_of(above);
      NEARMESH_RETURN_IF_ERROR(add_faces_of(store_.faces(split)));
      const NodeSpan left = above.left_of(split);
      NEARMESH_RETURN_IF_ERROR(add_elsewhere(left == at ? above.right_of(split) : left));
    }
    for (const BaseRoot& root : store_.roots())
      if (!root.node.contains(node.first)) NEARMESH_RETURN_IF_ERROR(add_elsewhere(root.node));
    return Status::ok();
  }
  Status add_elsewhere(NodeSpan node) {
    stack_.assign(1, node);
    while (!stack_.empty()) {
      const NodeSpan at = stack_.back();
      stack_.pop_back();
      if (at.size < 2 || !store_.box(at).meets(around_)) continue;
      NEARMESH_RETURN_IF_ERROR(file_.require(at));
      const VertexId split = store_.split_of(at);
      NEARMESH_RETURN_IF_ERROR(add_faces_of(store_.faces(split)));
      stack_.push_back(at.right_of(split));
      stack_.push_back(at.left_of(split));
    }
    return Status::ok();
  }
  template <class Faces>
  Status add_faces_of(const Faces& faces) {
    for (const SplitFace& face : faces) {
      const std::array<VertexId, 3> corners = face.corners();
      if (std::none_of(corners.begin(), corners.end(),
                       [this](VertexId corner) { return own_.contains(corner); }))
        continue;
      for (const VertexId corner : corners)
        if (!own_.contains(corner)) NEARMESH_RETURN_IF_ERROR(add_corner(corner));
    }
    return Status::ok();
  }
  /// Its place may stand in a block that nobody has touched.
  Status add_corner(VertexId v) {
    for (NodeSpan at = store_.roots()[store_.root_index(v)].node; !store_.is_known(v);) {
      NEARMESH_RETURN_IF_ERROR(file_.require(at));
      const VertexId split = store_.split_of(at);
      at = at.left_of(split).contains(v) ? at.left_of(split) : at.right_of(split);
    }
    hull_.vertices.push_back(v);
    return Status::ok();
  }

  ModelFile& file_;
  const SplitStore& store_;
  NodeSpan own_;
  GridBox around_;  ///< the node's vertices
  std::vector<NodeSpan> stack_;
  NodeHull hull_;
};

}  // namespace

void NodeHull::add(const NodeHull& other) {
  const std::size_t before = vertices.size();
  vertices.insert(vertices.end(), other.vertices.begin(), other.vertices.end());
  const auto middle = vertices.begin() + static_cast<std::ptrdiff_t>(before);
  std::inplace_merge(vertices.begin(), middle, vertices.end());
  vertices.erase(std::unique(vertices.begin(), vertices.end()), vertices.end());
  corners.insert(corners.end(), other.corners.begin(), other.corners.end());
}

std::vector<GridPoint> NodeHull::points(const SplitStore& store) const {
  std::vector<GridPoint> points(corners);
  points.reserve(size());
  for (const VertexId v : vertices) points.push_back(store.position(v));
  return points;
}

Result<NodeHull> hull_of_node(ModelFile& file, NodeSpan node) {
  Hull hull(file);
  NEARMESH_RETURN_IF_ERROR(hull.add(node));
  return std::move(hull).take();
}

Result<NodeHull> hull_below(ModelFile& file, NodeSpan node) {
  Hull hull(file);
  NEARMESH_RETURN_IF_ERROR(hull.add_below(node));
  return std::move(hull).take();
}

}  // namespace nearmesh
