// SPDX-License-Identifier: Apache-2.0
#pragma once
// Knowledge of a progressive mesh: the splits one has, parents before children. The publisher fills
// it from file blocks, a peer from batches; which of them are *active* is refine's matter. Ids are
// those of the whole model, but a store costs what it holds.

#include <algorithm>
#include <array>
#include <cstdint>
#include <span>
#include <unordered_map>
#include <vector>

#include "nearmesh/core/base/detail/sparse_array.hpp"
#include "nearmesh/core/base/status.hpp"
#include "nearmesh/core/spm/detail/header.hpp"

namespace nearmesh {

struct AxesBox;

/// A face as SplitFace::corners() gives it. The lower of the first two is the left one; equal, they
/// stand for no face.
struct FaceCorners {
  VertexId first{0}, second{0}, outside{0};

  FaceCorners() = default;
  constexpr FaceCorners(VertexId x, VertexId y, VertexId z) : first(x), second(y), outside(z) {}
  explicit FaceCorners(const std::array<VertexId, 3>& corners)
      : FaceCorners(corners[0], corners[1], corners[2]) {}
  [[nodiscard]] bool is_there() const { return first != second; }
  [[nodiscard]] SplitFace face() const {
    return {std::min(first, second), std::max(first, second), outside, second < first};
  }
  bool operator==(const FaceCorners&) const = default;
};

/// The faces of a split, by value: the store holds them in fewer bytes.
class SplitFaces {
 public:
  explicit SplitFaces(const std::vector<SplitFace>& many)
      : many_(many.data()), size_(many.size()) {}
  SplitFaces(const SplitFace& first, const SplitFace& second, std::size_t size)
      : few_{first, second}, size_(size) {}
  [[nodiscard]] std::size_t size() const { return size_; }
  [[nodiscard]] bool empty() const { return size_ == 0; }
  [[nodiscard]] const SplitFace* begin() const { return many_ != nullptr ? many_ : few_.data(); }
  [[nodiscard]] const SplitFace* end() const { return begin() + size_; }
  [[nodiscard]] const SplitFace& operator[](std::size_t i) const {
    NEARMESH_ASSERT(i < size_);
    return begin()[i];
  }
  /// While these live, and those of more than two their store.
  [[nodiscard]] std::span<const SplitFace> span() const { return {begin(), size_}; }

 private:
  std::array<SplitFace, 2> few_{};
  const SplitFace* many_ = nullptr;
  std::size_t size_ = 0;
};

class SplitStore {
 public:
  /// Knows the base mesh of `header`.
  explicit SplitStore(const SpmHeader& header);

  enum class Insertion : std::uint8_t {
    kAdded,
    kKnown,     ///< nothing new
    kBoxed,     ///< known, but for a box of one of its children, which was filled in
    kNoParent,  ///< the split that makes the record's node is not known; nothing was changed
  };
  /// Adds one split. `faces` are the record's own; `outside` is around those of their outside
  /// corners that the caller knows to be known.
  /// Errors: kCorrupt where the record contradicts the model or what is known (another split of the
  /// same node, another position or face, a position outside the grid, a forest deeper than
  /// kMaxForestDepth, a vertex or a face outside a box that must enclose it, a box that reaches
  /// farther than those above it); nothing is changed then.
  /// Cost: O(faces).
  [[nodiscard]] Result<Insertion> insert(const SplitRecord& record,
                                         std::span<const SplitFace> faces,
                                         const GridBox& outside = {});
  /// Around those outside corners of a split's faces of which `is_there` says that they are known:
  /// what insert() is told.
  template <class IsThere>
  [[nodiscard]] GridBox outside_of(std::span<const SplitFace> faces, IsThere is_there) const {
    GridBox outside;
    for (const SplitFace& face : faces)
      if (face.outside.value < vertex_count_ && is_there(face.outside))
        outside.add(position(face.outside));
    return outside;
  }
  /// Tells the processor that `split` will be inserted soon. No other effect, whatever the id.
  void prefetch(VertexId split) const { entries_.prefetch(split.value); }
  /// Forgets a split (eviction). Precondition: both children of its node are whole, i.e. no known
  /// split rests on it.
  void erase(VertexId split);

