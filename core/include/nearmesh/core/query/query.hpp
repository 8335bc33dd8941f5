// SPDX-License-Identifier: Apache-2.0
#pragma once
// API (docs/api.md).
// The certified collision query between two posed trees: exact face pairs, and a proof that what is
// not refined cannot matter, or the list of what is missing.
//
// Why a certified answer is right. A face is exact when its three vertices stand for themselves
// alone: it is then a face of the full mesh, in its place. Every other face of the full mesh, held
// or not, has a vertex in an unresolved node and lies in that node's box, and in the half-spaces
// that were told of it. So where nothing of the other body meets what these have in common, no face
// but exact ones can touch, and the exact pairs are all there are. Nothing is assumed of the
// simplifier. core/THEOREM.md states and proves it, with what follows for distances, insides and
// motions, and says which test holds which step. Both sides use the fixed-point pose of
// geometry/pose.hpp, so the full-mesh reference and the certified answer agree bit by bit.
//
// Solids. A body whose surface is closed may be asked about as solid: is the other one inside?
// Where the surfaces are certainly apart, each connected part of one lies wholly on one side of the
// other, so one known vertex of each part (SurfaceFacts::component_seeds) decides, however coarse
// the rest is. Inside is where the winding number is not 0: the room between nested shells of
// opposite orientation is outside, what two overlapping shells share is inside.

#include <array>
#include <cstdint>
#include <functional>
#include <limits>
#include <vector>

#include "nearmesh/core/abtree/detail/tree.hpp"
#include "nearmesh/core/geometry/pose.hpp"

