// SPDX-License-Identifier: Apache-2.0
#include "ros2_marks.hpp"

#include <chrono>
#include <cmath>
#include <utility>

#include "idl/program/logging.hpp"

namespace nearmesh::subscriber::program {
namespace {

// Colours of the player: exact faces, coarse faces, contacts; and what is not known.
constexpr std::array<float, 4> kExact{0.13F, 0.27F, 0.60F, 1};
constexpr std::array<float, 4> kCoarse{0.78F, 0.82F, 0.86F, 1};
constexpr std::array<float, 4> kContact{1, 0, 1, 1};
constexpr std::array<float, 4> kUncertain{1, 0.65F, 0, 1};
constexpr double kWidthShare = 0.001;  ///< of lines, of what the smaller model's grid spans
constexpr std::size_t kMostFaces = 200'000;
constexpr std::uint32_t kLifetime_s = 2;  ///< of what is drawn each frame, if the frames end

ros2::Marker lines(const LineMark& mark, const std::array<float, 4>& rgba) {
  return {.frame = mark.frame,
          .name_space = mark.name,
          .id = mark.id,
          .kind = ros2::Marker::Kind::kLineList,
          .width_m = mark.width_m,
          .rgba = rgba,
          .lifetime_s = kLifetime_s,
          .points_m = {}};
}

}  // namespace

std::int64_t ros2_now_ns() {
  return std::chrono::duration_cast<std::chrono::nanoseconds>(
             std::chrono::system_clock::now().time_since_epoch())
      .count();
}

double line_width_m(int exponent) { return kWidthShare * std::ldexp(1, 21 + exponent); }

ros2::Marker contact_mark(const LineMark& mark, const std::vector<ContactSegment>& segments) {
  ros2::Marker marker = lines(mark, kContact);
  for (const ContactSegment& segment : segments) {
    marker.points_m.push_back(segment.p_m);
    marker.points_m.push_back(segment.q_m);
  }
  return marker;
}

ros2::Marker uncertain_mark(const LineMark& mark, const std::array<double, 3>& a_m,
                            const std::array<double, 3>& b_m) {
  ros2::Marker marker = lines(mark, kUncertain);
  marker.name_space += " uncertain";
  marker.points_m = {a_m, b_m};
  return marker;
}

ros2::Marker unknown_mark(const LineMark& mark, const std::array<double, 3>& at_m, double span_m) {
  ros2::Marker marker = lines(mark, kUncertain);
  marker.name_space += " unknown";
  for (std::size_t axis = 0; axis < 3; ++axis)
    for (const double side : {-0.1, 0.1}) {
      marker.points_m.push_back(at_m);
      marker.points_m.back()[axis] += side * span_m;
    }
  return marker;
}

std::vector<ros2::Marker> mesh_marks(const std::string& body,
                                     std::vector<std::array<double, 3>> exact_m,
                                     std::vector<std::array<double, 3>> coarse_m) {
  if (exact_m.size() + coarse_m.size() > 3 * kMostFaces) {
    wire::program::log("session").warn("ros2: {} has more than {} faces here: not drawn", body,
                                       kMostFaces);
    return {};
  }
  ros2::Marker exact{.frame = body,
                     .name_space = body + " exact",
                     .id = 0,
                     .kind = ros2::Marker::Kind::kTriangleList,
                     .rgba = kExact,
                     .points_m = std::move(exact_m)};
  ros2::Marker coarse{.frame = body,
                      .name_space = body + " coarse",
                      .id = 0,
                      .kind = ros2::Marker::Kind::kTriangleList,
                      .rgba = kCoarse,
                      .points_m = std::move(coarse_m)};
  return {std::move(exact), std::move(coarse)};
}

}  // namespace nearmesh::subscriber::program
