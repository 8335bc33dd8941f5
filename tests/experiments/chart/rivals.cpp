// SPDX-License-Identifier: Apache-2.0
// Streaming without a progressive mesh, as well as it can be done: original triangles, on demand.
//   clusters-checked: clusters of at most 32 triangles below a tree of boxes, eight a node. The peer gets every node and
//     cluster that its own walk of both trees would open, so it can check that nothing is missing.
//   clusters-chosen: the same, but the server chooses: of a node that stands in the way it tells half-spaces that part it from the
//     other body, or opens it, whichever is cheaper in all. The peer can check this, too.
//   triangles-trusted: exactly the triangles whose box meets a box of the other body's triangles; that these are all is the
//     server's word.
// Bytes: an ideal entropy coder with tables trained on the very mesh, for which nothing is charged; vertices by parallelogram
// over the gate, triangles by gates. A peer knows no base mesh: before triangles have come it can only say "free".

#include <algorithm>
#include <cmath>
#include <deque>
#include <map>
#include <set>

#include "core/base/stopwatch.hpp"
#include "core/query/choose_half_spaces.hpp"
#include "methods.hpp"
#include "nearmesh/core/geometry/detail/box_overlap.hpp"

namespace nearmesh::chart {
namespace {

// ---- bytes of triangles -------------------------------------------------------------------------

// What a symbol costs by its frequency in its context.
class SymbolCosts {
 public:
  void count(int context, int symbol) {
    auto& counts = counts_[context];
    ++counts[symbol];
    ++totals_[context];
  }
  [[nodiscard]] double bits(int context, int symbol) const {
    const auto total = totals_.find(context);
    if (total == totals_.end()) return 8;
    const auto& counts = counts_.at(context);
    const auto at = counts.find(symbol);
    const double times = at == counts.end() ? 0.5 : at->second;
    return -std::log2(times / total->second);
  }

