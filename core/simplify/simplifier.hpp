// SPDX-License-Identifier: Apache-2.0
#pragma once
// The state of one simplification and its phases: set-up (simplifier_setup.cpp), edge collapses
// (collapse_edges.cpp), merging of vertices that were left without faces (merge_isolated.cpp).
// simplify.cpp runs them, over the cells of a large mesh first (cells.cpp).

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <limits>
#include <span>
#include <utility>
#include <vector>

#include "nearmesh/core/simplify/detail/simplify.hpp"
#include "quadric.hpp"
#include "vertex_queue.hpp"

namespace nearmesh::simplification {

inline constexpr std::uint32_t kNone = 0xffffffffU;

/// Weight of the planes that hold a border in place, against 1 for the faces. (Of 1 to 1000,
/// measured on open vehicles: from 100 on the borders keep so many faces that the surface between
/// them suffers.)
inline constexpr double kBorderWeight = 10;
/// A collapse that breaks the topology, or turns a face too far from the input's normal, costs this
/// much more: it waits until others have become as dear. Forbidding the first altogether grinds
/// down whatever is well connected before it touches debris (five times the error on a truck of 59
/// components, ranked by error alone); manifold meshes are the same either way. Forbidding the
/// second keeps small rings until all else is gone.
inline constexpr double kDearFactor = 64;
/// Weight of the squared distance from the planes merged so far, against 1 for the area of the
/// merged box's sides (both times the fourth root of the area of the faces that move): until one
/// face of kCoarseShare is left, and from there on. Boxes decide what an answer takes, distances
/// how the coarse levels look: measured in ARCHITECTURE.md.
inline constexpr double kFineErrorWeight = 1000, kCoarseErrorWeight = 30;
inline constexpr std::uint64_t kCoarseShare = 10;
/// That of the squared length of the collapse: of those that are alike the shortest goes first.
inline constexpr double kLengthWeight = 0.1;
/// A face may turn by 78 degrees in one collapse, and by 60 since the input.
inline constexpr double kLeastCosine = 0.2;
inline constexpr double kLeastCosineToInput = 0.5;

/// A vertex of more faces than this is crowded. A collapse that takes part in it costs as much as
/// it has faces, so n faces around one vertex would cost n^2. It therefore stays as it is while its
/// neighbours collapse among themselves, until it has half as many. Scans, terrain and vehicles
/// stay below 200 at every level. Cones, poles and lids of prisms become the same with any limit
/// from here up: what is left of their rims goes first anyway.
inline constexpr std::uint32_t kCrowd = 512;

/// What a collapse must respect; each rule is tried only when the one before it allows nothing
/// more.
enum class Rule : std::uint8_t {
  kAll,  ///< what is dear may break the topology, or turn a face further from the input
  kNoOriginalNormal,  ///< turns may add up
  kNoNormals,         ///< faces may flip; breaking the topology stays dear
  kNothing,           ///< nothing is tested
};
/// Share of the progress that simplify_cells reports.
inline constexpr double kShareOfCells = 0.75;
inline constexpr std::array<Rule, 4> kRules = {Rule::kAll, Rule::kNoOriginalNormal,
                                               Rule::kNoNormals, Rule::kNothing};
/// A rule is also given up once collapses refused in vain have looked at this many faces for each
/// face of the input. Only tangles (random corners: every vertex soon has thousands of neighbours)
/// come near; surfaces need less than 1.
inline constexpr std::uint64_t kPatience = 200;

/// 32 bytes. Faces of a vertex: a slice of one pool.
struct Vertex {
  static constexpr std::uint32_t kMostDepth = 0x1fffffffU;

