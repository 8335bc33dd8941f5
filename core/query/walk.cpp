// SPDX-License-Identifier: Apache-2.0
// The walk of two trees at once: from the pair of both roots down to the pairs of faces that touch,
// and to the pairs with an unresolved node that may.
//
// 1. The work list. It holds pairs of entries, one of each tree, that are not proved apart. There
//    are three kinds of pairs:
//
//      inner x anything       One of them is opened: the larger, in metres, where both are inner.
//                             Its eight lanes are held against the other part at once, and those
//                             not apart go on the list.
//      block x block          An "end". Ends go on a list of their own; test_latest_ends() decides
//                             their faces.
//      block or node x node   An end as well, since an unresolved node cannot be opened. leave()
//                             notes it for the caller, unless no face of the block comes near the
//                             node.
//
//    For example (a: root R over nodes P and Q, Q over blocks; b: one block S):
//
//      list      ends           done
//      (R, S)                   R is opened: P is apart from S, Q is not
//      (Q, S)                   Q is opened: block 1 and unresolved node 4 are not apart from S
//                (1, S) (4, S)  the faces of 1 and S are tested, (4, S) is left to the caller
//
// 2. Why it ends, and loses nothing. Each step takes a pair off and puts on pairs one level deeper,
//    and trees are finite. A pair is dropped only where a test proves it apart, and then all below
//    it is apart, since bounds enclose what is below (core/THEOREM.md). So each touching pair of
//    exact faces, and each pair with an unresolved node that is not proved apart, is found.
//
// 3. Eight pairs in flight. A test of eight lanes is a long chain of operations, each of which
//    waits for the one before, and what comes of it cannot be predicted. So look_at_latest() takes
//    the latest eight pairs off the list and does each step for all of them before the next,
//    without branches that depend on data:
//
//      pop 8 pairs -> plan: which side is opened? -> (cull) -> test 8 x 8 lanes
//                                                           -> push what is left, last pair first
//
//    The latest are taken, not the oldest, so the list stays short: depth first, eight abreast.
//    Where one contact suffices (kAny), the first 64 nodes are opened one by one instead, deepest
//    overlap first: a contact is likely to be found among them, and every node opened beside the
//    way is lost. Until then ends stand on the list among the others, in the order of their depth.
//
// 4. What is placed when. Both trees are in their own grids, and tests need the boxes of one in the
//    units of the other. A node (eight boxes and slabs) or a block (eight faces) is placed in both
//    bodies' units when a test first reads it, for this pair of poses, as floats rounded outwards
//    (box_kernels.hpp). Some 64 placed last are kept for each tree (walk_memory.hpp): a walk comes
//    back to the same ones, and most nodes are never reached.
//
// 5. The funnel of faces. Of two blocks first each face of a is held against b's box, then against
//    b's faces eight at a time, by planes and axes in floats; what is left is collected over blocks
//    into eights and decided in doubles (triangle_kernels.hpp), and only what rounding leaves open
//    is decided exactly on posed integers.
//
// The whole walk is made once for each instruction set, so that its tests, a hundred or more a
// query, are inlined. Each finds the same answer, bit for bit.
#undef HWY_TARGET_INCLUDE
// NOLINTNEXTLINE(readability-identifier-naming): Highway's name
#define HWY_TARGET_INCLUDE "core/query/walk.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

#include <algorithm>
#include <bit>

#include "core/geometry/triangle_overlap.hpp"
#include "lane_lists.hpp"
#include "walk.hpp"
#include "walk_memory.hpp"
//
#include "core/geometry/box_kernels.hpp"
#include "core/geometry/triangle_kernels.hpp"

HWY_BEFORE_NAMESPACE();
namespace nearmesh::HWY_NAMESPACE {

/// One body: its tree's nodes and blocks, placed when they are first asked for.
class WalkedBody {
 public:
  WalkedBody(const TreeView& tree, const RelativeFrame& in_other, const RelativeFrame& other_in,
             double cell_m, PlacedTreeNodes& nodes, PlacedTreeBlocks& blocks)
      : nodes_(tree.nodes.data()),
        blocks_(tree.blocks.data()),
        placing_(in_other, other_in, tree.nodes[0].boxes.box(0)),
        cell_m_(cell_m),
        placed_nodes_(nodes),
        placed_blocks_(blocks) {}

