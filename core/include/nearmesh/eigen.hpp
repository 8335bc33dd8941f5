// SPDX-License-Identifier: Apache-2.0
#pragma once
// API (docs/api.md).
// Eigen's isometries, quaternions, vectors and boxes to ours and back, for hosts that have Eigen
// 3.3 or later; nearmesh itself does without. Of floats or doubles; what a float rounds away from a
// rotation, sessions make good (orthonormal() in core/geometry/pose.hpp).

#include <Eigen/Geometry>
#include <array>

#include "nearmesh/core/geometry/motion.hpp"
#include "nearmesh/core/query/probe.hpp"

namespace nearmesh {

/// Three numbers of ours: positions, velocities, corners.
template <class Scalar>
[[nodiscard]] std::array<double, 3> from_eigen(const Eigen::Matrix<Scalar, 3, 1>& vector) {
  return {static_cast<double>(vector.x()), static_cast<double>(vector.y()),
          static_cast<double>(vector.z())};
}
[[nodiscard]] inline Eigen::Vector3d to_eigen(const std::array<double, 3>& vector) {
  return {vector[0], vector[1], vector[2]};
}

/// x_world = transform * x_model. Its linear part must be a rotation, as check_pose says.
template <class Scalar, int kMode, int kOptions>
[[nodiscard]] Pose to_pose(const Eigen::Transform<Scalar, 3, kMode, kOptions>& transform) {
  Pose pose;
  for (int row = 0; row < 3; ++row)
    for (int column = 0; column < 3; ++column)
      pose.rotation[static_cast<std::size_t>(3 * row + column)] =
          static_cast<double>(transform.linear()(row, column));
  pose.translation_m = from_eigen<Scalar>(transform.translation());
  return pose;
}
/// The quaternion is normalised; it must not be 0.
template <class Scalar, int kOptions>
[[nodiscard]] Pose to_pose(const Eigen::Quaternion<Scalar, kOptions>& rotation,
                           const Eigen::Matrix<Scalar, 3, 1>& translation_m) {
  Eigen::Isometry3d transform(rotation.template cast<double>().normalized());
  transform.translation() = translation_m.template cast<double>();
  return to_pose(transform);
}
[[nodiscard]] inline Eigen::Isometry3d to_isometry(const Pose& pose) {
  Eigen::Isometry3d transform = Eigen::Isometry3d::Identity();
  for (int row = 0; row < 3; ++row)
    for (int column = 0; column < 3; ++column)
      transform.linear()(row, column) = pose.rotation[static_cast<std::size_t>(3 * row + column)];
  transform.translation() = to_eigen(pose.translation_m);
  return transform;
}
/// Of length 1, with w >= 0.
[[nodiscard]] inline Eigen::Quaterniond to_quaternion(const Pose& pose) {
  Eigen::Quaterniond rotation(to_isometry(pose).linear());
  rotation.normalize();
  if (rotation.w() < 0) rotation.coeffs() *= -1;
  return rotation;
}

/// World frame, metres, seconds, radians; the body turns about the origin of its model frame.
template <class Transform>
[[nodiscard]] Motion to_motion(const Transform& transform,
                               const Eigen::Vector3d& linear_velocity_mps,
                               const Eigen::Vector3d& angular_velocity_radps) {
  return {to_pose(transform), from_eigen<double>(linear_velocity_mps),
          from_eigen<double>(angular_velocity_radps)};
}

/// A box by its two corners, as Session::region_readiness takes it, and back.
struct BoxCorners {
  std::array<double, 3> lo_m{}, hi_m{};
};
[[nodiscard]] inline BoxCorners to_corners(const Eigen::AlignedBox3d& box) {
  return {from_eigen<double>(box.min()), from_eigen<double>(box.max())};
}
[[nodiscard]] inline Eigen::AlignedBox3d to_aligned_box(const BoxCorners& box) {
  return {to_eigen(box.lo_m), to_eigen(box.hi_m)};
}
/// A box that stands along the axes of a frame, the world's if none is said. Precondition: it is
/// not empty.
[[nodiscard]] inline BoxProbe to_box_probe(
    const Eigen::AlignedBox3d& box,
    const Eigen::Isometry3d& frame = Eigen::Isometry3d::Identity()) {
  const Eigen::Vector3d half = box.sizes() / 2;
  return {to_pose(Eigen::Isometry3d(frame * Eigen::Translation3d(box.center()))),
          from_eigen<double>(half)};
}

}  // namespace nearmesh
