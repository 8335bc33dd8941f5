// SPDX-License-Identifier: Apache-2.0
#pragma once
// Probes and their answers, from C and to C: of sessions, of files at hand, of worlds.

#include <algorithm>
#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "answers.hpp"
#include "handle.hpp"
#include "nearmesh/core/query/probe.hpp"
#include "nearmesh/core/world/world_probe.hpp"

namespace nearmesh::c {

template <class From>
[[nodiscard]] std::array<double, 3> three(const From& from) {
  return {from[0], from[1], from[2]};
}
[[nodiscard]] inline RayProbe probe_of(const nearmesh_ray& ray) {
  return {three(ray.origin_m), three(ray.direction), ray.range_m};
}
[[nodiscard]] inline BallProbe probe_of(const nearmesh_ball& ball) {
  return {three(ball.center_m), ball.radius_m};
}
[[nodiscard]] inline BoxProbe probe_of(const nearmesh_box& box) {
  return {from_c(box.pose), three(box.half_m)};
}
using Point = double[3];
[[nodiscard]] inline std::array<double, 3> probe_of(const Point& point_m) { return three(point_m); }

inline void tell_answer(const RayAnswer& from, nearmesh_ray_answer& to) {
  to = {};
  to.status = static_cast<int32_t>(from.status);
  to.has_face = from.has_face ? 1 : 0;
  to.at_least_m = from.at_least_m;
  to.at_most_m = from.at_most_m;
  std::copy(from.point_m.begin(), from.point_m.end(), to.point_m);
  std::copy(from.normal.begin(), from.normal.end(), to.normal);
  to.face = {from.face.split.value, from.face.index};
  to.missing = from.missing;
}
inline void tell_answer(const PointAnswer& from, nearmesh_point_answer& to) {
  to = {static_cast<int32_t>(from.status), from.on_surface ? 1 : 0, from.missing, 0};
}
inline void tell_answer(const ShapeAnswer& from, nearmesh_shape_answer& to) {
  to = {static_cast<int32_t>(from.status),
        from.has_face ? 1 : 0,
        {from.face.split.value, from.face.index},
        from.missing,
        0};
}
inline void tell_answer(const WorldRayAnswer& from, nearmesh_ray_answer& to) {
  tell_answer(from.ray, to);
}
inline void tell_answer(const WorldShapeAnswer& from, nearmesh_shape_answer& to) {
  tell_answer(from.shape, to);
}

/// Calls ask(probes, answers) with the arrays as C++ has them.
template <class Probe, class Answer, class From, class To, class Ask>
[[nodiscard]] Status asked(const From* given, std::size_t count, const char* name, To* answers,
                           const Ask& ask) {
  NEARMESH_RETURN_IF_ERROR(check_array(given, count, name));
  NEARMESH_RETURN_IF_ERROR(check_array(answers, count, "answers"));
  std::vector<Probe> probes;
  probes.reserve(count);
  for (std::size_t i = 0; i < count; ++i) probes.push_back(probe_of(given[i]));
  std::vector<Answer> found(count);
  NEARMESH_RETURN_IF_ERROR(ask(std::span<const Probe>(probes), std::span<Answer>(found)));
  for (std::size_t i = 0; i < count; ++i) tell_answer(found[i], answers[i]);
  return Status::ok();
}

[[nodiscard]] inline const Point* points_of(const double* points_m) {
  return reinterpret_cast<const Point*>(points_m);  // an array of arrays lies as one of numbers
}

}  // namespace nearmesh::c