  [[nodiscard]] HWY_INLINE const PlacedBoxes& placed_node(std::uint32_t node) {
    const PlacedBoxes* const held = placed_nodes_.find(node);
    return HWY_LIKELY(held != nullptr) ? *held : place_node(node);
  }
  [[nodiscard]] HWY_INLINE const PlacedFaces& placed_block(std::uint32_t block) {
    const PlacedFaces* const held = placed_blocks_.find(block);
    return HWY_LIKELY(held != nullptr) ? *held : place_block(block);
  }
  [[nodiscard]] float cells_ratio() const { return placing_.cells_ratio; }
  [[nodiscard]] const TreeNode& node(std::uint32_t node) const { return nodes_[node]; }
  [[nodiscard]] const FaceBlock& block(std::uint32_t block) const { return blocks_[block]; }
  [[nodiscard]] double size_m(TreePlace at) const {
    return static_cast<double>(nodes_[at / kLanes].size[at % kLanes]) * cell_m_;
  }
  [[nodiscard]] TreeEntry::Kind kind(TreePlace at) const {
    return nodes_[at / kLanes].kind(at % kLanes);
  }
  [[nodiscard]] bool is_coarse(TreePlace at) const {
    return nodes_[at / kLanes].is_coarse(at % kLanes);
  }
  [[nodiscard]] std::uint32_t first(TreePlace at) const {
    return nodes_[at / kLanes].first[at % kLanes];
  }
  [[nodiscard]] std::uint32_t count(TreePlace at) const {
    return nodes_[at / kLanes].kind_and_count[at % kLanes] >> 2;
  }
  /// Bits of the lanes of a node that are inner. Bits of empty ones mean nothing.
  [[nodiscard]] HWY_INLINE std::uint32_t inner_lanes(std::uint32_t node) const {
    static_assert(TreeEntry::Kind::kInner == TreeEntry::Kind{});
    const IntLanes d;
    std::uint32_t inner = 0;
    for (std::size_t lane = 0; lane < kLanes; lane += hn::Lanes(d)) {
      const hn::Rebind<std::uint32_t, IntLanes> unsigned_d;
      const auto kinds = hn::And(hn::LoadU(unsigned_d, nodes_[node].kind_and_count + lane),
                                 hn::Set(unsigned_d, 3));
      inner |= bits_of(hn::RebindMask(FloatLanes(), hn::Eq(kinds, hn::Zero(unsigned_d)))) << lane;
    }
    return inner;
  }

 private:
  HWY_NOINLINE const PlacedBoxes& place_node(std::uint32_t node) {
    PlacedBoxes& out = placed_nodes_.add(node);
    place_boxes_inline(placing_, nodes_[node].boxes, out);
    return out;
  }
  HWY_NOINLINE const PlacedFaces& place_block(std::uint32_t block) {
    PlacedFaces& out = placed_blocks_.add(block);
    place_faces_inline(placing_, blocks_[block].triangles, out);
    return out;
  }

  const TreeNode* nodes_;
  const FaceBlock* blocks_;
  const Placing placing_;
  const double cell_m_;
  PlacedTreeNodes& placed_nodes_;
  PlacedTreeBlocks& placed_blocks_;
};

template <Seeks kSeeks>
class Walk {
 public:
  Walk(const Scene& scene, WalkMemory& memory, const WalkLimits& limits, WalkFinds& finds,
       QueryStats& stats)
      : s_(scene),
        stack_(memory.stack),
        ends_(memory.ends),
        bodies_{{scene.a, scene.a_in_b(), scene.b_in_a, scene.cell_a_m, memory.nodes[0],
                 memory.blocks[0]},
                {scene.b, scene.b_in_a, scene.a_in_b(), scene.cell_b_m, memory.nodes[1],
                 memory.blocks[1]}},
        limits_(limits),
        next_look_(limits.is_over != nullptr ? std::min(limits.max_tests, kTestsALook)
                                             : limits.max_tests),
        finds_(finds),
        pairs_(finds.pairs),
        unresolved_(finds.unresolved),
        stats_(stats) {}

