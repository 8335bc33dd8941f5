// SPDX-License-Identifier: Apache-2.0
#pragma once
// Where a body can be: boxes in the world that hold all faces of its full mesh, whatever of it is
// known. From the model's header, a pose and velocities alone.

#include <array>
#include <cstdint>

#include "nearmesh/core/geometry/motion.hpp"
#include "nearmesh/core/spm/detail/split_store.hpp"

namespace nearmesh {

/// World frame, metres, corners included.
struct WorldBox {
  std::array<double, 3> lo_m{}, hi_m{};

  [[nodiscard]] bool meets(const WorldBox& other) const {
    return lo_m[0] <= other.hi_m[0] && other.lo_m[0] <= hi_m[0] && lo_m[1] <= other.hi_m[1] &&
           other.lo_m[1] <= hi_m[1] && lo_m[2] <= other.hi_m[2] && other.lo_m[2] <= hi_m[2];
  }
  [[nodiscard]] bool holds(const WorldBox& other) const {
    return lo_m[0] <= other.lo_m[0] && other.hi_m[0] <= hi_m[0] && lo_m[1] <= other.lo_m[1] &&
           other.hi_m[1] <= hi_m[1] && lo_m[2] <= other.lo_m[2] && other.hi_m[2] <= hi_m[2];
  }
  bool operator==(const WorldBox&) const = default;
};

/// The smallest that holds both.
[[nodiscard]] WorldBox hull(const WorldBox& a, const WorldBox& b);

/// Bodies are expected to go on as they do for so long: 4 to 8 s, by their number, since not all
/// shall leave their roams at once. On their way they turn aside by this share of it.
[[nodiscard]] double roam_s(std::uint64_t number);
inline constexpr double kRoamAside = 0.125;

/// Where what has this box is expected to stay for a while: it goes that way from here, give or
/// take `aside_m` on each side.
[[nodiscard]] WorldBox roam_along(const WorldBox& box, const std::array<double, 3>& way_m,
                                  double aside_m);

/// What a model's header says of where its faces are, as a body needs it in each frame: the boxes
/// of its roots hold all faces of the full mesh, and no batch changes them.
class ModelBounds {
 public:
  ModelBounds() = default;
  ModelBounds(const Grid& grid, const SplitStore& store);
  /// Of a box that holds all faces, in the grid.
  ModelBounds(const Grid& grid, const GridBox& box);

  /// How far a point of the body may move in so many seconds, if it keeps within its speeds;
  /// metres, rounded up.
  [[nodiscard]] double way_m(const Motion& motion, double duration_s) const;
  /// Holds every posed face of the body (query.hpp) against any other one, at its pose and as far
  /// as way_m goes, and `margin_m` more on each side. Then two bodies whose boxes do not meet are
  /// farther apart than both ways and margins together. Precondition: check_motion accepted the
  /// motion. Cost: some 60 operations.
  [[nodiscard]] WorldBox around(const Motion& motion, double duration_s, double margin_m) const;
  /// The same of a body whose origin is in a ball, however it is turned: holds each of its posed
  /// faces against any other body, and `margin_m` more on each side.
  [[nodiscard]] WorldBox around_ball(const std::array<double, 3>& center_m, double radius_m,
                                     double margin_m) const;

 private:
  Grid grid_;
  std::array<double, 3> center_m_{}, half_m_{};
  double reach_m_ = 0;        // of the farthest point from the origin
  int lattice_exponent_ = 0;  // of a lattice that is no finer than this model alone would have it
};

}  // namespace nearmesh