  std::array<std::int32_t, 3> p{};
  std::uint32_t first = 0;          ///< in the pool; kNone once the vertex has been removed
  std::uint32_t count = 0;          ///< faces
  std::uint32_t capacity = 0;       ///< of the slice
  std::uint32_t mark = 0;           ///< scratch of gather_ring
  std::uint32_t depth : 29 = 0;     ///< of the merge tree below, a collapse being one level
  std::uint32_t is_locked : 1 = 0;  ///< neither goes nor takes another in
  std::uint32_t is_stale : 1 = 0;   ///< its choice is a lower bound: look again before use
  /// Has had more than kCrowd faces. Outside of collapse_crowded its slice, all `capacity` of it,
  /// also holds faces that have vanished.
  std::uint32_t is_crowded : 1 = 0;
};
static_assert(sizeof(Vertex) == 32);

/// 16 bytes. `normal` is that of the input face, 3 x 10 bits, 0 where it had none.
struct Face {
  std::array<std::uint32_t, 3> corner{kNone, kNone, kNone};  ///< kNone when the face has vanished
  std::uint32_t normal = 0;
};

/// What has merged into a vertex: the planes of its faces, and a box around these: its node's in
/// the forest.
struct Cluster {
  Quadric quadric;
  GridBox box;
  /// Of what its collapses cost: the area of its faces to the power of -3/4. Kept, since each of
  /// them asks: taken anew, simplifying takes 3 % more.
  double factor = 0;

  /// Adds another vertex's; `d` leads from that vertex to this one.
  void add(const Cluster& other, const Vec3& d) {
    quadric.add(other.quadric, d);
    box.add(other.box);
    weigh();
  }
  void weigh() {
    const double root = std::sqrt(quadric.total_weight());
    factor = root > 0 ? 1 / (root * std::sqrt(root)) : 0;
  }
};

/// A mesh between two simplifications: vertices along a Morton curve, faces by their least corner.
struct Patch {
  struct Corner {
    std::array<std::int32_t, 3> p{};
    std::uint32_t depth = 0;
  };
  std::vector<Corner> vertices;
  std::vector<std::uint32_t> number;  ///< in the input, of each vertex
  std::vector<Face> faces;
  std::vector<Cluster> clusters;  ///< empty: those of the faces; else one a vertex
  int code_shift = 0;             ///< of morton_code, for all of them
};

/// The input as a patch. Faces with a repeated corner are left out.
[[nodiscard]] Patch place_mesh(const GridMesh& mesh);
/// Simplifies within cells of a large patch what costs little enough, and gives what is left; the
/// patch itself where cells would not help. Appends to the log.
[[nodiscard]] Patch simplify_cells(Patch patch, const SimplifyOptions& options, CollapseLog& log);

/// Neighbours of a vertex and how often each occurs in its faces (3 = thrice or more).
struct Ring {
  struct Entry {
    std::uint32_t vertex, faces;
  };
  std::vector<Entry> entries;
  std::uint32_t borders = 0;  ///< entries of one face
  bool is_manifold = true;    ///< at most two faces an edge, at most one gap
};

inline Vec3 between(const Vertex& from, const Vertex& to) {
  // Differences of coordinates in [0, 2^31) fit 32 bits, so this is exact.
  return {static_cast<double>(to.p[0] - from.p[0]), static_cast<double>(to.p[1] - from.p[1]),
          static_cast<double>(to.p[2] - from.p[2])};
}

inline std::uint32_t pack_normal(const Vec3& n) {
  const double length = std::sqrt(dot(n, n));
  if (length == 0) return 0;
  std::uint32_t packed = 0;
  for (int k = 0; k < 3; ++k)
    packed = packed << 10 | static_cast<std::uint32_t>(std::floor(n[k] / length * 511 + 512.5));
  return packed;
}
inline Vec3 unpack_normal(std::uint32_t packed) {
  Vec3 n;
  for (int k = 0; k < 3; ++k) n[k] = static_cast<double>(packed >> (20 - 10 * k) & 1023U) - 512;
  return n;
}

/// 21 bits an axis interleaved: neighbours in this order are neighbours in memory.
inline std::uint64_t morton_code(const std::array<std::int32_t, 3>& p, int shift) {
  std::uint64_t code = 0;
  for (int k = 0; k < 3; ++k) {
    std::uint64_t x = static_cast<std::uint64_t>(p[k]) >> shift & 0x1fffffU;
    x = (x | x << 32) & 0x1f00000000ffffULL;
    x = (x | x << 16) & 0x1f0000ff0000ffULL;
    x = (x | x << 8) & 0x100f00f00f00f00fULL;
    x = (x | x << 4) & 0x10c30c30c30c30c3ULL;
    x = (x | x << 2) & 0x1249249249249249ULL;
    code |= x << k;
  }
  return code;
}

/// Leading bits of a cost that take part in the order: 11 of exponent, the rest of mantissa.
inline constexpr int kCostBits = 18;
inline constexpr std::uint32_t kMaxDepth = (1U << (32 - kCostBits)) - 1;

inline std::uint32_t rank_of(double cost, std::uint32_t depth) {
  const auto bits =
      static_cast<std::uint32_t>(std::bit_cast<std::uint64_t>(cost) >> (63 - kCostBits));
  return bits << (32 - kCostBits) | std::min(depth, kMaxDepth);
}

/// A way for a vertex to go: cheapest first, ties to the shallower pair, then to the lower partner.
/// All in one number: 32 bits of rank, 30 of partner, is it dear (kDearFactor), was another tried
/// before.
struct Choice {
  static constexpr std::uint64_t kNever = std::numeric_limits<std::uint64_t>::max();
  std::uint64_t value = kNever;

