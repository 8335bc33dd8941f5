// SPDX-License-Identifier: Apache-2.0
// Streaming without a progressive mesh, as well as it can be done: original triangles, on demand.
//   clusters-checked: clusters of at most 32 triangles below a tree of boxes, eight a node. The
//   peer gets every node and
//     cluster that its own walk of both trees would open, so it can check that nothing is missing.
//   clusters-chosen: the same, but the server chooses: of a node that stands in the way it tells
//   half-spaces that part it from the
//     other body, or opens it, whichever is cheaper in all. The peer can check this, too.
//   clusters-chosen-ahead: the same, but what is chosen holds at each frame of the time ahead, too.
//   triangles-trusted: exactly the triangles whose box meets a box of the other body's triangles;
//   that these are all is the
//     server's word.
// A peer knows no base mesh: before triangles have come it can only say "free".

#include <algorithm>
#include <cmath>
#include <deque>
#include <map>
#include <set>

#include "clusters.hpp"
#include "core/base/stopwatch.hpp"
#include "methods.hpp"
#include "planner.hpp"

namespace nearmesh::chart {
namespace {

using FaceSet = std::map<FaceKey, TreeFace>;

// Faces of pairs of clusters whose posed boxes meet those of a face of the other cluster.
std::array<FaceSet, 2> candidates(const Clusters& a, const Clusters& b, const PosedPair& posed,
                                  const Walk& walked) {
  std::map<std::uint32_t, std::vector<LatticeBox>> boxes[2];
  const auto boxes_of = [&](std::size_t side,
                            std::uint32_t cluster) -> const std::vector<LatticeBox>& {
    const auto [at, is_new] = boxes[side].try_emplace(cluster);
    if (is_new)
      for (const TreeFace& face : (side == 0 ? a : b).node(cluster).faces) {
        LatticeBox box;
        for (std::size_t i = 0; i < 3; ++i) {
          const LatticePoint p = pose_point(side == 0 ? posed.a : posed.b, face.corners[i]);
          for (int k = 0; k < 3; ++k) {
            box.lo[k] = i == 0 ? p[k] : std::min(box.lo[k], p[k]);
            box.hi[k] = i == 0 ? p[k] : std::max(box.hi[k], p[k]);
          }
        }
        at->second.push_back(box);
      }
    return at->second;
  };
  std::array<FaceSet, 2> found;
  for (const auto& [i, j] : walked.clusters) {
    const auto &x = boxes_of(0, i), &y = boxes_of(1, j);
    for (std::size_t f = 0; f < x.size(); ++f)
      for (std::size_t g = 0; g < y.size(); ++g) {
        bool meet = true;
        for (int k = 0; k < 3; ++k)
          meet = meet && x[f].lo[k] <= y[g].hi[k] && y[g].lo[k] <= x[f].hi[k];
        if (!meet) continue;
        found[0].try_emplace(a.node(i).faces[f].key, a.node(i).faces[f]);
        found[1].try_emplace(b.node(j).faces[g].key, b.node(j).faces[g]);
      }
  }
  return found;
}

// ---- methods ------------------------------------------------------------------------------------

constexpr std::size_t kClusterFaces = 32;
constexpr std::size_t kOwnClusterFaces = 8;  // of a body that costs nothing to open

// Pieces in order of arrival, each with bits and faces; both bodies' faces are held as plain
// triangles.
class Rival : public Method {
 public:
  explicit Rival(const Scene& scene)
      : scene_(scene),
        a_(scene.a, kClusterFaces, true),
        b_(scene.b, scene.b_streamed ? kClusterFaces : kOwnClusterFaces, scene.b_streamed) {}

