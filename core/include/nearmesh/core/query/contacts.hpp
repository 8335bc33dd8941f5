// SPDX-License-Identifier: Apache-2.0
#pragma once
// API (docs/api.md).
// Where bodies touch: the intersection of touching faces as points and segments, grouped into
// patches, each with a normal and a bound of its error, and with a few points that span it. Takes
// an Answer (query.hpp), gives Contacts. How deep the bodies are in each other: depth.hpp.

#include <array>
#include <cstdint>
#include <vector>

#include "nearmesh/core/query/query.hpp"

namespace nearmesh {

/// A point (p == q) or segment that two faces have in common; of coplanar faces, one side of the
/// outline of their common area. World frame. The ends have no particular order.
struct ContactSegment {
  std::array<double, 3> p_m{}, q_m{};
  FacePair pair;
  bool approximate = false;  ///< one of the faces is not a face of the full mesh
};

/// normal_error_rad where faces differ so much (by a right angle or more from their mean) or have
/// so little shape (points and segments) that no direction stands for them; the normal is then the
/// best guess, or +z without any.
inline constexpr double kNoNormal_rad = 3.14159265358979323846;

/// Contacts that hang together: two pairs of faces are in one patch when they share a face and
/// their other faces are equal or share a corner, and so on.
struct ContactPatch {
  std::uint32_t first = 0, count = 0;  ///< segments [first, first + count)
  double length_m = 0;                 ///< of the segments; 0: nothing but points
  /// Mean of the segments by length; of the points where there are no others.
  std::array<double, 3> centroid_m{};
  /// Unit vector from A to B, the way B has to move to get away: the mean, by length, of the
  /// outward normals of the reference body's faces here; outward is to where a face's corners are
  /// counter-clockwise. The reference is the body whose faces spread less about their mean (equal:
  /// the one with more area of faces), so a corner on a plane has the plane's normal. Two edges
  /// that cross have the normal of one of their faces, not that of both edges.
  std::array<double, 3> normal{};
  bool normal_is_of_a = true;  ///< A is the reference, else B
  /// Every face of the reference body in this patch has its normal (B: reversed) within this of
  /// `normal`, rounding included. kNoNormal_rad: nothing is known.
  double normal_error_rad = kNoNormal_rad;
  /// For solvers that take few points: at most four ends of its segments that span it, each far
  /// from those before; world frame.
  std::array<std::array<double, 3>, 4> manifold_m{};
  std::uint32_t manifold_count = 0;
  /// Every point of its segments is within this, and position_error_m, of the convex hull of these
  /// points, metres.
  double manifold_error_m = 0;
  bool approximate = false;  ///< some segment is
  /// The surface of each full mesh passes within this, and position_error_m, of every point of the
  /// patch. 0 unless approximate. This does not say that the full meshes touch there.
  double uncertainty_m = 0;
};

struct Contacts {
  std::vector<ContactSegment> segments;  ///< by patch, then by pair
  std::vector<ContactPatch> patches;     ///< by their least pair
  /// Every point of a segment lies within this of both posed faces. Bound: contacts.cpp.
  double position_error_m = 0;
  std::uint64_t pair_total = 0;  ///< as in the Answer
  /// As in the Answer: there are more contacts than these, and patches may be torn.
  bool truncated = false;
};

/// The contacts of the pairs that an answer lists. Their faces are exact, so no segment is
/// approximate; of a partial answer there may be more.
/// In: the arguments of the query that gave `answer`, unchanged since.
/// Deterministic to the bit. Swapped bodies give the same patches with opposite normals, up to
/// rounding; so do bodies that are moved together by whole lattice cells.
/// Cost: no query and no test of the trees. One exact intersection a pair, sorting by faces, and at
/// most five passes over a patch's ends for its manifold: O(pairs log pairs), about 1 us a pair; a
/// tree without a store is searched for the faces, O(its faces).
[[nodiscard]] Contacts find_contacts(const TreeView& a, const PosedFrame& frame_a,
                                     const TreeView& b, const PosedFrame& frame_b,
                                     const Answer& answer);

/// The contacts of the current meshes, coarse faces and all: the best guess while an answer is not
/// certified, never a proof. A segment is flagged when one of its faces is not exact, and its patch
/// then bounds how far from it the full surfaces may pass.
/// In: frames as for query; at most max_pairs pairs of faces are worked out.
/// Cost: O(n log n) in the faces of both current meshes, whose trees are built for this.
[[nodiscard]] Contacts approximate_contacts(const ActiveMesh& a, const PosedFrame& frame_a,
                                            const ActiveMesh& b, const PosedFrame& frame_b,
                                            std::size_t max_pairs = kAllPairs);

}  // namespace nearmesh