  // The caller has seen that the roots are not apart. False: the tests were spent first.
  bool run() {
    const PendingPair roots = {{0, 0}, {kAllLanes, kAllLanes}};
    PairStack& first = kAny || has_inner(roots) ? stack_ : ends_;
    first.reserve(1);
    first.push(roots);
    bool is_whole = true;
    while ((stack_.size | ends_.size) != 0) {
      // Ends wait for company, but not where the first contact is the last one wanted.
      if (stack_.size == 0 || ends_.size >= (kAny ? 1 : kEnds)) {
        test_latest_ends();
      } else if (kAny && opened_ < kHopeful) {
        look_at_deepest();
      } else {
        look_at_latest();
      }
      if (kAny && !pairs_.empty()) return true;
      if (HWY_UNLIKELY(tests_of(stats_) >= next_look_) && (stack_.size | ends_.size) != 0 &&
          is_over()) {
        is_whole = false;
        break;
      }
      if (HWY_UNLIKELY(unresolved_.size() > finds_.most_unresolved ||
                       pairs_.size() > finds_.most_pairs))
        finds_.hand_on();
    }
    if (pair_count_ != 0) test_pairs();  // what was collected last
    return is_whole;
  }

 private:
  using Kind = TreeEntry::Kind;
  HWY_NOINLINE bool is_over() {
    const std::uint64_t spent = tests_of(stats_);
    if (spent >= limits_.max_tests || (*limits_.is_over)()) return true;
    next_look_ = std::min(limits_.max_tests, spent + kTestsALook);
    return false;
  }
  static constexpr bool kAny = kSeeks == Seeks::kAnyPair;

  [[nodiscard]] bool is_inner(std::uint32_t side, TreePlace at) const {
    return bodies_[side].kind(at) == Kind::kInner;
  }
  [[nodiscard]] bool has_inner(const PendingPair& pair) const {
    return is_inner(0, pair.place[0]) || is_inner(1, pair.place[1]);
  }

  // Where one contact suffices, the part that reaches deepest into the other comes next: it is the
  // likeliest to have it. With branches, which the processor may guess ahead of the tests: there is
  // but one at a time.
  void look_at_deepest() {
    const PendingPair pair = stack_.pop();
    const bool inner_a = is_inner(0, pair.place[0]), inner_b = is_inner(1, pair.place[1]);
    if (!inner_a && !inner_b) {
      ends_.reserve(1);
      ends_.push(pair);
      return;
    }
    if (inner_a &&
        (!inner_b || bodies_[0].size_m(pair.place[0]) >= bodies_[1].size_m(pair.place[1]))) {
      open_by_depth<0>(pair);
    } else {
      open_by_depth<1>(pair);
    }
    if (++opened_ == kHopeful) set_ends_apart();
  }

  // From then on the list has none.
  void set_ends_apart() {
    const std::size_t size = std::exchange(stack_.size, 0);
    for (std::size_t i = 0; i < size; ++i) {
      const PendingPair pair = stack_.at(i);
      PairStack& to = has_inner(pair) ? stack_ : ends_;
      to.reserve(1);
      to.push(pair);
    }
  }

  // The latest few pairs at once, so that one test need not wait for the other: what comes of it
  // can not be predicted.
  void look_at_latest() {
    const std::size_t count = std::min(stack_.size, kBatch);
    Opened opened[kBatch];
    std::size_t opened_count = 0;
    for (std::size_t i = 0; i < count; ++i) {
      const PendingPair pair = stack_.pop();
      if (kSeeks == Seeks::kUnresolved && !bodies_[0].is_coarse(pair.place[0]) &&
          !bodies_[1].is_coarse(pair.place[1]))
        continue;  // nothing but exact faces below
      Opened& next = opened[opened_count];
      plan(pair, next);
      if (HWY_UNLIKELY(static_cast<int>(bodies_[next.side ^ 1].kind(next.other) == Kind::kFaces) &
                       static_cast<int>(next.is_worth_culling)))
        cull(pair, next);
      opened_count += next.close != 0 ? 1 : 0;
    }
    stack_.reserve(kBatch * kLanes);
    ends_.reserve(kBatch * kLanes);
    for (std::size_t i = 0; i < opened_count; ++i) test(opened[i]);
    // What comes of the pair that was on top comes on top again: depth first.
    for (std::size_t i = opened_count; i-- > 0;) push(opened[i]);
  }

  /// Lanes of a node of one side's that may meet a part of the other's.
  struct Opened {
    std::uint32_t side;
    TreePlace first, other;
    std::uint8_t faces[2];
    std::uint32_t close;
    bool is_worth_culling;
  };