 private:
  std::map<int, std::map<int, double>> counts_;
  std::map<int, double> totals_;
};

int bit_length(std::int64_t x) {
  int length = 0;
  for (std::uint64_t rest = static_cast<std::uint64_t>(std::abs(x)); rest != 0; rest >>= 1)
    ++length;
  return length;
}

enum Context : int {
  kGate,
  kKnownRank,
  kSeedAxis,
  kGateAxis = kSeedAxis + 3,
  kBoxAxis = kGateAxis + 3
};
enum Gate : int { kEnd, kNew, kKnown, kSeed };

// Calls symbol(context, symbol, raw bits) for all that coding the faces as one piece would emit. Corners that earlier pieces
// had are sent again.
template <class Emit>
void code_faces(const std::vector<TreeFace>& faces, const std::array<std::uint8_t, 3>& shift,
                const GridPoint& from, const Emit& emit) {
  std::map<GridPoint, int> numbers;
  std::vector<GridPoint> points;
  std::vector<int> recent;  // most recent last
  std::vector<std::array<int, 3>> corners;
  std::map<std::pair<int, int>, std::vector<std::size_t>> by_edge;
  for (std::size_t f = 0; f < faces.size(); ++f) {
    corners.emplace_back();
    for (std::size_t k = 0; k < 3; ++k) {
      const auto [at, is_new] =
          numbers.try_emplace(faces[f].corners[k], static_cast<int>(points.size()));
      if (is_new) points.push_back(faces[f].corners[k]);
      corners[f][k] = at->second;
    }
    for (std::size_t k = 0; k < 3; ++k)
      by_edge[std::minmax(corners[f][k], corners[f][(k + 1) % 3])].push_back(f);
  }
  std::vector<bool> sent(points.size()), done(faces.size());
  GridPoint last = from;
  const auto emit_offset = [&](int context, const GridPoint& p,
                               const std::array<std::int64_t, 3>& guess) {
    for (int k = 0; k < 3; ++k) {
      const std::int64_t off =
          (p[k] - guess[static_cast<std::size_t>(k)]) >> shift[static_cast<std::size_t>(k)];
      const int length = bit_length(off);
      emit(context + k, length, length);  // sign, and what is below the leading bit
    }
  };
  const auto touch = [&](int v) {
    const auto at = std::find(recent.rbegin(), recent.rend(), v);
    const int rank = static_cast<int>(at - recent.rbegin());
    if (at != recent.rend()) recent.erase(std::next(at).base());
    recent.push_back(v);
    return rank;
  };
  struct Edge {
    int u, v, opposite;
  };
  for (std::size_t seed = 0; seed < faces.size(); ++seed) {
    if (done[seed]) continue;
    done[seed] = true;
    emit(kGate, kSeed, 0);
    for (const int v : corners[seed]) {
      emit(kGate, sent[static_cast<std::size_t>(v)] ? kKnown : kNew, 0);
      const int rank = touch(v);
      if (sent[static_cast<std::size_t>(v)]) {
        emit(kKnownRank, std::min(rank, 63), 0);
      } else {
        const GridPoint& p = points[static_cast<std::size_t>(v)];
        emit_offset(kSeedAxis, p, {last[0], last[1], last[2]});
        last = p;
        sent[static_cast<std::size_t>(v)] = true;
      }
    }
    std::deque<Edge> gates;
    for (std::size_t k = 0; k < 3; ++k)
      gates.push_back({corners[seed][k], corners[seed][(k + 1) % 3], corners[seed][(k + 2) % 3]});
    while (!gates.empty()) {
      const Edge gate = gates.front();
      gates.pop_front();
      const auto& beside = by_edge[std::minmax(gate.u, gate.v)];
      const auto next =
          std::find_if(beside.begin(), beside.end(), [&](std::size_t f) { return !done[f]; });
      // A gate whose other side has come is known to both ends.
      if (next == beside.end()) {
        if (beside.size() < 2) emit(kGate, kEnd, 0);
        continue;
      }
      done[*next] = true;
      const auto& at = corners[*next];
      const int third =
          *std::find_if(at.begin(), at.end(), [&](int v) { return v != gate.u && v != gate.v; });
      const auto i = static_cast<std::size_t>(third);
      emit(kGate, sent[i] ? kKnown : kNew, 0);
      const int rank = touch(third);
      if (sent[i]) {
        emit(kKnownRank, std::min(rank, 63), 0);
      } else {
        const GridPoint &u = points[static_cast<std::size_t>(gate.u)],
                        &v = points[static_cast<std::size_t>(gate.v)],
                        &w = points[static_cast<std::size_t>(gate.opposite)];
        std::array<std::int64_t, 3> guess;
        for (int k = 0; k < 3; ++k)
          guess[static_cast<std::size_t>(k)] = std::int64_t{u[k]} + v[k] - w[k];
        emit_offset(kGateAxis, points[i], guess);
        last = points[i];
        sent[i] = true;
      }
      gates.push_back({gate.u, third, gate.v});
      gates.push_back({third, gate.v, gate.u});
    }
  }
}

// ---- clusters -----------------------------------------------------------------------------------

struct Node {
  GridBox box;  // as the peer knows it: rounded outward
  std::vector<std::uint32_t> children;
  std::vector<TreeFace> faces;  // of a cluster
  double bits = 0;              // of the children's boxes, or the faces
};

// Faces as a tree of boxes, eight children a node, clusters of at most so many; with bits where they are to be sent.
class Clusters {
 public:
  Clusters(const perf::Model& model, std::size_t cluster_faces, bool coded)
      : header_(&model.baked.header), cluster_faces_(cluster_faces) {
    std::vector<TreeFace> faces;
    for (const TreeNode& node : model.tree.nodes)
      for (std::uint32_t lane = 0; lane < kLanes; ++lane)
        if (const TreeEntry entry = node.entry(lane); entry.kind() == TreeEntry::Kind::kFaces)
          model.tree.view().for_each_face(entry,
                                          [&](const TreeFace& face) { faces.push_back(face); });
    build(faces, 0, faces.size(), box_of(faces, 0, faces.size()));
    if (coded) train();
  }
  [[nodiscard]] const Node& node(std::uint32_t i) const { return nodes_[i]; }
  [[nodiscard]] std::size_t size() const { return nodes_.size(); }
  // Bits of these faces as one piece, near `from`.
  [[nodiscard]] double bits(const std::vector<TreeFace>& faces, const GridPoint& from) const {
    double sum = 0;
    code_faces(faces, header_->lattice_shift, from, [&](int context, int symbol, int raw) {
      sum += costs_.bits(context, symbol) + raw;
    });
    return sum;
  }