  void start() override {
    state_ = {};
    held_[0].clear();
    held_[1].clear();
    pending_.clear();
    asked_.reset();
    payload_ = 0;
    carried_ = 0;
    forget();
  }
  State receive(const Bodies& bodies, const PosedPair& posed, std::uint64_t max_bytes) override {
    if (!asked_ || !same(*asked_, posed)) {
      Stopwatch watch;
      const Walk walked = walk(a_, b_, posed);
      state_.query_s += watch.seconds();  // the peer's own walk, too
      std::deque<Piece> more = select(bodies, posed, walked);
      asked_ = posed;
      // A peer whose own walk finds all nodes open asks nothing; who trusts must ask each time.
      if (!more.empty() || asks_always()) {
        ++state_.requests;
        state_.request_bytes += kPoseBytes;
        begin_reply();
      }
      for (Piece& piece : more) pending_.push_back(std::move(piece));
    }
    take(max_bytes);
    answer(posed);
    return state_;
  }

 protected:
  struct Piece {
    std::size_t body;
    double bits;
    std::vector<TreeFace> faces;
  };
  virtual std::deque<Piece> select(const Bodies& bodies, const PosedPair& posed,
                                   const Walk& walked) = 0;
  [[nodiscard]] virtual bool asks_always() const = 0;
  virtual void forget() {}

  const Scene& scene_;
  Clusters a_, b_;
  std::array<FaceSet, 2> held_;
  State state_;

 private:
  static constexpr std::uint64_t kPoseBytes = 96;
  static constexpr std::uint64_t kReplyBytes = 16;  // what is this, and to which request
  static bool same(const PosedPair& x, const PosedPair& y) {
    return x.a.rotation == y.a.rotation && x.a.translation == y.a.translation &&
           x.b.rotation == y.b.rotation && x.b.translation == y.b.translation;
  }
  void begin_reply() {
    carried_ = state_.bytes;
    payload_ = 8.0 * kReplyBytes;
    open_ = true;
  }
  void take(std::uint64_t max_bytes) {
    if (open_ && pending_.empty()) {  // an empty reply
      const std::uint64_t after = carried_ + framed(kReplyBytes);
      if (after > max_bytes) return;
      state_.bytes = after;
      open_ = false;
    }
    while (!pending_.empty()) {
      const Piece& piece = pending_.front();
      const double bits = payload_ + piece.bits;
      const std::uint64_t after =
          carried_ + framed(static_cast<std::uint64_t>(std::ceil(bits / 8)));
      if (after > max_bytes) return;
      payload_ = bits;
      state_.bytes = after;
      for (const TreeFace& face : piece.faces) held_[piece.body].try_emplace(face.key, face);
      pending_.pop_front();
    }
    open_ = false;
  }
  void answer(const PosedPair& posed) {
    const bool complete = pending_.empty() && !open_;
    Stopwatch watch;
    std::array<TriangleTree, 2> trees;
    std::uint64_t held = 0, tree_bytes = 0;
    for (std::size_t i = 0; i < 2; ++i) {
      if (i == 1 && !scene_.b_streamed) continue;
      std::vector<TreeFace> faces;
      for (const auto& [key, face] : held_[i]) faces.push_back(face);
      held += faces.size();
      trees[i] = build_triangle_tree((i == 0 ? scene_.a : scene_.b).baked.header.grid, faces);
      tree_bytes +=
          trees[i].nodes.size() * sizeof(TreeNode) + trees[i].blocks.size() * sizeof(FaceBlock);
    }
    state_.tree_s += watch.lap();
    const TreeView a = trees[0].view(),
                   b = scene_.b_streamed ? trees[1].view() : scene_.b.tree.view();
    state_.pairs.clear();
    state_.contacts = {};
    if (!held_[0].empty() && (!scene_.b_streamed || !held_[1].empty())) {
      Answer found = query(a, posed.a, b, posed.b, {.clearance = Clearance::kNone});
      state_.query_s += watch.lap();
      state_.contacts = find_contacts(a, posed.a, b, posed.b, found);
      state_.pairs = std::move(found.pairs);
    }
    state_.answers = true;
    state_.finished = complete;
    state_.claim = !complete
                       ? (state_.pairs.empty() ? AnswerStatus::kUncertain : AnswerStatus::kPartial)
                   : state_.pairs.empty() ? AnswerStatus::kFree
                                          : AnswerStatus::kContact;
    state_.faces_held = held;
    state_.tree_bytes = tree_bytes;
  }