  // Which of two parts to open: the larger of two inner ones, a's of equals. Without branches: they
  // could not be predicted. Precondition: one of them is inner.
  HWY_INLINE void plan(const PendingPair& pair, Opened& out) {
    const double sizes_m[2] = {bodies_[0].size_m(pair.place[0]), bodies_[1].size_m(pair.place[1])};
    const auto inner_a = static_cast<std::uint32_t>(is_inner(0, pair.place[0])),
               inner_b = static_cast<std::uint32_t>(is_inner(1, pair.place[1]));
    const std::uint32_t side =
        (inner_a ^ 1U) | (inner_b & static_cast<std::uint32_t>(sizes_m[0] < sizes_m[1]));
    const WalkedBody& own = bodies_[side];
    const std::uint32_t node = own.first(pair.place[side]);
    out = {side,
           node * kLanes,
           pair.place[side ^ 1],
           {pair.faces[0], pair.faces[1]},
           own.node(node).lanes,
           is_worth_culling(sizes_m[side], sizes_m[side ^ 1])};
  }

  // Single faces are much thinner than their block. Where the block is much larger than what it is
  // held against, a look at each of them saves most of what is below; else it costs as much as it
  // saves.
  static bool is_worth_culling(double own_m, double block_m) { return block_m > 2 * own_m; }
  HWY_NOINLINE void cull(const PendingPair& pair, Opened& out) {
    const std::uint32_t other = out.side ^ 1;
    out.faces[other] = static_cast<std::uint8_t>(close_faces(other, pair));
    if (out.faces[other] == 0) out.close = 0;
  }

  // Of the faces of one side's block: those that may meet the other side's part.
  template <bool kGuess = false>
  HWY_INLINE std::uint32_t close_faces(std::uint32_t side, const PendingPair& pair) {
    const TreePlace own = pair.place[side], other = pair.place[side ^ 1];
    const std::uint32_t faces = pair.faces[side] & ((1U << bodies_[side].count(own)) - 1);
    return faces & ~faces_apart_inline<kGuess>(bodies_[side].placed_block(bodies_[side].first(own)),
                                               faces, bodies_[side ^ 1].placed_node(other / kLanes),
                                               other % kLanes, bodies_[side].cells_ratio());
  }

  // Leaves in `close` the lanes that may meet the other part.
  HWY_INLINE void test(Opened& out) {
    WalkedBody& own = bodies_[out.side];
    out.close &= ~boxes_apart_inline<false>(own.placed_node(out.first / kLanes),
                                            bodies_[out.side ^ 1].placed_node(out.other / kLanes),
                                            out.other % kLanes, own.cells_ratio(), nullptr);
    stats_.box_tests += kLanes;
  }

  // Opens one node and pushes its lanes so that the one that overlaps most comes off the list
  // first.
  template <std::uint32_t kSide>
  void open_by_depth(const PendingPair& pair) {
    WalkedBody &own = bodies_[kSide], &other = bodies_[kSide ^ 1];
    const std::uint32_t node = own.first(pair.place[kSide]);
    const TreePlace partner = pair.place[kSide ^ 1];
    float depths[kLanes];
    std::uint32_t close =
        own.node(node).lanes &
        ~boxes_apart_inline<true>(own.placed_node(node), other.placed_node(partner / kLanes),
                                  partner % kLanes, own.cells_ratio(), depths);
    stats_.box_tests += kLanes;
    std::uint32_t lanes[kLanes];
    std::size_t count = 0;
    for (; close != 0; close &= close - 1) {
      const auto lane = static_cast<std::uint32_t>(std::countr_zero(close));
      std::size_t at = count++;  // insertion, farthest first
      for (; at > 0 && depths[lanes[at - 1]] < depths[lane]; --at) lanes[at] = lanes[at - 1];
      lanes[at] = lane;
    }
    stack_.reserve(kLanes);
    const double block_m = other.kind(partner) == Kind::kFaces ? other.size_m(partner) : 0;
    for (std::size_t i = 0; i < count; ++i) {
      PendingPair next = pair;
      next.place[kSide] = node * kLanes + lanes[i];
      if (is_worth_culling(own.size_m(next.place[kSide]), block_m)) {
        next.faces[kSide ^ 1] = static_cast<std::uint8_t>(close_faces<true>(kSide ^ 1, next));
        if (next.faces[kSide ^ 1] == 0) continue;
      }
      stack_.push(next);
    }
  }

