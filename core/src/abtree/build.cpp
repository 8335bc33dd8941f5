// SPDX-License-Identifier: Apache-2.0
#include "build.hpp"

#include <algorithm>
#include <bit>

namespace nearmesh {
namespace {

/// Up to so many parts are ranked by holding each against each, in vectors, which costs less than to sort them.
constexpr std::size_t kRankedParts = 64;

/// How many of `keys` are less than each.
void rank(std::span<const std::int32_t, kRankedParts> keys, std::size_t count,
          std::span<std::int32_t, kRankedParts> ranks) {
  constexpr std::size_t kAtOnce = 16;
  for (std::size_t at = 0; at < count; at += kAtOnce) {
    std::array<std::int32_t, kAtOnce> own{}, less{};
    std::copy_n(keys.begin() + at, kAtOnce, own.begin());
    for (std::size_t j = 0; j < count; ++j)
      for (std::size_t i = 0; i < kAtOnce; ++i) less[i] += keys[j] < own[i] ? 1 : 0;
    std::copy_n(less.begin(), kAtOnce, ranks.begin() + at);
  }
}

}  // namespace

TreeEntry enclose(const TreeNode& node) {
  const Bound bound = bound_of(node.boxes, node.size, node.lanes);
  TreeEntry out;
  out.box = bound.box;
  out.slab = bound.slab;
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

/// Puts the `middle` parts with the least centres along the longest axis first. Both sides keep their order. Equal centres
/// are as good on either side, but must fall the same way everywhere: those that stand first are less.
void TreeBuilder::divide(std::span<Part> parts, std::size_t middle) {
  std::array<std::int32_t, 3> lo = parts.front().center, hi = lo;
  for (const Part& part : parts)
    for (std::size_t k = 0; k < 3; ++k) {
      lo[k] = std::min(lo[k], part.center[k]);
      hi[k] = std::max(hi[k], part.center[k]);
    }
  std::size_t axis = 0;
  for (std::size_t k = 1; k < 3; ++k)
    if (std::int64_t{hi[k]} - lo[k] > std::int64_t{hi[axis]} - lo[axis]) axis = k;

  const auto along = [&](const Part& part) {  // from 0
    return static_cast<std::uint32_t>(part.center[axis]) - static_cast<std::uint32_t>(lo[axis]);
  };

  right_parts_.clear();
  Part* left = parts.data();
  const auto put = [&](const Part& part, bool is_left) {
    if (is_left) {
      *left++ = part;
    } else {
      right_parts_.push_back(part);
    }
  };
  if (parts.size() <= kRankedParts) {
    std::array<std::int32_t, kRankedParts> keys{}, ranks;
    // 25 bits of the centre and 6 of the place.
    const std::uint32_t extent =
        static_cast<std::uint32_t>(hi[axis]) - static_cast<std::uint32_t>(lo[axis]);
    const int shift = std::max(0, static_cast<int>(std::bit_width(extent)) - 25);
    for (std::uint32_t i = 0; i < parts.size(); ++i)
      keys[i] = static_cast<std::int32_t>(along(parts[i]) >> shift << 6 | i);
    rank(keys, parts.size(), ranks);
    for (std::size_t i = 0; i < parts.size(); ++i)
      put(parts[i], static_cast<std::size_t>(ranks[i]) < middle);
  } else {
    const auto key = [&](std::size_t i) {
      return std::uint64_t{along(parts[i])} << 32 | i;
    };
    keys_.resize(parts.size());
    for (std::size_t i = 0; i < parts.size(); ++i) keys_[i] = key(i);
    std::nth_element(keys_.begin(), keys_.begin() + static_cast<std::ptrdiff_t>(middle),
                     keys_.end());
    const std::uint64_t least_right = keys_[middle];
    for (std::size_t i = 0; i < parts.size(); ++i) put(parts[i], key(i) < least_right);
  }
  std::copy(right_parts_.begin(), right_parts_.end(), left);
}

/// Calls emit for each of `groups` parts of the range, alike in number, in the order given within each.
template <class Emit>
void TreeBuilder::cut(std::span<Part> parts, std::size_t groups, const Emit& emit) {
  if (groups < 2) {
    emit(parts);
    return;
  }
  const std::size_t left_groups = groups / 2;
  const std::size_t middle = parts.size() * left_groups / groups;
  divide(parts, middle);
  cut(parts.first(middle), left_groups, emit);
  cut(parts.subspan(middle), groups - left_groups, emit);
}

void TreeBuilder::add_block(std::span<const Part> parts, TreePages<FaceBlock>& blocks) {
  const std::uint32_t place = blocks.take();
  FaceBlock& block = blocks[place];
  for (std::uint32_t i = 0; i < kLanes; ++i) {
    const TreeFace& face = faces_[parts[std::min<std::size_t>(i, parts.size() - 1)].index];
    block.triangles.set(i, face.corners);
    block.keys[i] = face.key;
  }
  const auto count = static_cast<std::uint32_t>(parts.size());
  const Bound bound = bound_of(block.triangles, count);
  TreeEntry& entry = lanes_.emplace_back();
  entry.box = bound.box;
  entry.slab = bound.slab;
  entry.set(TreeEntry::Kind::kFaces, place, count);
}

TreeEntry TreeBuilder::make_entry(std::span<Part> parts, TreePages<TreeNode>& nodes) {
  if (parts.size() == 1) return lanes_[parts.front().index];
  // Full subtrees of `below` lanes each, as far as they go round.
  std::size_t below = 1;
  while (below * kLanes < parts.size()) below *= kLanes;
  const std::uint32_t place = nodes.take();
  nodes[place] = {};
  std::uint32_t count = 0;
  if (below == 1) {
    for (const Part& part : parts) nodes[place].set(count++, lanes_[part.index]);
  } else {
    cut(parts, (parts.size() + below - 1) / below, [&](std::span<Part> group) {
      const TreeEntry child = make_entry(group, nodes);
      nodes[place].set(count++, child);
    });
  }
  TreeEntry entry = enclose(nodes[place]);
  entry.set(TreeEntry::Kind::kInner, place, 0);
  return entry;
}

TreeEntry TreeBuilder::build(TreeArrays& arrays) {
  parts_.resize(faces_.size());
  for (std::uint32_t i = 0; i < faces_.size(); ++i) {
    GridBox box;
    if (faces_.size() > kLanes)
      for (const GridPoint& corner : faces_[i].corners) box.add(corner);
    parts_[i] = part_of(box, i);
  }
  if (!parts_.empty())
    cut(std::span<Part>(parts_), (parts_.size() + kLanes - 1) / kLanes,
        [&](std::span<const Part> parts) { add_block(parts, arrays.blocks); });
  parts_.resize(lanes_.size());
  for (std::uint32_t i = 0; i < lanes_.size(); ++i) parts_[i] = part_of(lanes_[i].box, i);
  return parts_.empty() ? TreeEntry{} : make_entry(parts_, arrays.nodes);
}

TriangleTree build_triangle_tree(const Grid& grid, const std::vector<TreeFace>& faces) {
  TreeBuilder builder;
  for (const TreeFace& face : faces) builder.add_face(face);
  TreeArrays arrays;
  const std::uint32_t top = arrays.nodes.take();
  arrays.nodes[top] = {};
  const TreeEntry root = builder.build(arrays);
  arrays.nodes[top].set(0, root);
  const auto nodes = arrays.nodes.view();
  const auto blocks = arrays.blocks.view();
  return {grid, {nodes.begin(), nodes.end()}, {blocks.begin(), blocks.end()}};
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