  std::deque<Piece> pending_;
  std::optional<PosedPair> asked_;
  double payload_ = 0;         // bits of the open reply
  std::uint64_t carried_ = 0;  // bytes before it
  bool open_ = false;
};

class CheckedRival : public Rival {
 public:
  explicit CheckedRival(const Scene& scene) : Rival(scene) {}

 protected:
  std::deque<Piece> select(const Bodies& /*bodies*/, const PosedPair& /*posed*/,
                           const Walk& walked) override {
    std::deque<Piece> pieces;
    const auto add = [&](std::size_t body, const std::vector<std::uint32_t>& opened,
                         const Clusters& clusters) {
      for (const std::uint32_t i : opened)
        if (known_[body].insert(i).second)
          pieces.push_back({body, clusters.node(i).bits, clusters.node(i).faces});
    };
    add(0, walked.a, a_);
    if (scene_.b_streamed) add(1, walked.b, b_);
    // Boxes first, then triangles of both bodies in turn, as the tree's order has them.
    std::stable_partition(pieces.begin(), pieces.end(),
                          [](const Piece& piece) { return piece.faces.empty(); });
    return pieces;
  }
  [[nodiscard]] bool asks_always() const override { return false; }
  void forget() override {
    for (auto& nodes : known_) nodes.clear();
  }

 private:
  std::array<std::set<std::uint32_t>, 2> known_;
};

class ChosenRival : public Rival {
 public:
  ChosenRival(const Scene& scene, double lookahead_s)
      : Rival(scene), lookahead_s_(lookahead_s), open_{all_open(a_), all_open(b_)} {}

 protected:
  std::deque<Piece> select(const Bodies& bodies, const PosedPair& posed,
                           const Walk& /*walked*/) override {
    std::array<Planner::Plan, 2> plans = choose({posed});
    if (lookahead_s_ > 0 && (needs_more(0, plans[0]) || needs_more(1, plans[1])))
      plans = choose(instants_ahead(bodies, posed));
    std::deque<Piece> pieces;
    for (std::size_t body = 0; body < 2; ++body) {
      for (const std::uint32_t i : plans[body].opened)
        if (const Node& node = (body == 0 ? a_ : b_).node(i); known_[body].insert(i).second)
          pieces.push_back({body, node.bits, node.faces});
      for (const auto& [i, half_spaces] : plans[body].told) {
        std::vector<HalfSpace>& told = told_[body][i];
        told.insert(told.end(), half_spaces.begin(), half_spaces.end());
        pieces.push_back({body, kHalfSpaceBits * static_cast<double>(half_spaces.size()), {}});
      }
    }
    std::stable_partition(pieces.begin(), pieces.end(),
                          [](const Piece& piece) { return piece.faces.empty(); });
    return pieces;
  }
  [[nodiscard]] bool asks_always() const override { return false; }
  void forget() override {
    for (auto& nodes : known_) nodes.clear();
    for (auto& told : told_) told.clear();
  }

 private:
  // One body is planned against all faces of the other, that one against what the peer will hold of
  // the first; the cheaper of both orders. Whatever is not open of the second was parted from all
  // of the first, and the other way round.
  [[nodiscard]] std::array<Planner::Plan, 2> choose(const std::vector<PosedPair>& times) const {
    std::array<std::vector<Instant>, 2> instants;
    for (const PosedPair& posed : times) {
      const RelativeFrame b_in_a = make_relative_frame(posed.a, posed.b),
                          a_in_b = make_relative_frame(posed.b, posed.a);
      instants[0].push_back({b_in_a, a_in_b});
      instants[1].push_back({a_in_b, b_in_a});
    }
    const auto plan_of = [&](std::size_t body, const std::vector<Part>& others) {
      return Planner(body == 0 ? a_ : b_, known_[body], told_[body], instants[body]).plan(others);
    };
    std::array<Planner::Plan, 2> plans{plan_of(0, open_[1]), {}};
    if (!scene_.b_streamed) return plans;
    plans[1] = plan_of(1, plans[0].parts);
    Planner::Plan b_first = plan_of(1, open_[0]), a_second = plan_of(0, b_first.parts);
    if (b_first.bits + a_second.bits < plans[0].bits + plans[1].bits)
      plans = {std::move(a_second), std::move(b_first)};
    return plans;
  }
  [[nodiscard]] bool needs_more(std::size_t body, const Planner::Plan& plan) const {
    return !plan.told.empty() ||
           std::any_of(plan.opened.begin(), plan.opened.end(),
                       [&](std::uint32_t i) { return !known_[body].contains(i); });
  }
  // Now, and each frame ahead if the bodies move on as they do.
  [[nodiscard]] std::vector<PosedPair> instants_ahead(const Bodies& bodies,
                                                      const PosedPair& posed) const {
    std::vector<PosedPair> times{posed};
    for (int frame = 1; frame * kFrame_s <= lookahead_s_ + kFrame_s / 2; ++frame)
      times.push_back(pose_pair(scene_.a.baked.header.grid, pose_at(bodies.a, frame * kFrame_s),
                                "a", scene_.b.baked.header.grid,
                                pose_at(bodies.b, frame * kFrame_s), "b")
                          .value());
    return times;
  }