  HWY_INLINE void push(const Opened& opened) {
    const std::uint32_t inner = is_inner(opened.side ^ 1, opened.other)
                                    ? kAllLanes
                                    : bodies_[opened.side].inner_lanes(opened.first / kLanes);
    push_lanes(opened, opened.close & inner, stack_);
    push_lanes(opened, opened.close & ~inner, ends_);
  }

  // The first lane comes on top. Eight are written whatever `lanes` says, and as many counted as it
  // has; what is beyond the size is written over by the next.
  HWY_INLINE static void push_lanes(const Opened& opened, std::uint32_t lanes, PairStack& to) {
    const hn::CappedTag<std::uint32_t, kLanes> d;
    const hn::Rebind<std::uint8_t, decltype(d)> bytes;
    std::uint32_t* const own = to.place[opened.side] + to.size;
    std::uint32_t* const other = to.place[opened.side ^ 1] + to.size;
    const std::uint8_t* const order = kLanesOf[lanes].data();
    for (std::size_t i = 0; i < kLanes; i += hn::Lanes(d)) {
      const auto listed = hn::PromoteTo(d, hn::LoadU(bytes, order + i));
      hn::StoreU(hn::Add(listed, hn::Set(d, opened.first)), d, own + i);
      hn::StoreU(hn::Set(d, opened.other), d, other + i);
      hn::StoreU(hn::Set(d, opened.faces[0] | std::uint32_t{opened.faces[1]} << kLanes), d,
                 to.faces + to.size + i);
    }
    to.size += static_cast<std::size_t>(std::popcount(lanes));
  }

  // Pairs of parts neither of which is inner, the latest few at once.
  void test_latest_ends() {
    FaceAndBlock faces[kEnds * kLanes];
    std::size_t face_count = 0;
    // First each face of a's block against the whole of b's block.
    for (std::size_t left = std::min(ends_.size, kEnds); left > 0; --left) {
      const PendingPair pair = ends_.pop();
      const TreePlace a = pair.place[0], b = pair.place[1];
      if (HWY_UNLIKELY(bodies_[0].kind(a) != Kind::kFaces || bodies_[1].kind(b) != Kind::kFaces)) {
        leave(pair);
        continue;
      }
      if (kSeeks == Seeks::kUnresolved) continue;
      const std::uint32_t count_b = bodies_[1].count(b);
      stats_.triangle_tests += std::uint64_t{bodies_[0].count(a)} * count_b;
      const TreePlace first = bodies_[0].first(a) * kLanes;
      for (std::uint32_t close = close_faces(0, pair); close != 0; close &= close - 1)
        faces[face_count++] = {first + static_cast<std::uint32_t>(std::countr_zero(close)),
                               bodies_[1].first(b), pair.faces[1] & ((1U << count_b) - 1)};
    }
    // Then each face that is left against b's faces one by one, eight at a time.
    for (std::size_t i = 0; i < face_count; ++i) {
      const FaceAndBlock& pair = faces[i];
      const std::uint32_t apart =
          faces_apart_inline<false>(bodies_[1].placed_block(pair.block_b), pair.faces_b,
                                    bodies_[0].placed_block(pair.face_a / kLanes).boxes,
                                    pair.face_a % kLanes, bodies_[1].cells_ratio());
      for (std::uint32_t close = pair.faces_b & ~apart; close != 0; close &= close - 1) {
        faces_a_[pair_count_] = pair.face_a;
        faces_b_[pair_count_++] =
            pair.block_b * kLanes + static_cast<std::uint32_t>(std::countr_zero(close));
        if (pair_count_ == kLanes) {
          test_pairs();
          if (kAny && !pairs_.empty()) return;
        }
      }
    }
    if (kAny && pair_count_ != 0) test_pairs();
  }

