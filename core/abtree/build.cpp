// SPDX-License-Identifier: Apache-2.0
#include "build.hpp"

#include <algorithm>
#include <bit>
#include <memory>

#include "medians.hpp"

namespace nearmesh {
namespace {

/// The lowest `count` bits, 1 to 64.
std::uint64_t first_bits(std::size_t count) { return ~std::uint64_t{0} >> (kWordParts - count); }

/// Calls emit for each of `groups` parts of the word, alike in number.
template <class Emit>
void cut_word(const PartCenters& centers, std::uint64_t parts, std::size_t groups,
              const Emit& emit) {
  if (groups < 2) {
    emit(parts);
    return;
  }
  const auto count = static_cast<std::size_t>(std::popcount(parts));
  const std::uint64_t left =
      least_parts(centers, parts, static_cast<std::uint32_t>(count * (groups / 2) / groups));
  cut_word(centers, left, groups / 2, emit);
  cut_word(centers, parts & ~left, groups - groups / 2, emit);
}

}  // namespace

TreeEntry inner_entry(const TreePages<TreeNode>& nodes, std::uint32_t place) {
  const TreeNode& node = nodes[place];
  TreeEntry entry;
  bound(node.boxes, node.size, node.lanes, entry.box, entry.slab);
  bool is_coarse = false;
  for (std::uint32_t left = node.lanes; left != 0; left &= left - 1)
    is_coarse |= node.is_coarse(static_cast<std::uint32_t>(std::countr_zero(left)));
  entry.set(TreeEntry::Kind::kInner, place, is_coarse ? 1 : 0);
  return entry;
}

void TreeBuilder::clear() {
  face_count_ = 0;
  lanes_.clear();
}

void TreeBuilder::add_unresolved(NodeSpan node, const GridBox& box, const Slab& slab) {
  TreeEntry& entry = lanes_.emplace_back();
  entry.box = box;
  entry.slab = slab;
  entry.set(TreeEntry::Kind::kUnresolved, node.begin(), node.size);
}

/// Puts the `middle` parts with the least centres along the longest axis first, as least_parts()
/// does for few.
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
  offsets_.resize(parts.size());
  for (std::size_t i = 0; i < parts.size(); ++i)
    offsets_[i] =
        static_cast<std::uint32_t>(parts[i].center[axis]) - static_cast<std::uint32_t>(lo[axis]);
  const std::uint32_t least_right = nth_least(offsets_, middle);
  // Of those that lie on the median the first go left, as many as there is room for.
  std::size_t ties = middle;
  for (const std::uint32_t offset : offsets_)
    ties -= static_cast<std::size_t>(offset < least_right);
  right_parts_.resize(parts.size());
  std::size_t left = 0, right = 0;
  for (std::size_t i = 0; i < parts.size(); ++i) {
    const bool is_tie = offsets_[i] == least_right && ties > 0;
    const bool is_left = offsets_[i] < least_right || is_tie;
    ties -= static_cast<std::size_t>(is_tie);
    // To both, and counted where it is right: that is hard to foretell.
    const Part part = parts[i];
    parts[left] = part;
    right_parts_[right] = part;
    left += static_cast<std::size_t>(is_left);
    right += static_cast<std::size_t>(!is_left);
  }
  std::copy(right_parts_.begin(), right_parts_.begin() + static_cast<std::ptrdiff_t>(right),
            parts.begin() + static_cast<std::ptrdiff_t>(left));
}

/// Calls emit for each of `groups` parts of the range, alike in number, in the order given within
/// each.
template <class Emit>
void TreeBuilder::cut(std::span<Part> parts, std::size_t groups, const Emit& emit) {
  if (groups < 2) {
    emit(parts);
    return;
  }
  if (parts.size() <= kWordParts) {
    PartCenters centers;
    for (std::size_t i = 0; i < parts.size(); ++i)
      for (std::size_t k = 0; k < 3; ++k) centers.axis[k][i] = parts[i].center[k];
    cut_word(centers, first_bits(parts.size()), groups, [&](std::uint64_t bits) {
      std::array<Part, kWordParts> group;
      std::size_t count = 0;
      for (; bits != 0; bits &= bits - 1) group[count++] = parts[std::countr_zero(bits)];
      emit(std::span(group).first(count));
    });
    return;
  }
  const std::size_t middle = parts.size() * (groups / 2) / groups;
  divide(parts, middle);
  cut(parts.first(middle), groups / 2, emit);
  cut(parts.subspan(middle), groups - groups / 2, emit);
}