  const double lookahead_s_;
  const std::array<std::vector<Part>, 2> open_;
  std::array<std::set<std::uint32_t>, 2> known_;
  std::array<HalfSpaces, 2> told_;
};

class TrustedRival : public Rival {
 public:
  explicit TrustedRival(const Scene& scene) : Rival(scene) {}

 protected:
  // Pieces of some 8 triangles so that what has come can be used; coded as one.
  std::deque<Piece> select(const Bodies& /*bodies*/, const PosedPair& posed,
                           const Walk& walked) override {
    std::deque<Piece> pieces;
    const auto found = candidates(a_, b_, posed, walked);
    for (std::size_t body = 0; body < (scene_.b_streamed ? 2U : 1U); ++body) {
      std::vector<TreeFace> faces;
      for (const auto& [key, face] : found[body])
        if (known_[body].insert(key).second) faces.push_back(face);
      if (faces.empty()) continue;
      const double bits = (body == 0 ? a_ : b_).bits(faces, faces.front().corners[0]) +
                          3.0 * (body == 0 ? scene_.a : scene_.b).baked.header.grid.bits;
      constexpr std::size_t kPiece = 8;
      for (std::size_t at = 0; at < faces.size(); at += kPiece) {
        const std::size_t count = std::min(kPiece, faces.size() - at);
        const auto first = faces.begin() + static_cast<std::ptrdiff_t>(at);
        pieces.push_back({body,
                          bits * static_cast<double>(count) / static_cast<double>(faces.size()),
                          {first, first + static_cast<std::ptrdiff_t>(count)}});
      }
    }
    return pieces;
  }
  [[nodiscard]] bool asks_always() const override { return true; }
  void forget() override {
    for (auto& keys : known_) keys.clear();
  }

 private:
  std::array<std::set<FaceKey>, 2> known_;
};

}  // namespace

std::unique_ptr<Method> make_checked_rival(const Scene& scene) {
  return std::make_unique<CheckedRival>(scene);
}
std::unique_ptr<Method> make_chosen_rival(const Scene& scene) {
  return std::make_unique<ChosenRival>(scene, 0);
}
std::unique_ptr<Method> make_rival_ahead(const Scene& scene) {
  return std::make_unique<ChosenRival>(scene, kLookahead_s);
}
std::unique_ptr<Method> make_trusted_rival(const Scene& scene) {
  return std::make_unique<TrustedRival>(scene);
}

struct NeededFaces::Impl {
  Clusters a, b;
  bool b_streamed;
};
NeededFaces::NeededFaces(const Scene& scene)
    : impl_(new Impl{Clusters(scene.a, kOwnClusterFaces, false),
                     Clusters(scene.b, kOwnClusterFaces, false), scene.b_streamed}) {}
NeededFaces::~NeededFaces() = default;
std::uint64_t NeededFaces::count(const PosedPair& posed) const {
  const auto found = candidates(impl_->a, impl_->b, posed, walk(impl_->a, impl_->b, posed));
  return std::max<std::uint64_t>(1, found[0].size() + (impl_->b_streamed ? found[1].size() : 0));
}

}  // namespace nearmesh::chart