  Choice() = default;
  Choice(double cost, std::uint32_t depth, std::uint32_t partner, bool is_dear)
      : value(std::uint64_t{rank_of(cost, depth)} << 32 | partner << 2 |
              std::uint64_t{is_dear} << 1) {}
  Choice(std::uint64_t key, std::uint32_t low) : value((key >> 32 << 32) | low) {}

  [[nodiscard]] std::uint64_t key(std::uint32_t vertex) const {
    return (value >> 32 << 32) | vertex;
  }
  [[nodiscard]] std::uint32_t low() const { return static_cast<std::uint32_t>(value); }
  [[nodiscard]] std::uint32_t partner() const { return low() >> 2; }
  [[nodiscard]] bool is_dear() const { return (value & 2) != 0; }
  [[nodiscard]] bool is_second() const { return (value & 1) != 0; }
};
inline constexpr std::size_t kMaxVertices = std::size_t{1} << 30;

class Simplifier {
 public:
  /// Vertices of the patch from `own` on are locked, as is every vertex that has one of them as a
  /// neighbour.
  Simplifier(Patch patch, std::size_t own, std::uint64_t target_faces);

  [[nodiscard]] bool is_done() const { return faces_left_ <= target_faces_; }
  [[nodiscard]] std::uint64_t faces_left() const { return faces_left_; }
  /// Vertices that are not locked.
  [[nodiscard]] std::size_t count_free() const {
    return static_cast<std::size_t>(std::count_if(vertices_.begin(), vertices_.end(),
                                                  [](const Vertex& v) { return !v.is_locked; }));
  }
  /// Called with a share in [0, 1] of the faces that are to go.
  void on_progress(std::function<void(double)> report) { on_progress_ = std::move(report); }

  /// What follows is weighed so, and pauses when so many faces are left.
  void start_phase(double error_weight, std::uint64_t pause_faces) {
    error_weight_ = error_weight;
    pause_faces_ = pause_faces;
  }
  /// Collapses the cheapest until the target or the pause is reached or nothing is left whose rank
  /// is at most `limit`. `ranks` is called with the rank of each.
  void collapse_edges(Rule rule, std::uint32_t limit = kNone,
                      std::vector<std::uint32_t>* ranks = nullptr);
  /// Collapses what is left when no rule allows more, crowded vertices among themselves in turn
  /// with the others.
  void collapse_crowded();
  /// Returns how many there were.
  std::uint64_t merge_isolated();
  /// Faces looked at, each as often as it was.
  [[nodiscard]] std::uint64_t work() const { return work_; }
  [[nodiscard]] const std::vector<Collapse>& collapses() const { return collapses_; }
  /// What is left: all faces, with corners as before, and the state of the vertices below `own`, in
  /// `place` their earlier places.
  [[nodiscard]] Patch take_rest(std::size_t own, std::vector<std::uint32_t>& place);

 private:
  /// What merge_range leaves over of a range of vertices in Morton order.
  struct Range {
    std::uint32_t isolated = kNone;            ///< one vertex without faces, or none
    std::size_t base_begin = 0, base_end = 0;  ///< in base_
  };