 private:
  static GridBox box_of(const std::vector<TreeFace>& faces, std::size_t begin, std::size_t end) {
    GridBox box;
    for (std::size_t f = begin; f < end; ++f)
      for (const GridPoint& p : faces[f].corners) box.add(p);
    return box;
  }
  // The greatest code whose extent is at most x, so that the box stays outside.
  static std::uint8_t inward_code(std::int64_t x) {
    std::uint8_t code = box_extent_code(x);
    while (box_extent(code) > x) --code;
    return code;
  }
  static std::array<std::uint8_t, 6> codes(const GridBox& parent, const GridBox& box) {
    std::array<std::uint8_t, 6> out;
    for (int k = 0; k < 3; ++k) {
      out[static_cast<std::size_t>(2 * k)] = inward_code(std::int64_t{box.lo[k]} - parent.lo[k]);
      out[static_cast<std::size_t>(2 * k + 1)] =
          inward_code(std::int64_t{parent.hi[k]} - box.hi[k]);
    }
    return out;
  }
  static GridBox decoded(const GridBox& parent, const std::array<std::uint8_t, 6>& codes) {
    GridBox box;
    for (int k = 0; k < 3; ++k) {
      box.lo[k] = static_cast<std::int32_t>(parent.lo[k] +
                                            box_extent(codes[static_cast<std::size_t>(2 * k)]));
      box.hi[k] = static_cast<std::int32_t>(parent.hi[k] -
                                            box_extent(codes[static_cast<std::size_t>(2 * k + 1)]));
    }
    return box;
  }
  std::uint32_t build(std::vector<TreeFace>& faces, std::size_t begin, std::size_t end,
                      const GridBox& box) {
    const auto self = static_cast<std::uint32_t>(nodes_.size());
    nodes_.push_back({box, {}, {}, 0});
    if (end - begin <= cluster_faces_) {
      const auto first = faces.begin() + static_cast<std::ptrdiff_t>(begin);
      nodes_[self].faces.assign(first, faces.begin() + static_cast<std::ptrdiff_t>(end));
      return self;
    }
    std::vector<std::pair<std::size_t, std::size_t>> parts{{begin, end}};
    for (int level = 0; level < 3; ++level) {
      std::vector<std::pair<std::size_t, std::size_t>> halves;
      for (const auto& [from, to] : parts) {
        if (to - from <= cluster_faces_) {
          halves.emplace_back(from, to);
          continue;
        }
        const GridBox whole = box_of(faces, from, to);
        int axis = 0;
        for (int k = 1; k < 3; ++k)
          if (std::int64_t{whole.hi[k]} - whole.lo[k] >
              std::int64_t{whole.hi[axis]} - whole.lo[axis])
            axis = k;
        // In whole clusters, so that they are full.
        const std::size_t clusters = (to - from + cluster_faces_ - 1) / cluster_faces_;
        const std::size_t middle = from + (clusters / 2) * cluster_faces_;
        const auto at = [&](std::size_t i) {
          return faces.begin() + static_cast<std::ptrdiff_t>(i);
        };
        std::nth_element(
            at(from), at(middle), at(to), [axis](const TreeFace& x, const TreeFace& y) {
              const auto sum = [axis](const TreeFace& f) {
                return std::int64_t{f.corners[0][axis]} + f.corners[1][axis] + f.corners[2][axis];
              };
              return sum(x) != sum(y) ? sum(x) < sum(y) : x.key < y.key;
            });
        halves.emplace_back(from, middle);
        halves.emplace_back(middle, to);
      }
      parts = std::move(halves);
    }
    for (const auto& [from, to] : parts) {
      const GridBox part = decoded(box, codes(box, box_of(faces, from, to)));
      const std::uint32_t child = build(faces, from, to, part);
      nodes_[self].children.push_back(child);
    }
    return self;
  }
  template <class Emit>
  void code_node(const Node& node, const Emit& emit) const {
    for (const std::uint32_t child : node.children)
      for (const auto code : codes(node.box, nodes_[child].box)) emit(kBoxAxis, code, 0);
    const GridPoint& from = node.box.lo;
    if (!node.faces.empty()) code_faces(node.faces, header_->lattice_shift, from, emit);
  }
  void train() {
    for (const Node& node : nodes_)
      code_node(node, [&](int context, int symbol, int) { costs_.count(context, symbol); });
    for (Node& node : nodes_) {
      node.bits = static_cast<double>(node.children.size());  // inner node or cluster
      code_node(node, [&](int context, int symbol, int raw) {
        node.bits += costs_.bits(context, symbol) + raw;
      });
    }
  }

