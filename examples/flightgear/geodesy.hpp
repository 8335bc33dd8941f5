// SPDX-License-Identifier: Apache-2.0
#pragma once
// Places on the WGS 84 ellipsoid, and a scene's own frame: x east, y north, z up in the plane that
// touches the ellipsoid at its origin, as `nearmesh-model build --crs enu:LAT,LON` has it. Metres.

#include <array>

namespace flightgear {

using Vector = std::array<double, 3>;
using Matrix = std::array<double, 9>;  ///< row-major

struct Place {
  double latitude_deg = 0, longitude_deg = 0;
  double height_m = 0;  ///< above the ellipsoid
};

/// Geocentric: z through the north pole, x through the meridian of Greenwich.
[[nodiscard]] Vector to_geocentric_m(const Place& place);
/// The way back, to a micrometre from 1,000 km below the ellipsoid to 10,000 km above it.
[[nodiscard]] Place to_place(const Vector& geocentric_m);

/// Nose, left, up of an aircraft, in the frame of north, east, down where it is. Its columns.
[[nodiscard]] Matrix attitude_of(double roll_deg, double pitch_deg, double heading_deg);

class SceneFrame {
 public:
  explicit SceneFrame(const Place& origin);
  [[nodiscard]] Vector to_scene_m(const Place& place) const;
  [[nodiscard]] Place to_place(const Vector& scene_m) const;
  /// Turns what is told as north, east, down at a place.
  [[nodiscard]] Vector turn(const Place& at, const Vector& north_east_down) const;
  [[nodiscard]] Matrix turn(const Place& at, const Matrix& north_east_down) const;

 private:
  Vector origin_m_;
  Matrix axes_;  ///< east, north, up as rows, geocentric
};

}  // namespace flightgear