  [[nodiscard]] std::uint32_t vertex_count() const { return vertex_count_; }
  [[nodiscard]] std::uint32_t known_splits() const { return known_; }
  /// True for roots and for vertices whose split is known.
  [[nodiscard]] bool is_known(VertexId v) const { return entries_[v.value].size != 0; }
  [[nodiscard]] bool is_root(VertexId v) const {
    return is_known(v) && entries_[v.value].parent == v.value;
  }

  /// True when `node` is a root, or a child of a known split.
  [[nodiscard]] bool is_node(NodeSpan node) const;
  /// The split of a node, or an invalid id where it is not known. Precondition: is_node(node).
  [[nodiscard]] VertexId split_of(NodeSpan node) const;
  /// The node that a known split divides. Not for roots.
  [[nodiscard]] NodeSpan node_of(VertexId split) const {
    const Entry& entry = entries_[split.value];
    return {{entry.parent}, split.value + entry.size - entry.parent};
  }
  /// The node that a known vertex represents when its split has just been done (its root, for a
  /// root).
  [[nodiscard]] NodeSpan initial_node(VertexId v) const { return {v, entries_[v.value].size}; }
  /// The parent of a node; size 0 for a root. Precondition: is_node(node).
  [[nodiscard]] NodeSpan parent_of(NodeSpan node) const;

  /// Position of a known vertex. By value: what is inserted moves entries.
  [[nodiscard]] GridPoint position(VertexId v) const { return entries_[v.value].position; }

  /// The node's own box code, or kNoBox where none came.
  [[nodiscard]] BoxCode box_code(NodeSpan node) const;
  /// Whether one came: box_code(node) != kNoBox, for less.
  [[nodiscard]] bool has_box(NodeSpan node) const { return packed_box(node) != 0; }
  /// A box that encloses every original face that touches a vertex of the node: its own, or the
  /// nearest ancestor's. Precondition: is_node(node). O(1) but where boxes are missing.
  [[nodiscard]] GridBox box(NodeSpan node) const;
  /// Whether that box contains another. Faster than to ask it.
  [[nodiscard]] bool encloses(NodeSpan node, const GridBox& box) const;

  [[nodiscard]] SplitFaces faces(VertexId split) const {
    const Entry& entry = entries_[split.value];
    if (entry.faces[0] == kManyFaces) return SplitFaces(many_faces_.at(split.value));
    return {entry.faces[0].face(), entry.faces[1].face(),
            std::size_t{entry.faces[0].is_there()} + std::size_t{entry.faces[1].is_there()}};
  }
  /// The faces of a split that has at most two, both places of them; nullptr where it has more.
  /// Valid until something is inserted. For loops that are to have no branch.
  [[nodiscard]] const FaceCorners* two_faces(VertexId split) const {
    const Entry& entry = entries_[split.value];
    return entry.faces[0] == kManyFaces ? nullptr : entry.faces;
  }
  [[nodiscard]] std::span<const SplitFace> base_faces() const { return base_faces_; }
  [[nodiscard]] SplitFace face(FaceKey key) const {
    return key.split.is_valid() ? faces(key.split)[key.index] : base_faces_[key.index];
  }
  [[nodiscard]] const std::vector<BaseRoot>& roots() const { return roots_; }
  /// Of all roots: the model is in it, whatever is known of it.
  [[nodiscard]] const GridBox& whole_box() const { return whole_box_; }
  [[nodiscard]] const SurfaceFacts& surface() const { return surface_; }
  /// Greatest coordinate of the model's grid.
  [[nodiscard]] std::int32_t grid_max() const { return grid_max_; }
  /// Index of the root whose node holds v. O(log roots).
  [[nodiscard]] std::size_t root_index(VertexId v) const;

