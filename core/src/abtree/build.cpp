// SPDX-License-Identifier: Apache-2.0
#include "build.hpp"

#include <algorithm>

namespace nearmesh {
namespace {

std::int64_t twice_center(const GridBox& box, int axis) {
  return std::int64_t{box.lo[axis]} + box.hi[axis];
}

// The cheapest total order on centres along an axis; equal centres are as good on either side, but
// must fall the same way everywhere: the rest of the box and the identity decide.
struct Before {
  int axis;
  bool operator()(const BuildItem& a, const BuildItem& b) const {
    const std::int64_t x = twice_center(a.box, axis), y = twice_center(b.box, axis);
    if (x != y) return x < y;
    if (a.frontier != b.frontier) return a.frontier < b.frontier;
    return a.face < b.face;
  }
};

bool is_leaf(std::span<const BuildItem> items) {
  if (items.size() == 1) return true;
  if (items.size() > kFacesPerLeaf) return false;
  return std::all_of(items.begin(), items.end(),
                     [](const BuildItem& item) { return item.frontier.size == 0; });
}

void make_leaf(std::span<const BuildItem> items, TreeNode& node, BuildOutput& out) {
  if (items.front().frontier.size > 0) {
    const NodeSpan& span = items.front().frontier;
    node.set(TreeNode::Kind::kFrontier, span.begin(), span.size);
    return;
  }
  node.set(TreeNode::Kind::kFaces, static_cast<std::uint32_t>(out.faces.size()),
           static_cast<std::uint32_t>(items.size()));
  for (const BuildItem& item : items) out.faces.push_back(item.face);
}

}  // namespace

void build_tree(std::vector<BuildItem>& items, BuildOutput& out) {
  out.root = TreeNode{};
  out.nodes.clear();
  out.faces.clear();
  if (items.empty()) return;
  struct Task {
    std::size_t begin, end;
    std::int64_t node;  // -1: the root
  };
  std::vector<Task> tasks{{0, items.size(), -1}};
  while (!tasks.empty()) {
    const Task task = tasks.back();
    tasks.pop_back();
    const std::span<BuildItem> range(items.data() + task.begin, task.end - task.begin);
    TreeNode node;
    std::int64_t lo[3], hi[3];
    for (int k = 0; k < 3; ++k) lo[k] = hi[k] = twice_center(range.front().box, k);
    for (const BuildItem& item : range) {
      node.box.add(item.box);
      for (int k = 0; k < 3; ++k) {
        const std::int64_t c = twice_center(item.box, k);
        lo[k] = std::min(lo[k], c);
        hi[k] = std::max(hi[k], c);
      }
    }
    if (is_leaf(range)) {
      make_leaf(range, node, out);
    } else {
      int axis = 0;
      for (int k = 1; k < 3; ++k)
        if (hi[k] - lo[k] > hi[axis] - lo[axis]) axis = k;
      const std::size_t middle = range.size() / 2;
      std::nth_element(range.begin(), range.begin() + static_cast<std::ptrdiff_t>(middle),
                       range.end(), Before{axis});
      const auto pair = static_cast<std::uint32_t>(out.nodes.size());
      out.nodes.resize(out.nodes.size() + 2);
      node.set(TreeNode::Kind::kInner, pair, 0);
      // The right half first, so that the left is built next and faces stand in tree order.
      tasks.push_back({task.begin + middle, task.end, pair + 1});
      tasks.push_back({task.begin, task.begin + middle, pair});
    }
    (task.node < 0 ? out.root : out.nodes[static_cast<std::size_t>(task.node)]) = node;
  }
}

TriangleTree build_triangle_tree(const Grid& grid, std::vector<TreeFace> faces) {
  std::vector<BuildItem> items(faces.size());
  for (std::uint32_t i = 0; i < faces.size(); ++i) {
    for (const GridPoint& corner : faces[i].corners) items[i].box.add(corner);
    items[i].face = i;
  }
  BuildOutput built;
  build_tree(items, built);
  TriangleTree tree{grid, {}, {}};
  tree.nodes.reserve(built.nodes.size() + 2);
  tree.nodes.push_back(built.root);
  tree.nodes.push_back({});  // pairs start at an even place
  tree.nodes.insert(tree.nodes.end(), built.nodes.begin(), built.nodes.end());
  for (TreeNode& node : tree.nodes)
    if (node.kind() == TreeNode::Kind::kInner) node.first += 2;
  tree.faces.reserve(faces.size());
  for (const std::uint32_t face : built.faces) tree.faces.push_back(faces[face]);
  return tree;
}

std::vector<TreeFace> current_triangles(const ActiveMesh& mesh) {
  const std::vector<ActiveFace> active = extract_faces(mesh);
  std::vector<TreeFace> triangles(active.size());
  for (std::size_t i = 0; i < active.size(); ++i) {
    triangles[i].key = active[i].key;
    for (std::size_t k = 0; k < 3; ++k)
      triangles[i].corners[k] = mesh.store().position(active[i].corners[k]);
  }
  return triangles;
}

std::optional<TriangleTree> build_full_tree(const SpmHeader& header, const SplitStore& store) {
  ActiveMesh mesh(store);
  RefineDelta delta;
  for (std::uint32_t v = 0; v < store.vertex_count(); ++v)
    if (!store.is_root({v}) && !mesh.split({v}, delta)) return std::nullopt;
  TriangleTree tree = build_triangle_tree(header.grid, current_triangles(mesh));
  tree.surface = header.surface;
  return tree;
}

}  // namespace nearmesh
