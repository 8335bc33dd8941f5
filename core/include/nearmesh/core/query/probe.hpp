// SPDX-License-Identifier: Apache-2.0
#pragma once
// API (docs/api.md).
// Probes of one posed body: rays (and with them heights below points), points inside a solid, balls
// and boxes. Each answer is certified as a query's is (core/THEOREM.md, "Probes"): hit, miss, or
// uncertain, with the nodes whose splits settle it.
//
// What is probed. The body is posed on a lattice of its own, a quarter of its grid's cell, by the
// rule of geometry/pose.hpp: vertices are rounded to it, faces are closed, and what touches an edge
// or a corner touches the face. A probe is rounded too, and then decided exactly, by integers, so
// that a ray through the edge of two faces, or straight along a face, hits. Rounded are
//   rays    cut to the box of the model's whole grid, then both ends to the lattice point next to
//           them;
//   points  to the lattice point next to them;
//   balls   their centre likewise, their radius to whole lattice cells;
//   boxes   their half extents to cells of the body's grid, at least one, their placement as a
//           body's pose is.
// So a probe lies within a lattice cell of what was asked, and far from the world's origin within
// what doubles tell there. An answer does not depend on the state of refinement, but for what it
// says of being uncertain.

#include <array>
#include <cstdint>
#include <limits>
#include <span>
#include <vector>

#include "nearmesh/core/abtree/detail/tree.hpp"
#include "nearmesh/core/query/certify.hpp"
#include "nearmesh/core/query/query.hpp"

namespace nearmesh {

enum class ProbeStatus : std::uint8_t {
  kMiss = 0,      ///< certified: nothing of the full mesh is met
  kHit = 1,       ///< certified: what the answer says is met, and is what the full mesh has there
  kUncertain = 2  ///< what is missing may be met
};
/// "miss", "hit", "uncertain".
[[nodiscard]] const char* to_string(ProbeStatus status);

/// From a point of the world in a direction, as far as `range_m`.
struct RayProbe {
  std::array<double, 3> origin_m{};
  std::array<double, 3> direction{0, 0, -1};  ///< finite, of any length but 0
  double range_m = std::numeric_limits<double>::infinity();
};

/// The first face that a ray meets. Of several at one point the one with the least key.
struct RayAnswer {
  ProbeStatus status = ProbeStatus::kUncertain;
  /// A face is known that the ray meets; uncertain: what is missing may be met before it.
  bool has_face = false;
  std::uint32_t missing = 0;  ///< how many nodes this answer lacks
  FaceKey face;               ///< where has_face; so are point_m and normal
  /// Of the face that is met first, metres from the origin: hit: both but for the rounding of
  /// doubles (2^-40 of the way through the grid). Uncertain: nothing is met before at_least_m;
  /// something is at at_most_m, if that is finite. Miss: infinite.
  double at_least_m = 0;
  double at_most_m = std::numeric_limits<double>::infinity();
  std::array<double, 3> point_m{};  ///< world
  /// Of the face, a unit vector on the side where its corners run counter-clockwise; 0: it has none
  std::array<double, 3> normal{};

  /// Of the face; NaN where there is none. Of a ray straight down it is the origin's height above
  /// the ground.
  [[nodiscard]] double distance_m() const {
    return has_face ? at_most_m : std::numeric_limits<double>::quiet_NaN();
  }
};

/// Whether a point lies in a solid, where the winding number is not 0.
struct PointAnswer {
  ProbeStatus status = ProbeStatus::kUncertain;  ///< hit: inside or on the surface; miss: outside
  bool on_surface = false;
  std::uint32_t missing = 0;  ///< how many nodes this answer lacks
};

/// A closed ball, world frame; its radius at least 0.
struct BallProbe {
  std::array<double, 3> center_m{};
  double radius_m = 0;
};
/// A closed box about the origin of its own frame.
struct BoxProbe {
  Pose pose;                       ///< of that frame in the world
  std::array<double, 3> half_m{};  ///< half of its extent along each of the frame's axes, 0 to 1e9
};
/// Whether a ball or a box, filled, meets a surface.
struct ShapeAnswer {
  ProbeStatus status = ProbeStatus::kUncertain;
  /// False for a hit where a part of the body is inside a box that its surface does not meet.
  bool has_face = false;
  std::uint32_t missing = 0;
  /// Of those that are met the one with the least key; while uncertain, of those that are known.
  FaceKey face;
};

/// What the answers of a batch lack together.
struct ProbeNeeds {
  std::vector<NodeSpan> missing;  ///< ascending
  /// In the body's grid: the parts of these nodes that matter, a hint where to ask for detail.
  std::vector<GridBox> where;
  QueryStats stats;
  [[nodiscard]] bool is_nothing() const { return missing.empty(); }
};

/// Each of these answers a batch of probes in the world against a body in a pose. Preconditions
/// (asserted): as many answers as probes.
/// Errors: kInvalidArgument naming the probe by its place, or as check_pose; kUnsupported as
/// make_posed_frame.
/// Deterministic. Threads: views may be shared. Cost of a ray: O(log faces) near it, some 0.3 us on
/// held terrain.
[[nodiscard]] Result<ProbeNeeds> probe(const TreeView& body, const Pose& pose,
                                       std::span<const RayProbe> rays,
                                       std::span<RayAnswer> answers);
/// Is each of the points, in the world, in the solid? Errors: also kInvalidArgument where the
/// surface is open (check_solid).
/// Cost: a few us a point within the body's box.
[[nodiscard]] Result<ProbeNeeds> probe(const TreeView& solid, const Pose& pose,
                                       std::span<const std::array<double, 3>> points_m,
                                       std::span<PointAnswer> answers);
[[nodiscard]] Result<ProbeNeeds> probe(const TreeView& body, const Pose& pose,
                                       std::span<const BallProbe> balls,
                                       std::span<ShapeAnswer> answers);
/// A box is asked about as a solid body (query.hpp), some 10 us each. Of a model without seeds a
/// box that holds a whole part stays uncertain with nothing missing.
[[nodiscard]] Result<ProbeNeeds> probe(const TreeView& body, const Pose& pose,
                                       std::span<const BoxProbe> boxes,
                                       std::span<ShapeAnswer> answers);

/// The same of a model at hand: splits what is missing, until nothing is. Errors: also those of
/// certify().
template <class Probe, class Answer>
[[nodiscard]] Status certify_probes(LocalModel& body, const Pose& pose, const Require& require,
                                    std::span<const Probe> probes, std::span<Answer> answers) {
  while (true) {
    const Result<ProbeNeeds> needs = probe(body.view(), pose, probes, answers);
    if (!needs.is_ok()) return needs.status();
    if (needs.value().is_nothing()) return Status::ok();
    if (Status split = split_missing(body, needs.value().missing, require); !split.is_ok())
      return split;
  }
}

}  // namespace nearmesh
