// SPDX-License-Identifier: Apache-2.0
// Eigen's types to ours and back.
#ifdef NEARMESH_TEST_EIGEN
#include "nearmesh/eigen.hpp"

#include <gtest/gtest.h>

#include "core/base/random.hpp"
#include "random_rotation.hpp"

namespace nearmesh {
namespace {

TEST(Eigen, PosesGoThereAndBackAndPlaceAlike) {
  Random random(31);
  for (int i = 0; i < 200; ++i) {
    Pose pose{.rotation = test::random_rotation(random),
              .translation_m = {random.between(-9, 9), random.between(-9, 9), 1e6}};
    const Eigen::Isometry3d transform = to_isometry(pose);
    EXPECT_EQ(to_pose(transform).rotation, pose.rotation);
    EXPECT_EQ(to_pose(transform).translation_m, pose.translation_m);
    const Eigen::Vector3d at(random.between(-1, 1), random.between(-1, 1), random.between(-1, 1));
    const Eigen::Vector3d placed = transform * at;
    for (int r = 0; r < 3; ++r) {
      double sum = pose.translation_m[static_cast<std::size_t>(r)];
      for (int c = 0; c < 3; ++c) sum += pose.rotation[static_cast<std::size_t>(3 * r + c)] * at[c];
      EXPECT_NEAR(placed[r], sum, 1e-9);
    }
    const Eigen::Quaterniond turn = to_quaternion(pose);
    EXPECT_GE(turn.w(), 0);
    const Pose again = to_pose(turn, Eigen::Vector3d(to_eigen(pose.translation_m)));
    const auto ours = rotation_of_quaternion({turn.w(), turn.x(), turn.y(), turn.z()}, "it");
    ASSERT_TRUE(ours.is_ok());
    for (std::size_t k = 0; k < 9; ++k) {
      EXPECT_NEAR(again.rotation[k], pose.rotation[k], 1e-14);
      EXPECT_NEAR(ours.value()[k], pose.rotation[k], 1e-14);
    }
    const Eigen::Isometry3f coarse(transform.cast<float>());
    EXPECT_TRUE(check_pose(to_pose(coarse), "it").is_ok());
    EXPECT_TRUE(
        check_pose(to_pose(Eigen::Quaternionf(turn.cast<float>()), Eigen::Vector3f(1, 2, 3)), "it")
            .is_ok());
    const Motion motion = to_motion(transform, {1, 2, 3}, {4, 5, 6});
    EXPECT_EQ(motion.pose.rotation, pose.rotation);
    EXPECT_EQ(motion.linear_velocity_mps, (std::array<double, 3>{1, 2, 3}));
    EXPECT_EQ(motion.angular_velocity_radps, (std::array<double, 3>{4, 5, 6}));
  }
}

TEST(Eigen, BoxesGoThereAndBack) {
  const Eigen::AlignedBox3d box(Eigen::Vector3d(-1, 2, 3), Eigen::Vector3d(5, 4, 9));
  const BoxCorners corners = to_corners(box);
  EXPECT_EQ(corners.lo_m, (std::array<double, 3>{-1, 2, 3}));
  EXPECT_EQ(corners.hi_m, (std::array<double, 3>{5, 4, 9}));
  EXPECT_TRUE(to_aligned_box(corners).isApprox(box));
  Eigen::Isometry3d frame(Eigen::AngleAxisd(1.5, Eigen::Vector3d::UnitY()));
  frame.translation() = Eigen::Vector3d(7, 8, 9);
  const BoxProbe probe = to_box_probe(box, frame);
  EXPECT_EQ(probe.half_m, (std::array<double, 3>{3, 1, 3}));
  const Eigen::Vector3d corner = to_isometry(probe.pose) * to_eigen(probe.half_m);
  EXPECT_TRUE(corner.isApprox(frame * box.max()));
}

}  // namespace
}  // namespace nearmesh
#endif
