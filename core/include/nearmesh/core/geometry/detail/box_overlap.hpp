// SPDX-License-Identifier: Apache-2.0
#pragma once
// Conservative separation tests between boxes and triangles of two posed models, at rest or adrift.
// "Apart" is always true of the posed integer geometry (pose_point): rounding of posed vertices and
// of doubles is inside the slack. Plain double arithmetic without contraction: the same outcome on
// every machine. Source: Gottschalk, Lin, Manocha 1996, section 5 (fifteen axes); ours assumes no
// orthonormality and has no absolute epsilon on near-parallel edges: every error scales with the
// axis, see the .cpp.

#include <limits>

#include "nearmesh/core/geometry/pose.hpp"

namespace nearmesh {

/// Centre and half extents of a box, in its own model's grid units.
struct CenteredBox {
  std::array<double, 3> center{};
  std::array<double, 3> half{};
};
/// Exact (dyadic). An empty box gives meaningless extents: do not pass one.
[[nodiscard]] CenteredBox centered(const GridBox& box);

/// Maps model B's grid into model A's grid: x_A = rotation * x_B + translation, the true inverse of
/// A's fixed-point frame times B's (no orthonormality assumed). Derived once per pair and pose.
struct RelativeFrame {
  std::array<double, 9> rotation{};      ///< row-major, B's units to A's (scale included)
  std::array<double, 9> abs_rotation{};  ///< |rotation|
  std::array<double, 3> translation{};   ///< in A's grid units
  std::array<double, 9> inverse{};       ///< of rotation
  std::array<double, 9> abs_inverse{};   ///< |inverse|
  /// [3 i + l]: |e_i . (column j x column k)|, {j,k,l} all three.
  std::array<double, 9> abs_cofactor{};
  double slack = 0;            ///< bound of all rounding, in A's grid units (Euclidean length)
  double metres_per_unit = 0;  ///< A's cell
  double least_metres_per_unit = 0;    ///< the shortest that A's posed unit can be (near-rotations)
  double least_metres_per_b_unit = 0;  ///< the same of B
};
/// Both frames on one lattice (asserted). Exact integer difference of translations, then doubles.
[[nodiscard]] RelativeFrame make_relative_frame(const PosedFrame& a, const PosedFrame& b);

/// The same of the rigid placements themselves, as far as doubles go: `slack` holds no rounding of
/// posed vertices. Precondition: check_pose would accept the poses.
[[nodiscard]] RelativeFrame make_relative_frame(const Grid& grid_a, const Pose& pose_a,
                                                const Grid& grid_b, const Pose& pose_b);
/// A vector (a velocity, a way) from the world's metres to the grid units of a placed model.
[[nodiscard]] std::array<double, 3> to_grid_units(const Grid& grid, const Pose& pose,
                                                  const std::array<double, 3>& vector_world_m);

/// True when box a (A's grid) and box b (B's grid) are certainly apart: no posed triangle with
/// corners in a meets one with corners in b. 15 separating axes; false proves nothing.
[[nodiscard]] bool boxes_apart(const RelativeFrame& f, const CenteredBox& a, const CenteredBox& b);

/// True where balls around both boxes are apart by far more than anything rounds: boxes_apart says
/// so too then. Needs no relative frame: bodies far apart cost a fifth of it.
[[nodiscard]] bool balls_apart(const PosedFrame& frame_a, const GridBox& a,
                               const PosedFrame& frame_b, const GridBox& b);

/// A lower bound in metres of the distance between any posed triangle with corners in a and any
/// with corners in b; 0 when no axis separates the boxes. Positive exactly when boxes_apart. A
/// bound of enough_m, where one is found before all axes were looked at, may be less than that of
/// all.
[[nodiscard]] double boxes_gap_m(const RelativeFrame& f, const CenteredBox& a, const CenteredBox& b,
                                 double enough_m = std::numeric_limits<double>::infinity());

/// Box b along a's axes, to be held against many of a's boxes. A gap along one of these, in metres,
/// is a bound as boxes_gap_m is one, and no more than that but for what doubles round.
struct Extent {
  std::array<double, 3> lo{}, hi{};  ///< A's grid units; with the slack
  double metres_per_unit = 0;        ///< at least
};
[[nodiscard]] Extent extent_in_a(const RelativeFrame& f, const CenteredBox& b);

/// A triangle with its corners in A's grid units (doubles).
using DoubleTriangle = std::array<std::array<double, 3>, 3>;
/// B's triangle (B's grid units) in A's grid units; its rounding is inside the slack.
[[nodiscard]] DoubleTriangle to_a_units(const RelativeFrame& f, const std::array<GridPoint, 3>& b);
/// A's own triangle, converted (exact).
[[nodiscard]] DoubleTriangle as_doubles(const std::array<GridPoint, 3>& a);

/// True when box a (A's grid) and triangle t (B's, by to_a_units) are certainly apart. 13 axes.
[[nodiscard]] bool box_triangle_apart(const RelativeFrame& f, const CenteredBox& a,
                                      const DoubleTriangle& t);

/// A lower bound in metres of the distance between A's triangle a and B's triangle b, both in A's
/// grid units: the gap along the direction between their closest edges, or corner and face, less
/// the slack; 0 if none. Within the slack of the true distance but for near-parallel closest edges.
[[nodiscard]] double triangles_gap_m(const RelativeFrame& f, const DoubleTriangle& a,
                                     const DoubleTriangle& b);

/// The way from A's triangle to B's where they are nearest, both in A's grid units; nearly, and 0
/// where they meet.
[[nodiscard]] std::array<double, 3> shortest_way(const DoubleTriangle& a, const DoubleTriangle& b);

/// How B may move against A: as a whole by s * along, s in [-1, 1], and every point besides by at
/// most `around`, any way. A's grid units.
struct Drift {
  std::array<double, 3> along{};
  double around = 0;
};

/// `around`, with what doubles may add to the drift.
[[nodiscard]] double reach(const Drift& drift);

/// boxes_apart for every place to which the drift may take the boxes.
[[nodiscard]] bool boxes_stay_apart(const RelativeFrame& f, const Drift& drift,
                                    const CenteredBox& a, const CenteredBox& b);
/// Box a (A's grid) and triangle t (B's, by to_a_units) stay apart under the drift.
[[nodiscard]] bool box_triangle_stay_apart(const RelativeFrame& f, const Drift& drift,
                                           const CenteredBox& a, const DoubleTriangle& t);
/// Triangles a (A's) and b (B's), both in A's grid units, stay apart under the drift: tried along
/// A's axes and the direction between their closest edges, or corner and face.
[[nodiscard]] bool triangles_stay_apart(const RelativeFrame& f, const Drift& drift,
                                        const DoubleTriangle& a, const DoubleTriangle& b);

/// A half-space that holds a part of model A: normal . x <= bound for all its points x, A's grid
/// units. Exact: |normal|_1 and |bound| are whole numbers below 2^9 and 2^42.
struct BoundedPart {
  std::array<double, 3> normal{};
  double bound = 0;
};
/// The part and box b (B's grid) stay apart under the drift: no posed triangle of the part's meets
/// one with corners in b.
[[nodiscard]] bool half_space_box_stay_apart(const RelativeFrame& f, const Drift& drift,
                                             const BoundedPart& a, const CenteredBox& b);
/// The same of triangle t (B's, by to_a_units).
[[nodiscard]] bool half_space_triangle_stay_apart(const RelativeFrame& f, const Drift& drift,
                                                  const BoundedPart& a, const DoubleTriangle& t);

}  // namespace nearmesh