  // Faces that no plane of theirs and no axis parts, up to eight pairs.
  void test_pairs() {
    TriangleLanes a, b;
    for (std::uint32_t i = 0; i < pair_count_; ++i) {
      a.set(i, face(0, faces_a_[i]));
      b.set(i, face(1, faces_b_[i]));
    }
    const PairVerdicts verdicts = test_triangles_inline(s_.b_in_a, a, b, (1U << pair_count_) - 1);
    for (std::uint32_t i = 0; i < pair_count_; ++i) {
      if ((verdicts.apart >> i & 1U) != 0) continue;
      // In neither: too near to tell in doubles, so it is decided exactly.
      if ((verdicts.touching >> i & 1U) == 0) {
        ++stats_.exact_tests;
        if (!triangles_overlap(pose_triangle(s_.frame_a, a.corners(i)),
                               pose_triangle(s_.frame_b, b.corners(i))))
          continue;
      }
      pairs_.push_back({bodies_[0].block(faces_a_[i] / kLanes).keys[faces_a_[i] % kLanes],
                        bodies_[1].block(faces_b_[i] / kLanes).keys[faces_b_[i] % kLanes]});
      if (kAny) break;
    }
    pair_count_ = 0;
  }
  [[nodiscard]] std::array<GridPoint, 3> face(std::uint32_t side, std::uint32_t at) const {
    return bodies_[side].block(at / kLanes).triangles.corners(at % kLanes);
  }

  // A pair of which one at least is unresolved. What such a pair needs, the caller decides when all
  // are known: most nodes appear in many pairs.
  HWY_NOINLINE void leave(const PendingPair& pair) {
    std::uint32_t faces = 0;
    for (const std::uint32_t side : {0U, 1U})
      if (bodies_[side].kind(pair.place[side]) == Kind::kFaces &&
          (faces = close_faces(side, pair)) == 0)
        return;
    unresolved_.push_back({pair.place[0], pair.place[1], faces});
  }

  struct FaceAndBlock {
    std::uint32_t face_a, block_b, faces_b;
  };

  // Pairs in flight; nodes opened one by one where one contact suffices; ends collected before they
  // are tested.
  static constexpr std::size_t kBatch = 8, kHopeful = 64, kEnds = 2 * kBatch;
  const Scene& s_;
  PairStack &stack_, &ends_;
  WalkedBody bodies_[2];
  std::size_t opened_ = 0;
  std::uint32_t faces_a_[kLanes], faces_b_[kLanes], pair_count_ = 0;
  const WalkLimits limits_;
  std::uint64_t next_look_;  // in tests
  WalkFinds& finds_;
  std::vector<FacePair>& pairs_;
  std::vector<UnresolvedPair>& unresolved_;
  QueryStats& stats_;
};

bool walk_all(const Scene& scene, Seeks seeks, const WalkLimits& limits, WalkMemory& memory,
              WalkFinds& finds, QueryStats& stats) {
  switch (seeks) {
    case Seeks::kPairs:
      break;
    case Seeks::kAnyPair:
      return Walk<Seeks::kAnyPair>(scene, memory, limits, finds, stats).run();
    case Seeks::kUnresolved:
      return Walk<Seeks::kUnresolved>(scene, memory, limits, finds, stats).run();
  }
  return Walk<Seeks::kPairs>(scene, memory, limits, finds, stats).run();
}

}  // namespace nearmesh::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace nearmesh {

HWY_EXPORT(walk_all);

Scene::Scene(const TreeView& tree_a, const PosedFrame& posed_a, const TreeView& tree_b,
             const PosedFrame& posed_b)
    : a(tree_a),
      b(tree_b),
      frame_a(posed_a),
      frame_b(posed_b),
      b_in_a(make_relative_frame(posed_a, posed_b)),
      cell_a_m(std::ldexp(1.0, tree_a.grid->exponent)),
      cell_b_m(std::ldexp(1.0, tree_b.grid->exponent)) {}

const RelativeFrame& Scene::a_in_b() const {
  if (!a_in_b_) a_in_b_ = make_relative_frame(frame_b, frame_a);
  return *a_in_b_;
}

bool walk_trees(const Scene& scene, Seeks seeks, const WalkLimits& limits, WalkFinds& finds,
                QueryStats& stats) {
  const TreeNode &a = scene.a.nodes[0], &b = scene.b.nodes[0];
  if (a.lanes == 0 || b.lanes == 0) return true;
  ++stats.box_tests;
  if (boxes_apart(scene.b_in_a, centered(a.boxes.box(0)), centered(b.boxes.box(0)))) return true;
  WalkMemory memory;
  return HWY_DYNAMIC_DISPATCH(walk_all)(scene, seeks, limits, memory, finds, stats);
}

}  // namespace nearmesh
#endif