 private:
  static constexpr FaceCorners kManyFaces{VertexId{1}, VertexId{1}, VertexId{0}};
  /// Six codes of seven bits, each plus one; 0: none.
  using PackedBox = std::uint64_t;
  static constexpr int kCodeBits = 7, kBoxBits = 6 * kCodeBits, kBoxLowBits = 10;
  static constexpr PackedBox kBoxMask = (PackedBox{1} << kBoxBits) - 1;
  static_assert(kMaxExtentCode + 1 < 1 << kCodeBits);
  /// One entry per vertex id, a cache line; all zeros (an untouched page) means unknown.
  struct alignas(64) Entry {
    // Of the node that the vertex represents when it becomes active; 0: unknown.
    std::uint32_t size = 0;
    // First vertex of the node that split `id` divides (own id for a root).
    std::uint32_t parent = 0;
    std::uint32_t first_split = 0;  // split of [id, id + size); 0: unknown (id 0 is always a root)
    // Split of [parent, id), the left child of split `id`; 0: unknown.
    std::uint32_t next_split = 0;
    GridPoint position;
    std::uint32_t left_box_high = 0;  // of [parent, id)
    std::uint64_t left_box_low : kBoxLowBits = 0;
    std::uint64_t box : kBoxBits = 0;       // of [id, id + size)
    std::uint64_t depth_less_one : 12 = 0;  // of the two nodes that the split makes; not for a root
    FaceCorners faces[2];                   // kManyFaces: look in many_faces_

    [[nodiscard]] PackedBox left_box() const {
      return PackedBox{left_box_high} << kBoxLowBits | left_box_low;
    }
    void set_left_box(PackedBox code) {
      left_box_high = static_cast<std::uint32_t>(code >> kBoxLowBits);
      left_box_low = code & ((1U << kBoxLowBits) - 1);
    }
  };
  static_assert(sizeof(Entry) == 64 && kMaxForestDepth <= 1U << 12);

  [[nodiscard]] Status check(const SplitRecord& record, std::span<const SplitFace> faces) const;
  [[nodiscard]] const char* fault_of_boxes(const SplitRecord& record,
                                           std::span<const SplitFace> faces,
                                           const GridBox& outside);
  const GridBox& bounds_of(NodeSpan node);
  /// The node itself where it has a box of its own.
  [[nodiscard]] NodeSpan boxed_ancestor(NodeSpan node) const;
  [[nodiscard]] AxesBox own_box(NodeSpan node) const;
  [[nodiscard]] bool is_within_reach(const SplitRecord& record, const GridPoint& at,
                                     const BoxCode& code) const;
  [[nodiscard]] std::uint32_t& split_slot(NodeSpan node);
  /// The node's own box as entries hold it.
  [[nodiscard]] PackedBox packed_box(NodeSpan node) const {
    const Entry& first = entries_[node.begin()];
    if (node.size == first.size) return first.box;
    const Entry& maker = entries_[node.end()];
    NEARMESH_ASSERT(maker.size != 0 && maker.parent == node.begin());
    return maker.left_box();
  }
  [[nodiscard]] std::uint32_t depth_of(NodeSpan node) const {
    const bool initial = node.size == entries_[node.begin()].size;
    const VertexId maker{initial ? node.begin() : node.end()};
    return is_root(maker) ? 0
                          : static_cast<std::uint32_t>(entries_[maker.value].depth_less_one) + 1;
  }

  std::uint32_t vertex_count_ = 0;
  std::uint32_t known_ = 0;
  std::int32_t grid_max_ = 0;
  SparseArray<Entry> entries_;
  // Splits with more than two.
  std::unordered_map<std::uint32_t, std::vector<SplitFace>> many_faces_;
  NodeSpan bounded_;  // of the last bounds_of(): a node and its own box
  GridBox bounds_;
  std::vector<BaseRoot> roots_;
  GridBox whole_box_;
  std::vector<SplitFace> base_faces_;
  SurfaceFacts surface_;
};

/// extent(code), see BoxCode.
[[nodiscard]] std::int64_t box_extent(std::uint8_t code);
/// The smallest code whose extent is at least x >= 0.
[[nodiscard]] std::uint8_t box_extent_code(std::int64_t x);
/// What a code encloses about `representative`, cut to the grid: faces lie in that.
[[nodiscard]] GridBox decode_box(const GridPoint& representative, const BoxCode& code,
                                 std::int32_t grid_max);
/// The tightest code that encloses `box` about `representative`, which must lie inside.
[[nodiscard]] BoxCode encode_box(const GridPoint& representative, const GridBox& box);

}  // namespace nearmesh