  const SpmHeader* header_;
  std::size_t cluster_faces_;
  std::vector<Node> nodes_;
  SymbolCosts costs_;
};

// What both ends open: all nodes of a and b that a walk of both trees visits, parents first, and pairs of clusters.
struct Walk {
  std::vector<std::uint32_t> a, b;
  std::vector<std::pair<std::uint32_t, std::uint32_t>> clusters;
};

Walk walk(const Clusters& a, const Clusters& b, const PosedPair& posed) {
  const RelativeFrame frame = make_relative_frame(posed.a, posed.b);
  const auto size = [](const Node& node, const Grid& grid) {
    return std::ldexp(static_cast<double>(size_of(node.box)), grid.exponent);
  };
  std::set<std::uint32_t> opened_a, opened_b;
  Walk found;
  std::vector<std::pair<std::uint32_t, std::uint32_t>> stack{{0, 0}};
  while (!stack.empty()) {
    const auto [i, j] = stack.back();
    stack.pop_back();
    const Node &x = a.node(i), &y = b.node(j);
    if (boxes_apart(frame, centered(x.box), centered(y.box))) continue;
    if (x.children.empty() && y.children.empty()) {
      opened_a.insert(i);
      opened_b.insert(j);
      found.clusters.emplace_back(i, j);
    } else if (y.children.empty() ||
               (!x.children.empty() && size(x, posed.a.grid) >= size(y, posed.b.grid))) {
      opened_a.insert(i);
      for (const std::uint32_t child : x.children) stack.emplace_back(child, j);
    } else {
      opened_b.insert(j);
      for (const std::uint32_t child : y.children) stack.emplace_back(i, child);
    }
  }
  found.a.assign(opened_a.begin(), opened_a.end());  // a node's number is above its parent's
  found.b.assign(opened_b.begin(), opened_b.end());
  std::sort(found.clusters.begin(), found.clusters.end());
  return found;
}

// ---- what the server chooses --------------------------------------------------------------------

constexpr double kHalfSpaceBits = kDirectionBits + kReachBits + 2;  // the last: of which node
constexpr std::size_t kMostHalfSpaces = 3;
constexpr std::size_t kMostPoints = 20'000, kMostParts = 64, kMostObstacles = 400;

using HalfSpaces = std::map<std::uint32_t, std::vector<HalfSpace>>;  // by node

GridPoint middle_of(const GridBox& box) {
  GridPoint middle;
  for (std::size_t k = 0; k < 3; ++k) middle.v[k] = (box.lo.v[k] + box.hi.v[k]) / 2;
  return middle;
}

// A part of a body as a peer holds it: the faces of an open cluster, or a box with half-spaces.
struct Part {
  CenteredBox box;
  GridPoint middle;
  const Node* open = nullptr;
  std::vector<HalfSpace> half_spaces;
};

// The cheapest statements about one body that part it from, or hold its faces against, the parts of the other.
class Planner {
 public:
  // `other_in_own`, `own_in_other`: of the two frames. What is known costs nothing.
  Planner(const Clusters& own, const std::set<std::uint32_t>& known, const HalfSpaces& told,
          const RelativeFrame& other_in_own, const RelativeFrame& own_in_other)
      : own_(own),
        known_(known),
        told_(told),
        other_in_own_(other_in_own),
        own_in_other_(own_in_other) {}

