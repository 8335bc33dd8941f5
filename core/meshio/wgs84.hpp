// SPDX-License-Identifier: Apache-2.0
#pragma once
// Places on the WGS 84 ellipsoid (NIMA TR8350.2, 2000, section 4.2). Made of + - * / and sqrt
// alone, so that every machine gets the same bits; within some nanometres of the true place.

#include <array>

namespace nearmesh::meshio {

inline constexpr double kWgs84Axis_m = 6378137.0;
inline constexpr double kWgs84InverseFlattening = 298.257223563;

struct SinCos {
  double sine = 0, cosine = 1;
};

/// In: |deg| <= 360.
[[nodiscard]] SinCos sin_cos_deg(double deg);

/// In: the height is above the ellipsoid.
[[nodiscard]] std::array<double, 3> to_ecef(const SinCos& latitude, const SinCos& longitude,
                                            double height_m);

/// East, north, up in the plane that touches the ellipsoid at a point.
class TangentPlane {
 public:
  TangentPlane(double latitude_deg, double longitude_deg);
  [[nodiscard]] std::array<double, 3> from_ecef(const std::array<double, 3>& point) const;

 private:
  SinCos latitude_, longitude_;
  std::array<double, 3> origin_{};
};

}  // namespace nearmesh::meshio
