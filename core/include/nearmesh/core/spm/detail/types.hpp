// SPDX-License-Identifier: Apache-2.0
#pragma once
// The words of the progressive mesh: nodes of the merge forest, faces that appear with a split,
// boxes, and the request by which a peer names the detail it lacks.
// Source: Liu, Georganas, Roth 2006, section 3.3 (vertex hierarchy, VSP); ids and intervals are
// ours: vertices are numbered by depth-first order of the merge forest, kept child first, so a
// subtree is an interval of ids and its representative is the lowest. A split has the id of the
// vertex that it activates.

#include <array>
#include <compare>
#include <cstdint>
#include <cstdlib>
#include <span>
#include <string>
#include <vector>

#include "nearmesh/core/base/detail/ids.hpp"
#include "nearmesh/core/base/status.hpp"
#include "nearmesh/core/geometry/detail/grid.hpp"

namespace nearmesh {

/// A node of the merge forest: the vertices [first, first + size), represented by `first`.
/// Size 1 is a leaf: a vertex of the full mesh.
struct NodeSpan {
  VertexId first;
  std::uint32_t size = 0;

  [[nodiscard]] std::uint32_t begin() const { return first.value; }
  [[nodiscard]] std::uint32_t end() const { return first.value + size; }
  [[nodiscard]] bool contains(VertexId v) const { return v.value - first.value < size; }
  /// The children that the split activating `u` makes.
  [[nodiscard]] NodeSpan left_of(VertexId u) const { return {first, u.value - first.value}; }
  [[nodiscard]] NodeSpan right_of(VertexId u) const { return {u, end() - u.value}; }
  /// Preorder of the forest: ancestors before descendants, left before right.
  friend bool operator<(const NodeSpan& x, const NodeSpan& y) {
    return x.first != y.first ? x.first < y.first : x.size > y.size;
  }
  bool operator==(const NodeSpan&) const = default;
};
/// For messages: "node [3, 13)".
[[nodiscard]] std::string to_string(const NodeSpan& node);

/// A face of the full mesh. `left` lies in the left child of the split with which the face appears,
/// `right` in the right child, `outside` in neither. For base faces the three are in three roots.
/// Corners are vertices of the full mesh; the face of a coarser mesh has each replaced by its
/// nearest active predecessor.
struct SplitFace {
  VertexId left, right, outside;
  /// Counter-clockwise order is (right, left, outside) instead of (left, right, outside).
  bool flipped = false;

  [[nodiscard]] std::array<VertexId, 3> corners() const {
    // No branch: half of all faces are flipped.
    const std::uint32_t swap = (left.value ^ right.value) & -static_cast<std::uint32_t>(flipped);
    return {VertexId{left.value ^ swap}, VertexId{right.value ^ swap}, outside};
  }
  bool operator==(const SplitFace&) const = default;
};

/// Names a face on every peer without a number on the wire: the split it appears with (none for a
/// base face) and its place there. The publisher's file maps it to the FaceId of the input.
struct FaceKey {
  VertexId split;
  std::uint32_t index = 0;
  auto operator<=>(const FaceKey&) const = default;
};

/// The box of a node, log-quantised outward about the representative's position, in the order -x +x
/// -y +y -z +z; extent(code) is the smallest integer >= 2^(code/4) - 1. kNoBox in [0] means none.
using BoxCode = std::array<std::uint8_t, 6>;
inline constexpr std::uint8_t kNoBoxCode = 0xff;
inline constexpr std::uint8_t kMaxExtentCode = 124;
inline constexpr BoxCode kNoBox{kNoBoxCode, kNoBoxCode, kNoBoxCode,
                                kNoBoxCode, kNoBoxCode, kNoBoxCode};

inline constexpr int kDirectionBits = 12, kReachBits = 8;
/// A half-space of a node, as it is stored (half_space.hpp). For every point x of every face of the
/// full mesh that has a vertex in the node, p being the place of the node's vertex:
/// half_space_normal(direction) . (x - p) <= half_space_reach(reach).
struct HalfSpace {
  std::uint16_t direction = 0;  ///< below 2^kDirectionBits: a point of a 64 x 64 octahedral map
  std::uint8_t reach = 0;
  auto operator<=>(const HalfSpace&) const = default;
};
/// A half-space of a node: what batches tell.
struct NodeHalfSpace {
  NodeSpan node;
  HalfSpace half_space;
  friend bool operator<(const NodeHalfSpace& x, const NodeHalfSpace& y) {
    return x.node != y.node ? x.node < y.node : x.half_space < y.half_space;
  }
  bool operator==(const NodeHalfSpace&) const = default;
};

/// Slots, stored blocks of the lowest level, and the unit of eviction: maximal nodes of at most
/// this many ids.
inline constexpr std::uint32_t kSlotSize = 64;

/// A forest is no deeper: what walks from a node to its root takes no more steps, whoever made the
/// model. (Simplification balances depth; real models have some 20.)
inline constexpr std::uint32_t kMaxForestDepth = 4096;

/// Limits of one request; larger ones are refused where they arrive.
inline constexpr std::size_t kMaxRegionBoxes = 256;
inline constexpr std::size_t kMaxAttachNodes = 512;
inline constexpr std::uint32_t kMaxRequestSplits = 16384;

/// A part of a region, in a model's grid: the points p within `radius` of a closed box for which lo
/// <= (normal . p) / 128 <= hi. Boxes alone are a poor fit for a surface that runs askew to the
/// axes: the slab holds its thickness. A box that is grown instead of given a radius gains corners.
struct RegionPart {
  GridBox box;
  std::int32_t radius = 0;              ///< in [0, kMaxRegionRadius]
  std::array<std::int8_t, 3> normal{};  ///< |x| + |y| + |z| <= kMaxSlabNormal; all 0: no slab
  std::int32_t slab_lo = 0, slab_hi = 0;
  /// Nodes whose box's extent is no more are not asked for: the part stands for something that is
  /// itself not known better.
  std::int32_t min_extent = 0;