  struct Plan {
    double bits = 0;
    std::vector<std::uint32_t> opened;  // parents first
    HalfSpaces told;                    // new ones
    std::vector<Part> parts;
  };
  Plan plan(const std::vector<Part>& others) {
    std::vector<const Part*> all;
    for (const Part& part : others) all.push_back(&part);
    Plan plan{.bits = solve(0, all)};
    collect(0, plan);
    return plan;
  }

 private:
  struct Choice {
    bool opens = false;
    std::vector<HalfSpace> half_spaces;
  };

  [[nodiscard]] std::vector<HalfSpace> known_of(std::uint32_t i) const {
    const auto at = told_.find(i);
    return at == told_.end() ? std::vector<HalfSpace>() : at->second;
  }
  [[nodiscard]] bool is_clear(const Part& own, const Part& other) const {
    const Obstacle theirs{&other_in_own_, {}, other.box, {}}, ours{&own_in_other_, {}, own.box, {}};
    const auto clears = [](const Part& part, const Obstacle& obstacle) {
      return std::any_of(part.half_spaces.begin(), part.half_spaces.end(),
                         [&](HalfSpace h) { return keeps_clear(h, part.middle, obstacle); });
    };
    return boxes_apart(other_in_own_, own.box, other.box) || clears(own, theirs) ||
           clears(other, ours);
  }
  [[nodiscard]] Part part_of(std::uint32_t i) const {
    const GridBox& box = own_.node(i).box;
    return {centered(box), middle_of(box), nullptr, known_of(i)};
  }
  // Empty: half-spaces cannot do it. `clear`: nothing stands in the way after all.
  std::vector<HalfSpace> choose(std::uint32_t i, const Part& own,
                                const std::vector<const Part*>& close, bool& clear) const {
    if (close.size() > kMostParts) return {};
    std::vector<Obstacle> obstacles;
    for (const Part* part : close) {
      if (part->open == nullptr) obstacles.push_back({&other_in_own_, {}, part->box, {}});
      if (part->open == nullptr) continue;
      for (const TreeFace& face : part->open->faces)
        if (const DoubleTriangle triangle = to_a_units(other_in_own_, face.corners);
            !box_triangle_apart(other_in_own_, own.box, triangle))
          obstacles.push_back({&other_in_own_, triangle, {}, {}});
    }
    std::erase_if(obstacles, [&](const Obstacle& obstacle) {
      return std::any_of(own.half_spaces.begin(), own.half_spaces.end(),
                         [&](HalfSpace h) { return keeps_clear(h, own.middle, obstacle); });
    });
    clear = obstacles.empty();
    if (clear || obstacles.size() > kMostObstacles) return {};
    std::vector<GridPoint> points;
    if (!gather(i, points)) return {};
    ChosenHalfSpaces chosen = choose_half_spaces(points, own.middle, obstacles, kMostHalfSpaces);
    return chosen.left == 0 ? std::move(chosen.half_spaces) : std::vector<HalfSpace>();
  }
  bool gather(std::uint32_t i, std::vector<GridPoint>& points) const {
    const Node& node = own_.node(i);
    for (const TreeFace& face : node.faces)
      points.insert(points.end(), face.corners.begin(), face.corners.end());
    return points.size() <= kMostPoints &&
           std::all_of(node.children.begin(), node.children.end(),
                       [&](std::uint32_t child) { return gather(child, points); });
  }
  double solve(std::uint32_t i, const std::vector<const Part*>& above) {
    const Part own = part_of(i);
    std::vector<const Part*> close;
    for (const Part* part : above)
      if (!is_clear(own, *part)) close.push_back(part);
    choices_[i] = {};
    if (close.empty()) return 0;
    bool clear = false;
    std::vector<HalfSpace> half_spaces = choose(i, own, close, clear);
    if (clear) return 0;
    const Node& node = own_.node(i);
    double open_bits = known_.contains(i) ? 0 : node.bits;
    const double told_bits = kHalfSpaceBits * static_cast<double>(half_spaces.size());
    if (half_spaces.empty() || open_bits < told_bits)
      for (const std::uint32_t child : node.children) open_bits += solve(child, close);
    if (half_spaces.empty() || open_bits < told_bits) {
      choices_[i].opens = true;
      return open_bits;
    }
    choices_[i].half_spaces = std::move(half_spaces);
    return told_bits;
  }
  void collect(std::uint32_t i, Plan& plan) const {
    const Choice& choice = choices_.at(i);
    const Node& node = own_.node(i);
    if (choice.opens) plan.opened.push_back(i);
    if (choice.opens && node.faces.empty()) {
      for (const std::uint32_t child : node.children) collect(child, plan);
      return;
    }
    Part part = part_of(i);
    if (choice.opens) part.open = &node;
    part.half_spaces.insert(part.half_spaces.end(), choice.half_spaces.begin(),
                            choice.half_spaces.end());
    if (!choice.half_spaces.empty()) plan.told[i] = choice.half_spaces;
    plan.parts.push_back(std::move(part));
  }

