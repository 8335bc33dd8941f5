// SPDX-License-Identifier: Apache-2.0
#include "nearmesh/core/spm/detail/split_store.hpp"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <string>

#include "core/geometry/box_points.hpp"

namespace nearmesh {

// ---- boxes --------------------------------------------------------------------------------------

namespace {

// floor(2^(k/4)) scaled is irrational but for k % 4 == 0, so the smallest integer >= 2^(k/4) - 1 is
// its floor; the four constants are exact to a double, far more than 32 bits need.
std::array<std::int32_t, kMaxExtentCode + 1> make_extents() {
  constexpr double kQuarter[4] = {1.0, 1.1892071150027210667, 1.4142135623730950488,
                                  1.6817928305074290861};
  std::array<std::int32_t, kMaxExtentCode + 1> extents{};
  for (int code = 0; code <= kMaxExtentCode; ++code)
    extents[code] = static_cast<std::int32_t>(
        code % 4 == 0 ? (std::int64_t{1} << (code / 4)) - 1
                      : static_cast<std::int64_t>(std::ldexp(kQuarter[code % 4], code / 4)));
  return extents;
}
const std::array<std::int32_t, kMaxExtentCode + 1> kExtents = make_extents();

// The extent of the code before; -1 for the first.
const std::array<std::int32_t, kMaxExtentCode + 1> kShorter = [] {
  std::array<std::int32_t, kMaxExtentCode + 1> shorter{};
  shorter[0] = -1;
  std::copy(kExtents.begin(), kExtents.end() - 1, shorter.begin() + 1);
  return shorter;
}();

}  // namespace

std::int64_t box_extent(std::uint8_t code) { return kExtents[code]; }

std::uint8_t box_extent_code(std::int64_t x) {
  if (x <= 0) return 0;
  // extent(4 (b - 1)) = 2^(b - 1) - 1 < x <= 2^b - 1 = extent(4 b), b being x's bit length: one of
  // four.
  const int below = 4 * (static_cast<int>(std::bit_width(static_cast<std::uint64_t>(x))) - 1);
  NEARMESH_ASSERT(below < kMaxExtentCode);
  return static_cast<std::uint8_t>(below + 1 + (kExtents[below + 1] < x) +
                                   (kExtents[below + 2] < x) + (kExtents[below + 3] < x));
}

BoxCode encode_box(const GridPoint& representative, const GridBox& box) {
  BoxCode code{};
  for (int k = 0; k < 3; ++k) {
    code[2 * k] = box_extent_code(std::int64_t{representative[k]} - box.lo[k]);
    code[2 * k + 1] = box_extent_code(std::int64_t{box.hi[k]} - representative[k]);
  }
  return code;
}

GridBox decode_box(const GridPoint& representative, const BoxCode& code, std::int32_t grid_max) {
  GridBox box;
  for (int k = 0; k < 3; ++k) {
    const std::int64_t below = kExtents[code[2 * k]], above = kExtents[code[2 * k + 1]];
    box.lo[k] = static_cast<std::int32_t>(std::max<std::int64_t>(0, representative[k] - below));
    box.hi[k] =
        static_cast<std::int32_t>(std::min<std::int64_t>(grid_max, representative[k] + above));
  }
  return box;
}

// ---- store --------------------------------------------------------------------------------------

namespace {

// Codes plus one, so that an untouched page means "no box".
std::uint64_t packed(const BoxCode& code) {
  std::uint64_t p = 0;
  if (code[0] != kNoBoxCode)
    for (std::size_t k = 0; k < 6; ++k) p |= std::uint64_t{code[k] + 1U} << 7 * k;
  return p;
}
std::size_t unpacked(std::uint64_t p, int k) { return (p >> 7 * k & 127U) - 1; }
GridBox grid_box(const AxesBox& box) {
  return {{{box.lo[0], box.lo[1], box.lo[2]}}, {{box.hi[0], box.hi[1], box.hi[2]}}};
}

Status contradiction(const SplitRecord& record, const char* what) {
  return {StatusCode::kCorrupt, "split " + std::to_string(record.split.value) + " of node [" +
                                    std::to_string(record.node.begin()) + ", " +
                                    std::to_string(record.node.end()) + "): " + what};
}

}  // namespace

SplitStore::SplitStore(const SpmHeader& header)
    : vertex_count_(header.vertex_count),
      grid_max_(static_cast<std::int32_t>((std::int64_t{1} << header.grid.bits) - 1)),
      entries_(header.vertex_count),
      roots_(header.roots),
      base_faces_(header.base_faces),
      surface_(header.surface) {
  for (const BaseRoot& root : roots_) {
    Entry& entry = entries_.set(root.node.begin());
    entry.size = root.node.size;
    entry.parent = root.node.begin();
    entry.position = root.position;
    entry.box = packed(root.box) & kBoxMask;
    whole_box_.add(box(root.node));
  }
}

bool SplitStore::is_node(NodeSpan node) const {
  if (node.size == 0 || node.begin() >= vertex_count_ || node.size > vertex_count_ - node.begin())
    return false;
  const Entry& first = entries_[node.begin()];
  if (first.size == 0 || node.size > first.size) return false;
  if (node.size == first.size) return true;
  const Entry& maker = entries_[node.end()];
  return maker.size != 0 && maker.parent == node.begin();
}

std::uint32_t& SplitStore::split_slot(NodeSpan node) {
  Entry& first = entries_.set(node.begin());
  return node.size == first.size ? first.first_split : entries_.set(node.end()).next_split;
}

VertexId SplitStore::split_of(NodeSpan node) const {
  NEARMESH_ASSERT(is_node(node));
  const Entry& first = entries_[node.begin()];
  const std::uint32_t u =
      node.size == first.size ? first.first_split : entries_[node.end()].next_split;
  return u == 0 ? VertexId{} : VertexId{u};
}

NodeSpan SplitStore::parent_of(NodeSpan node) const {
  NEARMESH_ASSERT(is_node(node));
  const bool initial = node.size == entries_[node.begin()].size;
  const VertexId maker{initial ? node.begin() : node.end()};
  return is_root(maker) ? NodeSpan{} : node_of(maker);
}

std::size_t SplitStore::root_index(VertexId v) const {
  const auto after =
      std::upper_bound(roots_.begin(), roots_.end(), v,
                       [](VertexId x, const BaseRoot& root) { return x < root.node.first; });
  return static_cast<std::size_t>(after - roots_.begin()) - 1;
}

BoxCode SplitStore::box_code(NodeSpan node) const {
  const PackedBox own = packed_box(node);
  if (own == 0) return kNoBox;
  BoxCode code{};
  for (int k = 0; k < 6; ++k)
    code[static_cast<std::size_t>(k)] = static_cast<std::uint8_t>(unpacked(own, k));
  return code;
}

GridBox SplitStore::box(NodeSpan node) const { return grid_box(own_box(boxed_ancestor(node))); }

bool SplitStore::encloses(NodeSpan node, const GridBox& box) const {
  return own_box(boxed_ancestor(node)).contains(AxesBox(box));
}

// Precondition: the node has one. As decode_box().
AxesBox SplitStore::own_box(NodeSpan node) const {
  const PackedBox code = packed_box(node);
  const auto extent = [code](int side) {
    return Axes{kExtents[unpacked(code, side)], kExtents[unpacked(code, 2 + side)],
                kExtents[unpacked(code, 4 + side)], 0};
  };
  const Axes at = axes_of(position(node.first));
  return {at - least(extent(0), at), at + least(extent(1), all_axes(grid_max_) - at)};
}

NodeSpan SplitStore::boxed_ancestor(NodeSpan node) const {
  while (packed_box(node) == 0) {
    node = parent_of(node);
    NEARMESH_ASSERT(node.size != 0);  // roots have boxes: the header is refused without
  }
  return node;
}

// ---- what a record says, against the boxes ------------------------------------------------------

// The box of the nearest node above that has one, or of one farther up: what follows in a batch
// lies below the same, so the walk to it is seldom made.
const GridBox& SplitStore::bounds_of(NodeSpan node) {
  const bool is_below =
      bounded_.size != 0 && bounded_.begin() <= node.begin() && node.end() <= bounded_.end();
  if (is_below && (bounded_ == node || packed_box(node) == 0)) return bounds_;
  bounded_ = boxed_ancestor(node);
  bounds_ = grid_box(own_box(bounded_));
  return bounds_;
}

namespace {

// Whether the code may be that of a box inside `outer`, which has `at` in it: it is the smallest
// that covers, so one less would not reach.
bool may_be_within(Axes at, const BoxCode& code, const AxesBox& outer) {
  const auto shorter = [&](std::size_t side) {
    return Axes{kShorter[code[side]], kShorter[code[2 + side]], kShorter[code[4 + side]], -1};
  };
  return is_none((shorter(0) >= at - outer.lo) | (shorter(1) >= outer.hi - at));
}

AxesBox decoded(Axes at, const BoxCode& code, std::int32_t grid_max) {
  const auto extent = [&](std::size_t side) {
    return Axes{kExtents[code[side]], kExtents[code[2 + side]], kExtents[code[4 + side]], 0};
  };
  return {at - least(extent(0), at), at + least(extent(1), all_axes(grid_max) - at)};
}

}  // namespace

// A node that came without a box may be passed on with that of any node above it, so one of these
// must reach as far.
bool SplitStore::is_within_reach(const SplitRecord& record, const GridPoint& at,
                                 const BoxCode& code) const {
  const Axes place = axes_of(at);
  if (may_be_within(place, code, AxesBox(bounds_))) return true;
  for (NodeSpan above = record.node; above.size != 0; above = parent_of(above)) {
    if (packed_box(above) == 0) continue;
    const AxesBox outer = own_box(above);
    if (outer.contains({place, place}) && may_be_within(place, code, outer)) return true;
  }
  return false;
}

// The box of a node encloses every face that has a corner in it. So the new vertex lies in the
// node's, and of a face of this split, which has a corner in either child, each corner whose place
// is known in the node's and in both children's.
const char* SplitStore::fault_of_boxes(const SplitRecord& record, std::span<const SplitFace> faces,
                                       const GridBox& outside) {
  const AxesBox bounds(bounds_of(record.node));
  const Axes from = axes_of(position(record.node.first));
  const Axes to = from + Axes{record.offset[0], record.offset[1], record.offset[2], 0};
  if (!bounds.contains({to, to})) return "its vertex lies outside the box of the node";
  constexpr const char* kOutside = "a face lies outside a box that must enclose it";
  const AxesBox corners(outside);
  if (!bounds.contains(corners)) return kOutside;
  const bool has_left = record.left_box[0] != kNoBoxCode,
             has_right = record.right_box[0] != kNoBoxCode;
  if (!has_left && !has_right) return nullptr;
  bool starts_left = false, ends_right = false;
  for (const SplitFace& face : faces) {
    starts_left |= face.left == record.node.first;
    ends_right |= face.right == record.split;
  }
  AxesBox left = bounds, right = bounds;
  if (has_left) {
    if (!is_within_reach(record, position(record.node.first), record.left_box))
      return "the left box reaches farther than those above it";
    left = decoded(from, record.left_box, grid_max_);
    AxesBox held = corners;
    if (ends_right) held.add(to);
    if (!left.contains(held)) return kOutside;
  }
  if (has_right) {
    const GridPoint at{{to[0], to[1], to[2]}};
    if (!is_within_reach(record, at, record.right_box))
      return "the right box reaches farther than those above it";
    right = decoded(to, record.right_box, grid_max_);
    AxesBox held = corners;
    if (starts_left) held.add(from);
    if (!right.contains(held)) return kOutside;
  }
  if (!faces.empty() && !left.meets(right)) return "no face has room in the boxes of both children";
  return nullptr;
}

// ---- insertion ----------------------------------------------------------------------------------

Status SplitStore::check(const SplitRecord& record, std::span<const SplitFace> faces) const {
  const NodeSpan node = record.node;
  if (!record.right().contains(record.split) || record.split.value <= node.begin())
    return contradiction(record, "the split lies outside the node");
  if (depth_of(node) >= kMaxForestDepth)
    return contradiction(record, "the forest is deeper than 4096 splits");
  const VertexId known = split_of(node);
  if (known.is_valid() && known != record.split)
    return contradiction(record, "another split of the node is known");
  const GridPoint& from = position(node.first);
  for (int k = 0; k < 3; ++k) {
    const std::int64_t at = std::int64_t{from[k]} + record.offset[k];
    if (at < 0 || at > grid_max_) return contradiction(record, "position outside the grid");
    if (known.is_valid() && at != position(known)[k])
      return contradiction(record, "another position is known");
  }
  for (const SplitFace& face : faces) {
    if (!record.left().contains(face.left) || !record.right().contains(face.right) ||
        node.contains(face.outside) || face.outside.value >= vertex_count_)
      return contradiction(record, "a face does not belong to it");
  }
  if (known.is_valid()) {
    const SplitFaces own = this->faces(known);
    if (!std::equal(own.begin(), own.end(), faces.begin(), faces.end()))
      return contradiction(record, "other faces are known");
  }
  return Status::ok();
}

Result<SplitStore::Insertion> SplitStore::insert(const SplitRecord& record,
                                                 std::span<const SplitFace> faces,
                                                 const GridBox& outside) {
  if (!is_node(record.node)) return Insertion::kNoParent;
  NEARMESH_RETURN_IF_ERROR(check(record, faces));
  if (const char* fault = fault_of_boxes(record, faces, outside))
    return contradiction(record, fault);
  // Asked of the node, not of the entry: a page that is read before it is written costs the kernel
  // two faults.
  const bool known = split_of(record.node).is_valid();
  Entry& entry = entries_.set(record.split.value);
  if (!known) {
    entry.size = record.right().size;
    entry.parent = record.node.begin();
    entry.depth_less_one = depth_of(record.node) & 0xfffU;  // check() has seen that it fits
    for (int k = 0; k < 3; ++k)
      entry.position[k] = position(record.node.first)[k] + record.offset[k];
    if (faces.size() <= 2) {
      for (std::size_t i = 0; i < faces.size(); ++i)
        entry.faces[i] = FaceCorners(faces[i].corners());
    } else {
      entry.faces[0] = kManyFaces;
      many_faces_[record.split.value].assign(faces.begin(), faces.end());
    }
    split_slot(record.node) = record.split.value;
    ++known_;
  }
  bool boxed = false;
  if (entry.left_box() == 0 && record.left_box[0] != kNoBoxCode) {
    entry.set_left_box(packed(record.left_box));
    boxed = true;
  }
  if (entry.box == 0 && record.right_box[0] != kNoBoxCode) {
    entry.box = packed(record.right_box) & kBoxMask;
    boxed = true;
  }
  if (!known) return Insertion::kAdded;
  return boxed ? Insertion::kBoxed : Insertion::kKnown;
}

void SplitStore::erase(VertexId split) {
  const Entry& entry = entries_[split.value];
  const NodeSpan node = node_of(split);
  NEARMESH_ASSERT(entry.size != 0 && entry.parent != split.value);
  NEARMESH_ASSERT(entry.first_split == 0 && entry.next_split == 0);
  split_slot(node) = 0;
  if (entry.faces[0] == kManyFaces) many_faces_.erase(split.value);
  entries_.unset(split.value);
  --known_;
}

}  // namespace nearmesh
