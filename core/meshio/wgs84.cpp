// SPDX-License-Identifier: Apache-2.0
#include "wgs84.hpp"

#include <cmath>

namespace nearmesh::meshio {

SinCos sin_cos_deg(double deg) {
  // What is left of whole quarter turns is exact: 90 k and deg are within a factor of two of each
  // other.
  const double quarters = std::round(deg / 90);
  constexpr double kRadians = 3.14159265358979323846 / 180;
  const double x = (deg - 90 * quarters) * kRadians, square = x * x;
  // Taylor's series, up to terms below a unit in the last place at 45 degrees.
  double sine = 1, cosine = 1;
  for (int k = 9; k >= 1; --k) {
    cosine = 1 - cosine * square / ((2 * k - 1) * (2 * k));
    sine = 1 - sine * square / ((2 * k) * (2 * k + 1));
  }
  sine *= x;
  switch ((static_cast<int>(quarters) % 4 + 4) % 4) {
    case 0:
      return {sine, cosine};
    case 1:
      return {cosine, -sine};
    case 2:
      return {-sine, -cosine};
    default:
      return {-cosine, sine};
  }
}

std::array<double, 3> to_ecef(const SinCos& latitude, const SinCos& longitude, double height_m) {
  constexpr double kFlattening = 1 / kWgs84InverseFlattening;
  constexpr double kSquaredEccentricity = kFlattening * (2 - kFlattening);
  const double to_axis_m =
      kWgs84Axis_m / std::sqrt(1 - kSquaredEccentricity * latitude.sine * latitude.sine);
  const double from_axis_m = (to_axis_m + height_m) * latitude.cosine;
  return {from_axis_m * longitude.cosine, from_axis_m * longitude.sine,
          (to_axis_m * (1 - kSquaredEccentricity) + height_m) * latitude.sine};
}

TangentPlane::TangentPlane(double latitude_deg, double longitude_deg)
    : latitude_(sin_cos_deg(latitude_deg)),
      longitude_(sin_cos_deg(longitude_deg)),
      origin_(to_ecef(latitude_, longitude_, 0)) {}

std::array<double, 3> TangentPlane::from_ecef(const std::array<double, 3>& point) const {
  const double dx = point[0] - origin_[0], dy = point[1] - origin_[1], dz = point[2] - origin_[2];
  const double outward = longitude_.cosine * dx + longitude_.sine * dy;
  return {longitude_.cosine * dy - longitude_.sine * dx,
          latitude_.cosine * dz - latitude_.sine * outward,
          latitude_.cosine * outward + latitude_.sine * dz};
}

}  // namespace nearmesh::meshio