  const Clusters& own_;
  const std::set<std::uint32_t>& known_;
  const HalfSpaces& told_;
  const RelativeFrame &other_in_own_, &own_in_other_;
  std::map<std::uint32_t, Choice> choices_;
};

// A body of which all clusters are open.
std::vector<Part> all_open(const Clusters& clusters) {
  std::vector<Part> parts;
  for (std::uint32_t i = 0; i < clusters.size(); ++i)
    if (const Node& node = clusters.node(i); !node.faces.empty())
      parts.push_back({centered(node.box), middle_of(node.box), &node, {}});
  return parts;
}

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

// Pieces in order of arrival, each with bits and faces; both bodies' faces are held as plain triangles.
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
  State receive(const perf::PosePair& /*poses*/, const PosedPair& posed,
                std::uint64_t max_bytes) override {
    if (!asked_ || !same(*asked_, posed)) {
      Stopwatch watch;
      const Walk walked = walk(a_, b_, posed);
      state_.query_s += watch.seconds();  // the peer's own walk, too
      std::deque<Piece> more = select(posed, walked);
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
  virtual std::deque<Piece> select(const PosedPair& posed, const Walk& walked) = 0;
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
  std::deque<Piece> select(const PosedPair& /*posed*/, const Walk& walked) override {
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
  explicit ChosenRival(const Scene& scene) : Rival(scene), open_{all_open(a_), all_open(b_)} {}

 protected:
  // One body is planned against all faces of the other, that one against what the peer will hold of the first; the cheaper of
  // both orders. Whatever is not open of the second was parted from all of the first, and the other way round.
  std::deque<Piece> select(const PosedPair& posed, const Walk& /*walked*/) override {
    const RelativeFrame b_in_a = make_relative_frame(posed.a, posed.b),
                        a_in_b = make_relative_frame(posed.b, posed.a);
    const auto plan_of = [&](std::size_t body, const std::vector<Part>& others) {
      return Planner(body == 0 ? a_ : b_, known_[body], told_[body], body == 0 ? b_in_a : a_in_b,
                     body == 0 ? a_in_b : b_in_a)
          .plan(others);
    };
    std::array<Planner::Plan, 2> plans{plan_of(0, open_[1]), {}};
    if (scene_.b_streamed) {
      plans[1] = plan_of(1, plans[0].parts);
      Planner::Plan b_first = plan_of(1, open_[0]), a_second = plan_of(0, b_first.parts);
      if (b_first.bits + a_second.bits < plans[0].bits + plans[1].bits)
        plans = {std::move(a_second), std::move(b_first)};
    }
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
  const std::array<std::vector<Part>, 2> open_;
  std::array<std::set<std::uint32_t>, 2> known_;
  std::array<HalfSpaces, 2> told_;
};

class TrustedRival : public Rival {
 public:
  explicit TrustedRival(const Scene& scene) : Rival(scene) {}

 protected:
  // Pieces of some 8 triangles so that what has come can be used; coded as one.
  std::deque<Piece> select(const PosedPair& posed, const Walk& walked) override {
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
  return std::make_unique<ChosenRival>(scene);
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
