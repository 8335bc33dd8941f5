// SPDX-License-Identifier: Apache-2.0
#include "geodesy.hpp"

#include <cmath>
#include <cstddef>
#include <numbers>

namespace flightgear {
namespace {

constexpr double kAxis_m = 6378137, kFlattening = 1 / 298.257223563;
constexpr double kEccentricity2 = kFlattening * (2 - kFlattening);
constexpr double kDegree = std::numbers::pi / 180;

/// East, north, up as rows.
Matrix axes_at(const Place& place) {
  const double b = place.latitude_deg * kDegree, l = place.longitude_deg * kDegree;
  const double sb = std::sin(b), cb = std::cos(b), sl = std::sin(l), cl = std::cos(l);
  return {-sl, cl, 0, -sb * cl, -sb * sl, cb, cb * cl, cb * sl, sb};
}

Vector times(const Matrix& m, const Vector& v) {
  Vector out{};
  for (std::size_t r = 0; r < 3; ++r)
    for (std::size_t c = 0; c < 3; ++c) out[r] += m[3 * r + c] * v[c];
  return out;
}
Vector transposed_times(const Matrix& m, const Vector& v) {
  Vector out{};
  for (std::size_t r = 0; r < 3; ++r)
    for (std::size_t c = 0; c < 3; ++c) out[c] += m[3 * r + c] * v[r];
  return out;
}

}  // namespace

Vector to_geocentric_m(const Place& place) {
  const double b = place.latitude_deg * kDegree, l = place.longitude_deg * kDegree;
  const double across_m = kAxis_m / std::sqrt(1 - kEccentricity2 * std::sin(b) * std::sin(b));
  const double from_axis_m = (across_m + place.height_m) * std::cos(b);
  return {from_axis_m * std::cos(l), from_axis_m * std::sin(l),
          (across_m * (1 - kEccentricity2) + place.height_m) * std::sin(b)};
}

Place to_place(const Vector& at_m) {
  constexpr int kRounds = 10;  // each leaves about a hundredth of the error
  const double from_axis_m = std::hypot(at_m[0], at_m[1]);
  double b = std::atan2(at_m[2], from_axis_m * (1 - kEccentricity2)), across_m = kAxis_m;
  for (int round = 0; round < kRounds; ++round) {
    across_m = kAxis_m / std::sqrt(1 - kEccentricity2 * std::sin(b) * std::sin(b));
    b = std::atan2(at_m[2] + kEccentricity2 * across_m * std::sin(b), from_axis_m);
  }
  // Of the two ways to the height neither divides by what is small near the equator or a pole.
  const double height_m =
      from_axis_m * std::cos(b) + at_m[2] * std::sin(b) - kAxis_m * kAxis_m / across_m;
  return {b / kDegree, std::atan2(at_m[1], at_m[0]) / kDegree, height_m};
}

Matrix attitude_of(double roll_deg, double pitch_deg, double heading_deg) {
  const double r = roll_deg * kDegree, p = pitch_deg * kDegree, h = heading_deg * kDegree;
  const double sr = std::sin(r), cr = std::cos(r), sp = std::sin(p), cp = std::cos(p),
               sh = std::sin(h), ch = std::cos(h);
  // Turned by the heading about down, then the pitch about the right wing, then the roll about the
  // nose.
  return {cp * ch,
          -(sr * sp * ch - cr * sh),
          -(cr * sp * ch + sr * sh),
          cp * sh,
          -(sr * sp * sh + cr * ch),
          -(cr * sp * sh - sr * ch),
          -sp,
          -(sr * cp),
          -(cr * cp)};
}

SceneFrame::SceneFrame(const Place& origin)
    : origin_m_(to_geocentric_m(origin)), axes_(axes_at(origin)) {}

Vector SceneFrame::to_scene_m(const Place& place) const {
  Vector from = to_geocentric_m(place);
  for (std::size_t k = 0; k < 3; ++k) from[k] -= origin_m_[k];
  return times(axes_, from);
}

Place SceneFrame::to_place(const Vector& scene_m) const {
  Vector at_m = transposed_times(axes_, scene_m);
  for (std::size_t k = 0; k < 3; ++k) at_m[k] += origin_m_[k];
  return flightgear::to_place(at_m);
}

Vector SceneFrame::turn(const Place& at, const Vector& ned) const {
  return times(axes_, transposed_times(axes_at(at), {ned[1], ned[0], -ned[2]}));
}

Matrix SceneFrame::turn(const Place& at, const Matrix& ned) const {
  Matrix out{};
  for (std::size_t c = 0; c < 3; ++c) {
    const Vector column = turn(at, Vector{ned[c], ned[3 + c], ned[6 + c]});
    for (std::size_t r = 0; r < 3; ++r) out[3 * r + c] = column[r];
  }
  return out;
}

}  // namespace flightgear
