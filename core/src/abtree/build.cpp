// SPDX-License-Identifier: Apache-2.0
#include "build.hpp"

#include <algorithm>

namespace nearmesh {
namespace {

bool has_length(const std::array<double, 3>& v) { return v[0] != 0 || v[1] != 0 || v[2] != 0; }

}  // namespace

TreeEntry enclose(const TreeNode& node) {
  TreeEntry out;
  std::array<double, 3> direction{};
  for (std::uint32_t left = node.lanes; left != 0; left &= left - 1) {
    const auto lane = static_cast<std::uint32_t>(std::countr_zero(left));
    out.box.add(node.boxes.box(lane));
    // Large parts count as their area, as well as boxes tell.
    const double size = static_cast<double>(node.size[lane]);
    for (std::size_t k = 0; k < 3; ++k) direction[k] += size * size * node.boxes.normal[k][lane];
  }
  if (!has_length(direction)) return out;
  const std::array<std::int8_t, 3> normal = make_slab_normal(direction);
  double from = std::numeric_limits<double>::infinity(), to = -from, middle = 0;
  for (std::uint32_t left = node.lanes; left != 0; left &= left - 1) {
    const auto lane = static_cast<std::uint32_t>(std::countr_zero(left));
    const Span span = span_along(normal, out.box.lo, node.boxes.box(lane), node.boxes.slab(lane));
    from = std::min(from, span.from);
    to = std::max(to, span.to);
  }
  const CenteredBox box = centered(out.box);
  for (std::size_t k = 0; k < 3; ++k) middle += normal[k] * box.half[k];
  out.slab = make_slab(normal, from - middle, to - middle);
  return out;
}

void TreeBuilder::clear() {
  faces_.clear();
  lanes_.clear();
}

void TreeBuilder::add_frontier(NodeSpan node, const GridBox& box) {
  TreeEntry entry;
  entry.box = box;
  entry.set(TreeEntry::Kind::kFrontier, node.begin(), node.size);
  lanes_.push_back(entry);
}

TreeBuilder::Part TreeBuilder::part_of(const GridBox& box, std::uint32_t index) {
  Part part{{}, index};
  for (int k = 0; k < 3; ++k)
    part.center[static_cast<std::size_t>(k)] = (box.lo[k] >> 1) + (box.hi[k] >> 1);
  return part;
}

/// Calls emit for each of `groups` parts of the range, alike in number, in the order given within each.
template <class Emit>
void TreeBuilder::cut(std::span<Part> parts, std::size_t groups, const Emit& emit) {
  if (groups < 2) {
    std::sort(parts.begin(), parts.end(),
              [](const Part& x, const Part& y) { return x.index < y.index; });
    emit(parts);
    return;
  }
  std::array<std::int32_t, 3> lo = parts.front().center, hi = lo;
  for (const Part& part : parts)
    for (std::size_t k = 0; k < 3; ++k) {
      lo[k] = std::min(lo[k], part.center[k]);
      hi[k] = std::max(hi[k], part.center[k]);
    }
  std::size_t axis = 0;
  for (std::size_t k = 1; k < 3; ++k)
    if (std::int64_t{hi[k]} - lo[k] > std::int64_t{hi[axis]} - lo[axis]) axis = k;
  const std::size_t left_groups = groups / 2;
  const std::size_t middle = parts.size() * left_groups / groups;
  // Equal centres are as good on either side, but must fall the same way everywhere.
  std::nth_element(parts.begin(), parts.begin() + static_cast<std::ptrdiff_t>(middle), parts.end(),
                   [axis](const Part& x, const Part& y) {
                     return x.center[axis] != y.center[axis] ? x.center[axis] < y.center[axis]
                                                             : x.index < y.index;
                   });
  cut(parts.first(middle), left_groups, emit);
  cut(parts.subspan(middle), groups - left_groups, emit);
}

void TreeBuilder::add_block(std::span<Part> parts) {
  FaceBlock block;
  TreeEntry entry;
  std::array<double, 3> direction{};  // of the normals, each as long as its face is large
  for (std::uint32_t i = 0; i < kLanes; ++i) {
    const TreeFace& face = faces_[parts[std::min<std::size_t>(i, parts.size() - 1)].index];
    block.triangles.set(i, face.corners);
    block.keys[i] = face.key;
    if (i >= parts.size()) continue;
    std::array<double, 3> e, g;
    for (std::size_t k = 0; k < 3; ++k) {
      e[k] = static_cast<double>(face.corners[1].v[k]) - face.corners[0].v[k];
      g[k] = static_cast<double>(face.corners[2].v[k]) - face.corners[0].v[k];
    }
    for (std::size_t k = 0; k < 3; ++k)
      direction[k] += e[(k + 1) % 3] * g[(k + 2) % 3] - e[(k + 2) % 3] * g[(k + 1) % 3];
    for (const GridPoint& corner : face.corners) entry.box.add(corner);
  }
  if (has_length(direction)) {
    const std::array<std::int8_t, 3> normal = make_slab_normal(direction);
    const CenteredBox box = centered(entry.box);
    // Exact: |n . (x - c)| < 2^41 in halves.
    double from = std::numeric_limits<double>::infinity(), to = -from;
    for (const auto& corner : block.triangles.corner)
      for (std::uint32_t i = 0; i < kLanes; ++i) {
        const double along = normal[0] * (corner[0][i] - box.center[0]) +
                             normal[1] * (corner[1][i] - box.center[1]) +
                             normal[2] * (corner[2][i] - box.center[2]);
        from = std::min(from, along);
        to = std::max(to, along);
      }
    entry.slab = make_slab(normal, from, to);
  }
  entry.set(TreeEntry::Kind::kFaces, static_cast<std::uint32_t>(blocks_.size()),
            static_cast<std::uint32_t>(parts.size()));
  blocks_.push_back(block);
  lanes_.push_back(entry);
}

TreeEntry TreeBuilder::make_entry(std::span<Part> parts) {
  if (parts.size() == 1) return lanes_[parts.front().index];
  // Full subtrees of `below` lanes each, as far as they go round.
  std::size_t below = 1;
  while (below * kLanes < parts.size()) below *= kLanes;
  const auto place = static_cast<std::uint32_t>(nodes_.size());
  nodes_.emplace_back();
  std::uint32_t count = 0;
  const auto add = [&](std::span<Part> group) {
    const TreeEntry child = make_entry(group);
    nodes_[place].set(count++, child);
  };
  if (below == 1) {
    std::sort(parts.begin(), parts.end(),
              [](const Part& x, const Part& y) { return x.index < y.index; });
    for (std::size_t i = 0; i < parts.size(); ++i) add(parts.subspan(i, 1));
  } else {
    cut(parts, (parts.size() + below - 1) / below, add);
  }
  TreeEntry entry = enclose(nodes_[place]);
  entry.set(TreeEntry::Kind::kInner, place, 0);
  return entry;
}

void TreeBuilder::build() {
  nodes_.clear();
  blocks_.clear();
  root_ = {};
  parts_.clear();
  for (std::uint32_t i = 0; i < faces_.size(); ++i) {
    GridBox box;
    for (const GridPoint& corner : faces_[i].corners) box.add(corner);
    parts_.push_back(part_of(box, i));
  }
  if (!parts_.empty())
    cut(std::span<Part>(parts_), (parts_.size() + kLanes - 1) / kLanes,
        [this](std::span<Part> parts) { add_block(parts); });
  parts_.clear();
  for (std::uint32_t i = 0; i < lanes_.size(); ++i) parts_.push_back(part_of(lanes_[i].box, i));
  if (!parts_.empty()) root_ = make_entry(parts_);
}

TriangleTree build_triangle_tree(const Grid& grid, const std::vector<TreeFace>& faces) {
  TreeBuilder builder;
  for (const TreeFace& face : faces) builder.add_face(face);
  builder.build();
  TriangleTree tree{grid, {TreeNode{}}, builder.blocks()};
  TreeEntry root = builder.root();
  if (root.kind() == TreeEntry::Kind::kInner) ++root.first;
  tree.nodes[0].set(0, root);
  tree.nodes.insert(tree.nodes.end(), builder.nodes().begin(), builder.nodes().end());
  for (std::size_t i = 1; i < tree.nodes.size(); ++i)
    for (std::uint32_t lane = 0; lane < kLanes; ++lane)
      if (tree.nodes[i].entry(lane).kind() == TreeEntry::Kind::kInner) ++tree.nodes[i].first[lane];
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