  RegionPart() = default;
  RegionPart(const GridBox& whole) : box(whole) {}  // NOLINT: a box is a region
  /// Whether a box may meet the part: true wherever it does. Integers only.
  [[nodiscard]] bool meets(const GridBox& other) const {
    std::int64_t square = 0, least = 0, most = 0;
    for (int k = 0; k < 3; ++k) {
      const std::int64_t lo = std::int64_t{box.lo[k]} - radius,
                         hi = std::int64_t{box.hi[k]} + radius;
      if (other.lo[k] > hi || other.hi[k] < lo) return false;
      const std::int64_t gap = std::max({std::int64_t{0}, std::int64_t{box.lo[k]} - other.hi[k],
                                         std::int64_t{other.lo[k]} - box.hi[k]});
      square += gap * gap;
      // What of the other box is near enough, along the normal.
      // NOLINTNEXTLINE(bugprone-signed-char-misuse): a number, not a character
      const auto n = static_cast<std::int64_t>(normal[static_cast<std::size_t>(k)]);
      const std::int64_t from = n * std::max<std::int64_t>(lo, other.lo[k]);
      const std::int64_t to = n * std::min<std::int64_t>(hi, other.hi[k]);
      least += std::min(from, to);
      most += std::max(from, to);
    }
    return square <= std::int64_t{radius} * radius && most >= std::int64_t{slab_lo} * 128 &&
           least <= std::int64_t{slab_hi} * 128;
  }
  /// Whether the part asks that a node with this box be split.
  [[nodiscard]] bool asks_for(const GridBox& node) const {
    return node.extent() > min_extent && meets(node);
  }
  bool operator==(const RegionPart&) const = default;
};
inline constexpr std::int32_t kMaxRegionRadius = 1 << 30;  ///< so that squares add up below 2^62
inline constexpr int kMaxSlabNormal = 127;
/// What is wrong with a part from outside; nullptr where nothing is.
[[nodiscard]] inline const char* fault_of(const RegionPart& part) {
  for (int k = 0; k < 3; ++k)
    if (part.box.lo[k] > part.box.hi[k]) return "an empty region box";
  if (part.radius < 0 || part.radius > kMaxRegionRadius) return "a radius outside [0, 2^30]";
  if (std::abs(part.normal[0]) + std::abs(part.normal[1]) + std::abs(part.normal[2]) >
      kMaxSlabNormal)
    return "a slab normal above 127";
  if (part.slab_lo > part.slab_hi) return "an empty slab";
  if (part.min_extent < 0) return "a least extent below 0";
  return nullptr;
}

/// "Send the splits below these nodes that matter to this region." The peer names its unresolved
/// nodes, so the publisher needs no memory of what a peer has, and whatever was lost is simply
/// asked for again.
struct RegionRequest {
  /// The peer's unresolved nodes, ascending, disjoint; at most kMaxAttachNodes.
  std::vector<NodeSpan> attach;
  std::vector<RegionPart> region;   ///< at most kMaxRegionBoxes
  std::uint32_t max_splits = 1024;  ///< at most kMaxRequestSplits; largest nodes come first

  /// Without a split: an audit. Asked for is the stored block that holds the split of the one node
  /// in `attach`; no region.
  [[nodiscard]] bool is_audit() const { return max_splits == 0; }
};
/// The rules for a request from outside that need no model: whoever receives one asks here first
/// (core/demand has the rest).
/// Errors: kInvalidArgument naming the limit, the node or the part.
[[nodiscard]] Status check_request(const RegionRequest& request);

/// One record of a batch: the split of `node` that activates `split`.
struct SplitRecord {
  NodeSpan node;
  VertexId split;
  /// Position of `split` minus that of node.first, grid units.
  std::array<std::int32_t, 3> offset{};
  std::uint32_t face_begin = 0, face_count = 0;  ///< in SplitBatch::faces
  BoxCode left_box = kNoBox, right_box = kNoBox;

  [[nodiscard]] NodeSpan left() const { return node.left_of(split); }
  [[nodiscard]] NodeSpan right() const { return node.right_of(split); }
};

/// The unit on the wire and in the file, decoded: parents before children.
struct SplitBatch {
  std::vector<SplitRecord> splits;
  std::vector<SplitFace> faces;
  std::vector<NodeHalfSpace> half_spaces;  ///< of nodes that the splits make, and of others
};

}  // namespace nearmesh