  void link_faces();
  void lock_border(std::size_t own);
  void add_clusters(std::size_t own);

  // Adjacency.
  [[nodiscard]] const std::uint32_t* faces_begin(const Vertex& v) const {
    return &pool_[0] + v.first;
  }
  [[nodiscard]] const std::uint32_t* faces_end(const Vertex& v) const {
    return &pool_[0] + v.first + v.count;
  }
  std::uint32_t next_stamp();
  void gather_ring(std::uint32_t u, std::vector<std::uint32_t>& ring);
  void gather_ring(std::uint32_t u, Ring& ring);
  [[nodiscard]] Vec3 normal_of(const Face& f) const;

  // Choosing.
  /// Takes no part in collapses, for now or for good.
  [[nodiscard]] bool is_fixed(const Vertex& v) const {
    return v.is_locked != 0 || (v.is_crowded != 0) != among_crowded_;
  }
  [[nodiscard]] double cost_of(std::uint32_t u, std::uint32_t s) const;
  [[nodiscard]] Choice choice_of(std::uint32_t u) const { return {queue_.key(u), choice_[u]}; }
  [[nodiscard]] Choice choice_between(std::uint32_t u, std::uint32_t x) const;
  void choose(std::uint32_t u);
  void choose_among(std::uint32_t u, std::span<const std::uint32_t> ring);
  void choose_next(std::uint32_t u);
  void choose_again(std::uint32_t x, std::uint32_t u, std::uint32_t s);
  void choose_around(std::uint32_t thinned);
  void set_choice(std::uint32_t u, const Choice& choice);
  [[nodiscard]] bool is_legal(std::uint32_t u, const Choice& choice, Rule rule);
  [[nodiscard]] bool keeps_topology(std::uint32_t u, std::uint32_t s, bool& is_tetrahedron);
  [[nodiscard]] bool keeps_normal(const Face& f, std::uint32_t u, std::uint32_t s,
                                  bool may_turn) const;

  // Doing.
  void collapse(std::uint32_t u, std::uint32_t s);
  void move_faces(std::uint32_t u, std::uint32_t s);
  void remove_vertex(std::uint32_t u, std::uint32_t s);
  void drop_face(std::uint32_t vertex, std::uint32_t face);
  void store_slice(Vertex& to, Vertex& from, const std::vector<std::uint32_t>& faces);
  void compact_pool();
  void forget_vanished(Vertex& v);
  void report_progress();

  // Vertices without faces.
  Range merge_range(const std::vector<std::uint64_t>& codes, std::size_t begin, std::size_t end);
  [[nodiscard]] std::uint32_t nearest_base(std::uint32_t v, std::size_t begin,
                                           std::size_t end) const;

  std::uint64_t target_faces_, pause_faces_ = 0;
  double error_weight_ = kFineErrorWeight;
  int code_shift_;
  std::uint64_t faces_in_ = 0, faces_left_ = 0;
  std::uint64_t effort_ = 0;    ///< faces looked at for collapses that were refused
  std::uint64_t work_ = 0;      ///< faces looked at
  bool among_crowded_ = false;  ///< crowded vertices collapse, and no others
  std::function<void(double)> on_progress_;
  double next_report_ = 0;

  std::vector<std::uint32_t> input_number_;  ///< of each vertex
  std::vector<Vertex> vertices_;
  std::vector<Face> faces_;
  std::vector<std::uint32_t> pool_;
  std::size_t pool_limit_ = 0;
  std::vector<Cluster> clusters_;
  VertexQueue queue_;                  ///< key: rank of the vertex's Choice, then the vertex
  std::vector<std::uint32_t> choice_;  ///< low half of that Choice
  std::uint32_t stamp_ = 0;

  std::vector<std::uint32_t> ring_, ring_s_left_, left_alone_, merged_, thirds_,
      thinned_;  // scratch
  Ring ring_u_, ring_s_;
  std::vector<std::uint32_t> live_, base_;
  std::vector<Collapse> collapses_;
};

}  // namespace nearmesh::simplification