void TreeBuilder::cut_faces(TreePages<FaceBlock>& blocks) {
  const std::size_t groups = (face_count_ + kLanes - 1) / kLanes;
  parts_.clear();
  for (std::size_t first = 0; first < face_count_; first += kWordParts) {
    const std::size_t count = std::min<std::size_t>(kWordParts, face_count_ - first);
    PartCenters centers;
    for (std::uint32_t i = 0; i < count && groups > 1; i += kLanes)
      set_centers(faces_[(first + i) / kLanes].triangles, i, centers);
    if (face_count_ <= kWordParts) {
      cut_word(centers, first_bits(count), groups, [&](std::uint64_t bits) {
        std::array<Part, kLanes> group;
        std::size_t size = 0;
        for (; bits != 0; bits &= bits - 1)
          group[size++].index = static_cast<std::uint32_t>(std::countr_zero(bits));
        add_block(std::span(group).first(size), blocks);
      });
      return;
    }
    for (std::size_t i = 0; i < count; ++i)
      parts_.push_back({{centers.axis[0][i], centers.axis[1][i], centers.axis[2][i]},
                        static_cast<std::uint32_t>(first + i)});
  }
  if (!parts_.empty())
    cut(std::span<Part>(parts_), groups,
        [&](std::span<const Part> parts) { add_block(parts, blocks); });
}

void TreeBuilder::add_block(std::span<const Part> parts, TreePages<FaceBlock>& blocks) {
  const std::uint32_t place = blocks.take();
  FaceBlock& block = blocks[place];
  for (std::uint32_t i = 0; i < kLanes; ++i) {
    const std::uint32_t face = parts[std::min<std::size_t>(i, parts.size() - 1)].index;
    const FaceBlock& from = faces_[face / kLanes];
    for (std::size_t c = 0; c < 3; ++c)
      for (std::size_t k = 0; k < 3; ++k)
        block.triangles.corner[c][k][i] = from.triangles.corner[c][k][face % kLanes];
    block.keys[i] = from.keys[face % kLanes];
  }
  lanes_.emplace_back().set(TreeEntry::Kind::kFaces, place,
                            static_cast<std::uint32_t>(parts.size()));
}

TreeEntry TreeBuilder::make_entry(std::span<Part> parts, TreePlace place,
                                  TreePages<TreeNode>& nodes) {
  if (parts.size() == 1) return lanes_[parts.front().index];
  // Full subtrees of `below` lanes each, as far as they go round.
  std::size_t below = 1;
  while (below * kLanes < parts.size()) below *= kLanes;
  const std::uint32_t own = nodes.take();
  std::construct_at(&nodes[own]);
  inner_.emplace_back(own, place);
  std::uint32_t count = 0;
  if (below == 1) {
    for (const Part& part : parts) nodes[own].set(count++, lanes_[part.index]);
  } else {
    const std::size_t groups = (parts.size() + below - 1) / below;
    // Parts stand here themselves where there is room for all of a group, which then needs no node.
    std::size_t room = below == kLanes ? kLanes - groups : 0;
    cut(parts, groups, [&](std::span<Part> group) {
      if (group.size() <= room + 1) {
        room -= group.size() - 1;
        for (const Part& part : group) nodes[own].set(count++, lanes_[part.index]);
        return;
      }
      const TreeEntry child = make_entry(group, own * kLanes + count, nodes);
      nodes[own].set(count++, child);
    });
  }
  TreeEntry entry;
  entry.set(TreeEntry::Kind::kInner, own, 0);
  return entry;
}

TreeEntry TreeBuilder::build(TreeArrays& arrays) {
  cut_faces(arrays.blocks);
  for (TreeEntry& lane : lanes_)
    if (lane.kind() == TreeEntry::Kind::kFaces)
      bound(arrays.blocks[lane.first].triangles, lane.count(), lane.box, lane.slab);
  parts_.resize(lanes_.size());
  for (std::uint32_t i = 0; i < lanes_.size(); ++i) parts_[i].index = i;
  if (lanes_.size() > kLanes)  // else nothing is cut
    for (std::uint32_t i = 0; i < lanes_.size(); ++i) {
      const GridBox& box = lanes_[i].box;
      for (int k = 0; k < 3; ++k)
        parts_[i].center[static_cast<std::size_t>(k)] = (box.lo[k] >> 1) + (box.hi[k] >> 1);
    }
  inner_.clear();
  if (parts_.empty()) return {};
  const TreeEntry root = make_entry(parts_, 0, arrays.nodes);
  for (std::size_t i = inner_.size(); i-- > 1;) {  // children before parents
    const auto [node, place] = inner_[i];
    arrays.nodes[place / kLanes].set(place % kLanes, inner_entry(arrays.nodes, node));
  }
  return root;
}

TriangleTree build_triangle_tree(const Grid& grid, const std::vector<TreeFace>& faces) {
  TreeBuilder builder;
  FaceBlock* blocks_to_be = builder.add_faces(faces.size());
  for (std::uint32_t i = 0; i < faces.size(); ++i) {
    blocks_to_be[i / kLanes].triangles.set(i % kLanes, faces[i].corners);
    blocks_to_be[i / kLanes].keys[i % kLanes] = faces[i].key;
  }
  TreeArrays arrays;
  const std::uint32_t top = arrays.nodes.take();
  arrays.nodes[top] = {};
  TreeEntry root = builder.build(arrays);
  if (root.kind() == TreeEntry::Kind::kInner) root = inner_entry(arrays.nodes, root.first);
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