namespace nearmesh {

enum class AnswerStatus : std::uint8_t {
  kFree = 0,     ///< certified: no contact
  kContact = 1,  ///< certified: `pairs` is the contact set of the full meshes
  kPartial =
      2,  ///< at least the pairs given touch; what is missing, or was not looked at, may add more
  kUncertain =
      3,  ///< nothing exact was found to touch, but what is missing, or was not looked at, might
  kContained = 4,  ///< certified: no contact, but a connected part of one body is inside the other
};
/// "free", "contact", "partial", "uncertain", "contained".
[[nodiscard]] const char* to_string(AnswerStatus status);
/// Free, contained or complete contact.
[[nodiscard]] constexpr bool is_certified(AnswerStatus status) {
  return status == AnswerStatus::kFree || status == AnswerStatus::kContact ||
         status == AnswerStatus::kContained;
}

/// Which body has a part inside which (solid) one. Both: each has a part inside the other.
enum class Containment : std::uint8_t { kNone = 0, kAInB = 1, kBInA = 2, kBoth = 3 };
/// "none", "a_in_b", "b_in_a", "both".
[[nodiscard]] const char* to_string(Containment contained);

struct FacePair {
  FaceKey a, b;
  auto operator<=>(const FacePair&) const = default;
};

/// A number for comparing contact sets: equal sets, in ascending order, have equal digests.
[[nodiscard]] std::uint64_t digest(const std::vector<FacePair>& pairs);

inline constexpr std::size_t kAllPairs = std::numeric_limits<std::size_t>::max();
inline constexpr std::uint64_t kAllTests = std::numeric_limits<std::uint64_t>::max();

/// How near to the distance the bound of a free answer is sought.
enum class Clearance : std::uint8_t {
  kNone,  ///< not at all: the bound is 0
  /// Until it is kClearanceShare of what is known at least; ends after 256 steps in any case.
  kBound,
  /// The greatest that what is held allows: with full meshes the distance. Ends after 65,536 steps
  /// in any case.
  kExact,
};
// Cost of a step: one pair of parts, that is, the eight lanes of a node against a box, or at most
// 64 pairs of faces. Before the first step the search dives once to the bottom: as many pairs as
// both trees together have levels.
inline constexpr double kClearanceShare = 0.75;

/// Whether the time for a question is over: a look at a clock, say. Asked each kTestsALook tests,
/// some 10 to 50 us.
using IsOver = std::function<bool()>;
inline constexpr std::uint64_t kTestsALook = 2'048;
/// Without one it never is.
[[nodiscard]] inline bool is_time_over(const IsOver* is_over) {
  return is_over != nullptr && (*is_over)();
}

struct QueryOptions {
  /// Stop at the first touching pair: kContact then says "touches", not "these are all".
  bool any = false;
  Clearance clearance = Clearance::kBound;  ///< also bound the distance when free
  /// List at most so many, and hold no more; the search goes on, so that the total is right.
  std::size_t max_pairs = kAllPairs;
  /// End after so many tests (tests_of): what was found by then is partial or uncertain, and
  /// Answer::exhausted says so. A bound of time, some 2 to 5 ns a test, and with it of memory. The
  /// search for the clearance has a bound of its own.
  std::uint64_t max_tests = kAllTests;
  /// As soon as it says so, the search ends as if max_tests were spent, so what was found depends
  /// on when. Outlives the call.
  const IsOver* is_over = nullptr;
  bool solid_a = false;  ///< a has an inside: is b in it? Only where check_solid accepts a's model
  bool solid_b = false;  ///< the same of b
  /// It was free at poses much like these. A kBound clearance is sought first then, and mostly
  /// shows that nothing touches. The answer is the same, but for its stats.
  bool was_free = false;
};

struct QueryStats {
  std::uint64_t box_tests = 0, triangle_tests = 0;
  std::uint64_t exact_tests = 0;  ///< pairs of faces that only exact integers could decide
};
/// What QueryOptions::max_tests counts. An exact test takes as long as many others.
inline constexpr std::uint64_t kTestsAnExactOne = 64;
[[nodiscard]] constexpr std::uint64_t tests_of(const QueryStats& stats) {
  return stats.box_tests + stats.triangle_tests + kTestsAnExactOne * stats.exact_tests;
}

struct Answer {
  AnswerStatus status = AnswerStatus::kUncertain;
  std::vector<FacePair> pairs;   ///< exact, ascending
  std::uint64_t pair_total = 0;  ///< how many were found
  bool truncated = false;        ///< `pairs` holds only the first QueryOptions::max_pairs of them
  /// QueryOptions::max_tests were spent, or is_over said so: partial or uncertain, with whatever
  /// was found by then. Of what was not looked at nothing is said, so `missing` may be empty. What
  /// is found by then may differ between processors; what it lists does touch.
  bool exhausted = false;
  /// What the answer misses: the unresolved nodes whose splits bring it nearer, ascending. Most
  /// unresolved nodes are out of the way and are not missed.
  std::vector<NodeSpan> missing_a, missing_b;
  /// Where the surfaces are certainly apart and only the inside of a solid is undecided: boxes in
  /// the body's own grid around the rays that wait for missing nodes. A hint for what to ask for
  /// below these nodes; else empty.
  std::vector<GridBox> rays_a, rays_b;
  /// Free: a lower bound of the distance, metres (infinite when either side has no face). Else 0.
  /// Contained: the same, of the surfaces.
  double clearance_m = 0;
  /// The bound is at least this share of the greatest that what is held allows: 1 where it was
  /// sought to the end, less where the search was ended by its steps before kClearanceShare was
  /// reached. 0: no bound.
  double clearance_share = 0;
  /// As much of `clearance_m` as boxes along axes of the larger body show, which is the one that
  /// reaches farther from its origin (a of equals). It lasts while the smaller one turns. Not above
  /// 0: nothing.
  double clearance_by_larger_m = 0;
  /// An upper bound of the distance of the full meshes as they are posed, metres: with
  /// `clearance_m` a bracket of it. 0 where faces touch; infinite without a face, where nothing was
  /// looked at (`exhausted`), and with Clearance::kNone. Of a certified answer that was sought to
  /// the end both bounds meet, but for rounding, wherever the nearest faces are exact. Uncertain:
  /// of what is held, so a hint how near they are.
  double distance_at_most_m = std::numeric_limits<double>::infinity();
  /// Where that bound is positive and finite: the points so far apart, of the full meshes a's and
  /// b's, world frame, but for the rounding of doubles. They are on exact faces, or vertices that
  /// stand for unresolved nodes.
  std::array<double, 3> nearest_a_m{}, nearest_b_m{};
  Containment contained = Containment::kNone;  ///< kNone but for status kContained
  /// Not certified: a bound, metres. Every original face with a corner below a missing node lies,
  /// as a whole, within this of the vertex that stands for that node, hence of its own image in the
  /// current mesh. Else 0. Infinite where the search was ended (`exhausted`), and, with nothing
  /// missing, where a part might be inside a solid but the model has too many parts for seeds.
  double uncertainty_m = 0;
  QueryStats stats;
};

/// Uncertain with nothing missing, though all was looked at: no detail can settle it, since a part
/// might be inside a solid, but the model has too many parts for seeds. query() then says that the
/// uncertainty is infinite.
[[nodiscard]] inline bool is_beyond_detail(const Answer& answer) {
  return answer.status == AnswerStatus::kUncertain && !answer.exhausted &&
         answer.missing_a.empty() && answer.missing_b.empty();
}

/// Digest of everything in an answer but its statistics, its hints and its clearance, which is a
/// bound and may be sought in several ways: equal answers, equal digests, on every peer and build.
[[nodiscard]] std::uint64_t digest(const Answer& answer);

/// The bound of Answer::uncertainty_m for one node, in grid units: greatest distance from its
/// representative to a corner of its box, which encloses every original face that touches a vertex
/// below it. Precondition: store.is_node(node).
[[nodiscard]] double node_bound(const SplitStore& store, NodeSpan node);

/// Answers for two trees under two placements on one lattice (equal lattice_exp). With solids,
/// "free" also says that nothing is inside: free, contained or uncertain follow from where the
/// seeds lie. A model without seeds (more parts than kMaxComponentSeeds) can hold others, but
/// itself be proved outside a solid only where the boxes of the whole bodies are apart; else the
/// answer stays uncertain with nothing missing.
/// Preconditions (asserted): a solid's tree carries the facts of a closed surface, the other one's
/// tree its facts.
/// Deterministic: the answer depends on faces, front and poses only, unless it is exhausted.
/// Threads: views may be shared.
[[nodiscard]] Answer query(const TreeView& a, const PosedFrame& frame_a, const TreeView& b,
                           const PosedFrame& frame_b, const QueryOptions& options = {});

/// Both placements on the pair's common lattice. Errors: as check_pose and make_posed_frame, naming
/// the body.
struct PosedPair {
  PosedFrame a, b;
};
[[nodiscard]] Result<PosedPair> pose_pair(const Grid& grid_a, const Pose& pose_a,
                                          std::string_view name_a, const Grid& grid_b,
                                          const Pose& pose_b, std::string_view name_b);

}  // namespace nearmesh
